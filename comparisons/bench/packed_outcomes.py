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

A checksum precedes the compressed bytes. Damage is therefore found before anything is unpickled.
"""

from __future__ import annotations

import pickle
import zlib

import numpy as np
import pyarrow as pa

from stiction.engines.isolation import Outcome
from stiction.scenes import StictionError

_MARK = b"outcome 3\n"
"""First bytes of this format. Version 1 was a plain pickle without a mark, version 2 had no checksum."""
_CODEC = "zstd"
"""Compression, by its name in pyarrow."""
_WORD_BYTES = 8
"""Size of a word, which is that of a float."""
_CHECKSUM_BYTES = 4
"""Size of the integer that contains the CRC-32 of all bytes after it."""
_SIZE_FIELD_BYTES = 8
"""Size of the integer that contains the uncompressed size, which pyarrow needs for decompression."""


class NotAnOutcome(StictionError):
    """The error of bytes that `pack` has not returned, or that are damaged."""


def pack(outcome: Outcome) -> bytes:
    """Return an outcome as bytes for `unpack`; errors of pickle are raised unchanged."""
    # Protocol 5 passes the data of arrays out of band, that is, separately from the pickle.
    arrays: list[pickle.PickleBuffer] = []
    frame = pickle.dumps(outcome, protocol=5, buffer_callback=arrays.append)
    content = pickle.dumps((frame, [_shuffle(array.raw()) for array in arrays]))
    size = len(content).to_bytes(_SIZE_FIELD_BYTES, "little")
    body = size + pa.compress(content, codec=_CODEC, asbytes=True)
    return _MARK + _checksum(body) + body


def unpack(packed: bytes) -> Outcome:
    """Return the outcome from which `pack` made these bytes.

    Raises
    ------
    NotAnOutcome
        If the bytes are of another version of this format, or damaged.
    """
    if not packed.startswith(_MARK):
        raise NotAnOutcome("found no mark of a run of this version of stiction")
    checksum_end = len(_MARK) + _CHECKSUM_BYTES
    body = packed[checksum_end:]
    if packed[len(_MARK) : checksum_end] != _checksum(body):
        raise NotAnOutcome("found a wrong checksum")
    size = int.from_bytes(body[:_SIZE_FIELD_BYTES], "little")
    content = pa.decompress(body[_SIZE_FIELD_BYTES:], size, codec=_CODEC, asbytes=True)
    frame, arrays = pickle.loads(content)
    return pickle.loads(frame, buffers=[_unshuffle(array) for array in arrays])


def _checksum(body: bytes) -> bytes:
    """Return the CRC-32 of bytes as bytes."""
    return zlib.crc32(body).to_bytes(_CHECKSUM_BYTES, "little")


def _shuffle(content: memoryview) -> bytes:
    """Return the second differences of the words, byte-shuffled; bytes after the last word follow unchanged."""
    end = len(content) // _WORD_BYTES * _WORD_BYTES
    words = np.frombuffer(content[:end], dtype="<u8").copy()
    for _ in range(2):
        words[1:] -= words[:-1].copy()
    return words.view(np.uint8).reshape(-1, _WORD_BYTES).T.tobytes() + bytes(content[end:])


def _unshuffle(content: bytes) -> bytearray:
    """Return the bytes from which `_shuffle` made `content`, as a bytearray so that arrays in it are writable."""
    end = len(content) // _WORD_BYTES * _WORD_BYTES
    shuffled = np.frombuffer(content, dtype=np.uint8, count=end)
    words = np.ascontiguousarray(shuffled.reshape(_WORD_BYTES, -1).T).view("<u8").ravel()
    for _ in range(2):
        words = np.cumsum(words, dtype="<u8")
    return bytearray(words.tobytes() + content[end:])
