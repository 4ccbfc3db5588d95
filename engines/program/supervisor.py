"""Run of a program under supervision: when the process that started it ends, for any reason, the program is killed.

This is a script for ``python -I -S``. Arguments: a file for the program's output, the largest size of a file in bytes,
the program with its arguments. Standard output: exit code (minus the signal that ended it) and CPU seconds, or
``error`` and why it could not be started. At the end of standard input the program's process group is killed.
"""

import _thread
import os
import resource
import signal
import sys


def main(log: str, largest: str, *command: str) -> None:
    """Run the command to its end, or to that of standard input, and print the answer."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # nobody reads an answer: no need of a traceback
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(largest), int(largest)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    files = [
        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
        (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600),
        (os.POSIX_SPAWN_DUP2, 1, 2),
    ]
    try:
        number = os.posix_spawn(
            command[0],
            command,
            os.environ,
            file_actions=files,
            setpgroup=0,
            setsigdef=[signal.SIGPIPE, signal.SIGXFSZ],
        )  # Python ignores the second
    except OSError as error:
        print("error", error.strerror)
        return
    lock = _thread.allocate_lock()

    def kill_group(wait_for_input: bool) -> None:
        if wait_for_input:
            os.read(0, 1)
        with lock:
            try:
                os.killpg(number, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):
                # All processes of the group have ended, which macOS reports as the second error.
                pass

    _thread.start_new_thread(kill_group, (True,))
    os.waitid(os.P_PID, number, os.WEXITED | os.WNOWAIT)
    kill_group(False)  # processes that the program has left running
    # Never released: once the program has been waited for, its number may be that of another process.
    lock.acquire()
    _, status, used = os.wait4(number, 0)
    print(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime)


if __name__ == "__main__":
    main(*sys.argv[1:])
