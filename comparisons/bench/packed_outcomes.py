"""Outcomes as bytes, in less than half the space of a pickle where they hold trajectories; nothing is rounded.

What fills a pickled trajectory are its columns of numbers, which follow smooth curves at equal distances in time. The
bits of a number that a general compressor can save are then those that two neighbours share:

1. Each array's 64-bit words are replaced by their second differences, as integers modulo 2^64. Numbers of one sign and
   similar size are close to each other as integers too, so these differences have leading zeros (or ones). Any bytes
   come back exactly, whatever they mean.
2. The first bytes of all words are put next to each other, then all second bytes, and so on ("byte shuffle", as in
   HDF5 and Parquet's BYTE_STREAM_SPLIT), which makes long runs of the equal leading bytes.
3. Zstandard compresses all of it.
"""

from __future__ import annotations

import pickle

import numpy as np
import pyarrow as pa

from stiction.engines.isolation import Outcome
from stiction.scenes import StictionError

MARK = b"outcome 2\n"
"""Begins the bytes of this format; an earlier one was a pickle and nothing else."""
CODEC = "zstd"
_WORD = 8  # bytes of a number
_SIZE = 8  # bytes for the size before compression, which the codec wants to know


class NotAnOutcome(StictionError):
    """The bytes are not what `pack` makes."""


def pack(outcome: Outcome) -> bytes:
    """Return an outcome as bytes for `unpack`; raises what pickle does if it cannot be pickled."""
    arrays: list[pickle.PickleBuffer] = []
    frame = pickle.dumps(outcome, protocol=5, buffer_callback=arrays.append)
    whole = pickle.dumps((frame, [_shuffled(array.raw()) for array in arrays]))
    return (
        MARK + len(whole).to_bytes(_SIZE, "little") + pa.compress(whole, codec=CODEC, asbytes=True)
    )


def unpack(content: bytes) -> Outcome:
    """Return the outcome of `pack`. Raises NotAnOutcome."""
    if not content.startswith(MARK):
        raise NotAnOutcome("found a run of another version of stiction, or something else")
    rest = content[len(MARK) :]
    try:
        whole = pa.decompress(
            rest[_SIZE:], int.from_bytes(rest[:_SIZE], "little"), codec=CODEC, asbytes=True
        )
        frame, arrays = pickle.loads(whole)
        return pickle.loads(frame, buffers=[_unshuffled(array) for array in arrays])
    except (pa.ArrowException, OSError, MemoryError, pickle.UnpicklingError, EOFError) as error:
        raise NotAnOutcome(f"{type(error).__name__}: {error}") from error


def _shuffled(content: memoryview) -> bytes:
    """Second differences of the words, byte by byte, and what is left behind the last word as it is."""
    end = len(content) // _WORD * _WORD
    words = np.frombuffer(content[:end], dtype="<u8").copy()
    for _ in range(2):
        words[1:] -= words[:-1].copy()
    return words.view(np.uint8).reshape(-1, _WORD).T.tobytes() + bytes(content[end:])


def _unshuffled(content: bytes) -> bytearray:
    """The inverse of `_shuffled`; arrays in it can be written to, as those of a pickle can."""
    end = len(content) // _WORD * _WORD
    shuffled = np.frombuffer(content, dtype=np.uint8, count=end)
    words = np.ascontiguousarray(shuffled.reshape(_WORD, -1).T).view("<u8").ravel()
    for _ in range(2):
        words = np.cumsum(words, dtype="<u8")
    return bytearray(words.tobytes() + content[end:])
