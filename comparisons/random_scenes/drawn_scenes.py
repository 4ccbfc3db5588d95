"""Random scenes, judged one by one and counted: what the other modules here do from the command line."""

from __future__ import annotations

import argparse
import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import count, islice

import numpy as np
import pandas as pd

from stiction.child_processes import child_context
from stiction.engines.reference.engine import compile_kernels


@dataclass(frozen=True)
class Verdict:
    """What became of a scene, or of one way to look at it.

    Attributes
    ----------
    outcome : str
        One of the study's.
    detail : str
        What differs, or who stops when and why.
    error : float
        Of `Study.measure`; nan without a comparison.
    about : str
        The scene in words, enough to have it again.
    """

    outcome: str
    detail: str = ""
    error: float = np.nan
    about: str = ""


@dataclass(frozen=True)
class Study:
    """A way to judge random scenes.

    Attributes
    ----------
    module : str
    judge : callable
        ``judge(seed, i, rtols, t_end)``: for each tolerance the verdicts on scene i of a seed. Of a module, so that processes find it.
    outcomes : Mapping[str, str]
        What they mean, best first.
    failing : tuple of str
        Outcomes that no scene may have.
    measure : str
        What `Verdict.error` is, with its unit.
    rtols : tuple of float
    t_end : float
        Seconds.
    """

    module: str
    judge: Callable[[int, int, Sequence[float], float], Sequence[Sequence[Verdict]]]
    outcomes: Mapping[str, str]
    failing: tuple[str, ...]
    measure: str
    rtols: tuple[float, ...]
    t_end: float

    def again(self, seed: int, i: int) -> str:
        """The command that judges scene i of a seed."""
        return f"python -m {self.module} --seed {seed} --first {i} --count 1"

    def table(self, verdicts: Iterable[Verdict]) -> pd.DataFrame:
        """Per outcome the number of verdicts, their share, and the largest error."""
        verdicts = list(verdicts)
        rows = []
        for outcome in self.outcomes:
            errors = [verdict.error for verdict in verdicts if verdict.outcome == outcome]
            rows.append({"outcome": outcome, "number": len(errors), "share": len(errors) / max(len(verdicts), 1),
                         f"largest {self.measure}": max((error for error in errors if np.isfinite(error)), default=np.nan)})
        return pd.DataFrame(rows)

    def judged(self, seed: int, scenes: Iterable[int], rtols: Sequence[float], t_end: float, processes: int = 1,
               seconds: float = np.inf) -> Iterator[Sequence[Sequence[Verdict]]]:
        """The verdicts on scenes in their order, for each tolerance; none is begun after so many seconds."""
        compile_kernels()  # here, lest every process does it
        call, end, scenes = partial(self.judge, seed, rtols=tuple(rtols), t_end=t_end), time.monotonic() + seconds, iter(scenes)
        if processes == 1:
            yield from (call(i) for i in scenes if time.monotonic() < end)
            return
        with ProcessPoolExecutor(processes, child_context()) as pool:
            while time.monotonic() < end and (batch := list(islice(scenes, 16 * processes))):
                yield from pool.map(call, batch)

    def main(self, description: str, arguments: Sequence[str] | None = None) -> int:
        """Judge scenes as the command line says, print what is not best and a table; 1 if one is `failing`."""
        parser = argparse.ArgumentParser(prog=f"python -m {self.module}", description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--count", type=int, help="scenes; 100 if neither this nor --seconds is given")
        parser.add_argument("--seconds", type=float, default=np.inf, help="no scene is begun after them")
        parser.add_argument("--first", type=int, default=0, help="the first scene of the seed")
        parser.add_argument("--seed", type=int, help="a fresh one if not given")
        parser.add_argument("--rtol", type=float, nargs="+", default=list(self.rtols), help="one or more")
        parser.add_argument("--time", type=float, default=self.t_end, help="seconds of each motion")
        parser.add_argument("--processes", type=int, default=2)
        parser.add_argument("--show", type=int, default=20, help="scenes printed of each outcome but the best")
        given = parser.parse_args(arguments)
        number = 100 if given.count is None and given.seconds == np.inf else given.count
        seed = secrets.randbits(32) if given.seed is None else given.seed
        print(f"seed {seed}", flush=True)
        scenes = count(given.first) if number is None else range(given.first, given.first + number)
        best, shown, found = next(iter(self.outcomes)), dict.fromkeys(((rtol, outcome) for rtol in given.rtol for outcome in self.outcomes), 0), []
        for verdicts in self.judged(seed, scenes, given.rtol, given.time, given.processes, given.seconds):
            found.append(verdicts)
            for rtol, of_scene in zip(given.rtol, verdicts):
                for verdict in of_scene:
                    if verdict.outcome != best and shown[rtol, verdict.outcome] < given.show:
                        shown[rtol, verdict.outcome] += 1
                        print(f"rtol {rtol:g}: {verdict.outcome}: {verdict.detail}; {verdict.about}", flush=True)
        failed = False
        for rtol, by_scene in zip(given.rtol, zip(*found)):
            verdicts = [verdict for of_scene in by_scene for verdict in of_scene]
            print(f"\nseed {seed}, {len(found)} scenes of {given.time:g} s, rtol {rtol:g}\n{self.table(verdicts).to_string(index=False)}")
            failed = failed or any(verdict.outcome in self.failing for verdict in verdicts)
        print("\n" + "\n".join(f"{outcome}: {meaning}" for outcome, meaning in self.outcomes.items()))
        return int(failed or not found)
