"""How the time of a run is measured, wherever one is: by `validate`, `compare`, every night and in checks.

What is timed is `Engine.run` with start and end as its only output: what it costs is the motion, not the table of it, nor the gate that the run
has passed before. Times are CPU times of this process. The first call is not counted: it loads what has to be loaded. A call is repeated for
`SECONDS` of CPU, so many times at least as asked for and `MOST` times at most; one that takes longer than `LONG` is not repeated.

`stiction.comparisons.studies.work_precision` takes medians, as a user would see them; what is compared with other days takes the shortest, since whatever else
runs on the machine makes a time longer, never shorter. Beside the runs something else can be timed in turns with them, that the
machine disturbs alike: a calibration kernel (`stiction.comparisons.timing.calibration`) or the code before (`stiction.comparisons.timing.older_code`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import process_time
from typing import Any, Generic, TypeVar

from stiction.engines.protocol import Engine
from stiction.scenes import Scene, Trajectory

T = TypeVar("T")

SECONDS, MOST = 0.1, 40
"""CPU seconds for which a call is repeated, and how often at most."""
LONG = 1.0
"""CPU seconds; a call that takes longer is made once."""


@dataclass(frozen=True)
class Repeats(Generic[T]):
    """Of each repeat of a call its result and its CPU seconds, and those of what was timed beside it."""

    results: tuple[T, ...]
    seconds: tuple[float, ...]
    beside: tuple[float, ...]


def bare_run(engine: Engine, scene: Scene, arguments: Mapping[str, Any]) -> Callable[[], Trajectory]:
    """The call that is timed, for arguments of `Engine.simulate` that have passed it once."""
    own = ("t_end", "dt", "rtol", "fidelity", "output_step")
    settings = {name: value for name, value in arguments.items() if name not in own}
    t_end = arguments.get("t_end") or scene.t_end
    return lambda: engine.run(scene, t_end=t_end, dt=arguments.get("dt"), rtol=arguments.get("rtol"), fidelity=arguments.get("fidelity", "joint"),
                              output_step=t_end, settings=settings)


def turns(seconds: float, least: int) -> int:
    """How often a call that takes so many CPU seconds is repeated."""
    return max(least, min(MOST, round(SECONDS / max(seconds, 1e-9))))


def timed(call: Callable[[], T], least: int, beside: Callable[[float], float] | None = None) -> Repeats[T]:
    """Repeat a call.

    Parameters
    ----------
    least
        Repeats at least.
    beside
        Times something else and returns CPU seconds; called before each repeat with the seconds that the call takes.
    """
    result, first = seconds_of(call)
    if first > LONG:
        return Repeats((result,), (first,), () if beside is None else (beside(first),))
    results, seconds, others = [], [], []
    for _ in range(turns(first, least)):
        if beside is not None:
            others.append(beside(first))
        result, spent = seconds_of(call)
        results.append(result)
        seconds.append(spent)
    return Repeats(tuple(results), tuple(seconds), tuple(others))


def seconds_of(call: Callable[[], T]) -> tuple[T, float]:
    """A call's result and its CPU seconds."""
    started = process_time()
    result = call()
    return result, process_time() - started
