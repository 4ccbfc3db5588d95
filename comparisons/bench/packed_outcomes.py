"""Lossless compression of outcomes to less than half the size of a pickle, if they contain trajectories.

Most of a pickled trajectory consists of columns of floats, sampled from smooth curves at equal time
steps. A general compressor does not recognize that neighbouring floats are similar. Therefore:

1. The 64-bit words of each array are replaced by their second differences, as integers modulo 2^64.
   Floats of the same sign and similar size are similar as integers, too, so these differences begin
   with zero bits (or one bits, if negative). The inverse is exact for arbitrary bytes.
2. The first bytes of all words are stored together, then all second bytes, and so on ("byte
   shuffle", as in HDF5 and in Parquet's BYTE_STREAM_SPLIT). Equal leading bytes then form long
   runs.
3. Zstandard compresses the result.
"""

from __future__ import annotations

import pickle

import numpy as np
import pyarrow as pa

from stiction.engines.isolation import Outcome
from stiction.scenes import StictionError

MARK = b"outcome 2\n"
"""First bytes of this format; version 1 was a plain pickle, without a mark."""
CODEC = "zstd"
"""Compression, by its name in pyarrow."""
_WORD = 8
"""Bytes of a word, which is the size of a float."""
_SIZE = 8
"""Bytes of the integer that holds the uncompressed size, which pyarrow needs for decompression."""


class NotAnOutcome(StictionError):
    """The error of bytes that `pack` has not returned, or that are damaged."""


def pack(outcome: Outcome) -> bytes:
    """Return an outcome as bytes for `unpack`; errors of pickle are raised unchanged."""
    # Protocol 5 passes the data of arrays out of band, that is, separately from the pickle.
    arrays: list[pickle.PickleBuffer] = []
    frame = pickle.dumps(outcome, protocol=5, buffer_callback=arrays.append)
    content = pickle.dumps((frame, [_shuffle(array.raw()) for array in arrays]))
    size = len(content).to_bytes(_SIZE, "little")
    return MARK + size + pa.compress(content, codec=CODEC, asbytes=True)


def unpack(packed: bytes) -> Outcome:
    """Return the outcome from which `pack` made these bytes; raises NotAnOutcome for other bytes."""
    if not packed.startswith(MARK):
        raise NotAnOutcome("found a run of another version of stiction, or something else")
    body = packed[len(MARK) :]
    size = int.from_bytes(body[:_SIZE], "little")
    try:
        content = pa.decompress(body[_SIZE:], size, codec=CODEC, asbytes=True)
        frame, arrays = pickle.loads(content)
        return pickle.loads(frame, buffers=[_unshuffle(array) for array in arrays])
    except (pa.ArrowException, OSError, MemoryError, pickle.UnpicklingError, EOFError) as error:
        raise NotAnOutcome(f"{type(error).__name__}: {error}") from error


def _shuffle(content: memoryview) -> bytes:
    """Return the second differences of the words, byte-shuffled; bytes after the last word follow unchanged."""
    end = len(content) // _WORD * _WORD
    words = np.frombuffer(content[:end], dtype="<u8").copy()
    for _ in range(2):
        words[1:] -= words[:-1].copy()
    return words.view(np.uint8).reshape(-1, _WORD).T.tobytes() + bytes(content[end:])


def _unshuffle(content: bytes) -> bytearray:
    """Return the bytes from which `_shuffle` made `content`, as a bytearray so that arrays in it are writable."""
    end = len(content) // _WORD * _WORD
    shuffled = np.frombuffer(content, dtype=np.uint8, count=end)
    words = np.ascontiguousarray(shuffled.reshape(_WORD, -1).T).view("<u8").ravel()
    for _ in range(2):
        words = np.cumsum(words, dtype="<u8")
    return bytearray(words.tobytes() + content[end:])
