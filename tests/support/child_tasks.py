"""What tests have done in child processes. Each child imports this file to find it, so that it imports little."""

import ctypes
import os
import signal
import sys
import time
from pathlib import Path


def product(a, b):
    return a * b


def process_id():
    return os.getpid()


def say_process_id():
    print(os.getpid())
    return os.getpid()


def wait_for(path):
    while not path.exists():
        time.sleep(0.01)


def take_away(begun, go):
    """Say that it has begun, and end with the other file."""
    begun.touch()
    wait_for(go)
    go.unlink()


def note(path, *_):
    """Leave a line: how often a task was really called."""
    with open(path, "a") as file:
        file.write("x")
    return path


def say_and_abort():
    print("banner on standard output")
    os.write(2, b"Aborting due to engine error: mass must be positive\n\tFailed condition: m > 0\n")
    os.abort()


def segfault():
    ctypes.string_at(0)


def leave(code):
    sys.exit(code)


def leave_at_once(code):
    os._exit(code)


def hang():
    while True:
        time.sleep(0.1)


def hang_deaf():
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
    hang()


def announce_and_hang(path):
    Path(path).write_text(str(os.getpid()))
    hang()


def fail(kind, words):
    raise kind(words)


def unpicklable():
    return lambda: None


class Treacherous:
    """Can be pickled, cannot be unpickled."""

    def __reduce__(self):
        return int, ("not a number",)


def burn(seconds):
    start = time.process_time()
    while time.process_time() - start < seconds:
        pass
