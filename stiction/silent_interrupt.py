"""To be imported first: an interrupt during the other imports ends the process at once, without their traceback.

`stiction.cli.app.main` takes interrupts from there on; children leave them to their parent.
"""

import signal

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # not where a shell has had them ignored: nohup, &
    signal.signal(signal.SIGINT, signal.SIG_DFL)
