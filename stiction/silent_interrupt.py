"""Silent end of the process by an interrupt during imports. This module must be imported first.

Otherwise an interrupt would print a traceback of the imports. `stiction.cli.app.main` handles interrupts
after the imports, and child processes leave them to their parent.
"""

import signal

# A shell starts commands with `&` or `nohup` so that they ignore interrupts; this is not changed.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
