"""Command that judges random scenes of a seed again: ``python -m stiction.comparisons.random_scenes STUDY SEED FIRST``.

It prints what is not best, and how many have each outcome; it exits with 1 if one is `failing`.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence

from stiction.comparisons.random_scenes.night_draws import STUDIES


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge scenes as the command line says."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {__package__}", description="Judge random scenes of a seed."
    )
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("seed", type=int)
    parser.add_argument("first", type=int, help="number of the first scene")
    parser.add_argument("count", type=int, nargs="?", default=1)
    given = parser.parse_args(arguments)
    study, counts = STUDIES[given.study], Counter[str]()
    for i, verdict in study.judged(given.seed, given.first, given.count):
        counts[verdict.outcome] += 1
        if verdict.outcome != next(iter(study.outcomes)):
            print(f"{i}: {verdict.outcome}: {verdict.detail}; {verdict.about}", flush=True)
    for outcome, meaning in study.outcomes.items():
        print(f"{counts[outcome]} {outcome}: {meaning}")
    return int(any(counts[outcome] for outcome in study.failing))


if __name__ == "__main__":
    raise SystemExit(main())
