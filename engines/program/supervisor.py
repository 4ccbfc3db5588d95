"""Program under supervision: whoever started it may be killed at any time, and nothing of the program is left then.

A script by itself, for ``python -I -S``: a killed process cannot clean up behind itself. Arguments: a folder, a file
for what the program prints, the largest size of a file in bytes, and the program with its arguments. The answer on
standard output: exit code (minus the signal that ended the program) and CPU seconds, or ``error`` and why it could not
be started. The end of standard input means that nobody waits or reads any more: all processes of the program's group
are killed, and the folder is removed.
"""

import _thread
import os
import resource
import signal
import sys


class Program:
    """A process that leads a group; its number is its own until it is waited for."""

    def __init__(self, log, command):
        files = [(os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0), (os.POSIX_SPAWN_DUP2, 1, 2)]
        files.insert(1, (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600))
        self.number = os.posix_spawn(command[0], command, os.environ, file_actions=files, setpgroup=0,
                                     setsigdef=[signal.SIGPIPE, signal.SIGXFSZ])  # Python ignores them
        self.ending, self.runs = _thread.allocate_lock(), _thread.allocate_lock()
        self.runs.acquire()

    def wait(self):
        """Wait for its end, end what it has left running, and print the answer."""
        os.waitid(os.P_PID, self.number, os.WEXITED | os.WNOWAIT)
        self.kill_group()
        _, status, used = os.wait4(self.number, 0)
        if self.ending.acquire(False):  # else nobody waits for it
            print(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, flush=True)
        self.runs.release()

    def end(self):
        """Kill it with its group if it runs."""
        if self.ending.acquire(False):
            self.kill_group()
        self.runs.acquire()

    def kill_group(self):
        """Kill all processes of its group, if there are any."""
        try:
            os.killpg(self.number, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):  # macOS refuses for a group of processes that have ended
            pass


def main(folder, log, largest, *command):
    """Run the command, print the answer, and clean up at the end of standard input."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(largest), int(largest)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        program = Program(log, command)
    except OSError as error:
        print("error", error.strerror, flush=True)
    else:
        _thread.start_new_thread(program.wait, ())
        os.read(0, 1)
        program.end()
    os.read(0, 1)
    from shutil import rmtree  # as long to import as all else

    rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
