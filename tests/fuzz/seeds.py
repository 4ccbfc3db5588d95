"""Seeds of the draws: fixed ones in every run of the tests, a fresh one where ``-m long`` draws many.

The fresh seed is the number in the environment variable `FUZZ_SEED`. Where it is not set, `tests/conftest.py` sets it
at random, for all workers of a run alike, and prints it in the header of the run.
"""

from __future__ import annotations

import os

VARIABLE = "FUZZ_SEED"
"""Name of the environment variable."""
BITS = 32
"""Size of a seed that is drawn at random."""


def seed_or_fresh(seed: int | None) -> int:
    """Return a fixed seed, or that of this run where it is None."""
    return int(os.environ[VARIABLE]) if seed is None else seed
