"""Script that runs a program, and kills it when the process that started the script ends for any reason.

It is run by ``python -I -S``. Its arguments are a file for the program's output, the largest size of a file in bytes,
and the program with its arguments. It prints the exit code (minus the signal that ended the program) and the CPU
seconds, or ``error`` and the reason if the program could not be started. At the end of standard input the program's
process group is killed.
"""

import _thread
import os
import resource
import signal
import sys


def main(log: str, largest: str, *command: str) -> None:
    """Run the command to its end, or to the end of standard input, and print the answer."""
    # Without a reader of the answer this process ends quietly, without a traceback.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(largest), int(largest)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    files = [
        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
        (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600),
        (os.POSIX_SPAWN_DUP2, 1, 2),
    ]
    # The program gets the default action of the signals that Python ignores.
    try:
        number = os.posix_spawn(
            command[0],
            command,
            os.environ,
            file_actions=files,
            setpgroup=0,
            setsigdef=[signal.SIGPIPE, signal.SIGXFSZ],
        )
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
    # The lock is never released: once the program has been waited for, the system may give its number
    # to another process, which must not be killed.
    lock.acquire()
    _, status, used = os.wait4(number, 0)
    print(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime)


if __name__ == "__main__":
    main(*sys.argv[1:])
