"""Program under supervision: whoever started it may be killed at any time, and nothing of the program is left then.

A script by itself, for ``python -I -S``: a killed process cannot clean up behind itself. Arguments: a folder, a file
for what the program prints, the largest size of a file in bytes, and the program with its arguments. The end of
standard input means that nobody waits any more: all processes of the program's group are killed, and the folder is
removed. The answer on standard output: exit code (minus the signal that ended the program) and CPU seconds, or
``error`` and why it could not be started.
"""

import _thread
import os
import resource
import signal
import sys


def main(folder, log, largest, *command):
    """Run the command and print the answer."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(largest), int(largest)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    files = [(os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
             (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), (os.POSIX_SPAWN_DUP2, 1, 2)]
    try:
        program = os.posix_spawn(command[0], command, os.environ, file_actions=files, setpgroup=0,
                                 setsigdef=[signal.SIGPIPE, signal.SIGXFSZ])  # Python ignores them
    except OSError as error:
        print("error", error.strerror)
        return
    _thread.start_new_thread(end_with_starter, (program, folder))
    os.waitid(os.P_PID, program, os.WEXITED | os.WNOWAIT)
    kill_group(program)  # what the program has left running, while its number is still its own
    _, status, used = os.wait4(program, 0)
    print(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime)


def end_with_starter(program, folder):
    """Wait for the end of standard input, then leave nothing."""
    os.read(0, 1)
    from shutil import rmtree  # rarely called for, and as long to import as all of Python

    kill_group(program)
    rmtree(folder, ignore_errors=True)
    os._exit(1)


def kill_group(program):
    """Kill all processes of the program's group, if there are any."""
    try:
        os.killpg(program, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):  # macOS refuses for a group of processes that have ended
        pass


if __name__ == "__main__":
    main(*sys.argv[1:])
