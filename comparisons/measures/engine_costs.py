"""CPU time of one step of each engine, for the tables on the pages of the engines (``make bench-engines``).

The times are measured as described in `bench.timing.visits`. As they depend on the machine, only
their ratios are meaningful elsewhere.
"""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from stiction.comparisons.bench.participants import REFERENCE, cost_variants
from stiction.comparisons.bench.variants import COMMON_STEP, OWN_CPU
from stiction.comparisons.measures.work_precision import work_precision
from stiction.engines.status import Status
from stiction.scenes import Scene, load_scene

SCENE = "slider-bar-case-1"
"""Name of the scene that is simulated."""
PERIOD = 8.0
"""Length of the runs, one period of the motion, s."""
REPEATS = 8
"""Number of timing rounds; the smallest and the largest of eight samples are outside of the
interval."""
HEADER = (
    "| method | version | total | the engine | the rest / its own | error [m] |\n"
    "|---|---|---|---|---|---|"
)
"""Head of the table in Markdown."""


@dataclass(frozen=True)
class StepCost:
    """CPU time of one step of a method.

    Attributes
    ----------
    total_us, own_us : float
        CPU time of a step in total and inside the engine, microseconds.
    position_error : float
        Position error of the run, m.
    timing_note : str
        Restriction of the accuracy of the times; empty if there is none.
    """

    total_us: float
    own_us: float
    position_error: float
    timing_note: str

    @property
    def overhead_ratio(self) -> float:
        """Time outside of the engine divided by the time inside; NaN if the engine reports no time of its own."""
        if self.own_us > 0.0:
            return self.total_us / self.own_us - 1.0
        return math.nan


def main() -> None:
    """Print a description of the machine, and the lines of `engine_costs`."""
    machine = f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} CPUs"
    print(f"{machine}, load {os.getloadavg()[0]:.2f} at the start\n")
    for line in engine_costs(load_scene(SCENE)):
        print(line, flush=True)


def engine_costs(scene: Scene) -> Iterator[str]:
    """Yield the lines of a Markdown table with the CPU time of one step, in total and inside the engine, in us.

    All methods of all engines that have a step size are run with `COMMON_STEP`. Failed runs have
    their reasons instead.
    """
    variants = [
        replace(variant, ladder=(COMMON_STEP,))
        for variant in cost_variants()
        if variant.engine != REFERENCE and variant.parameter == "dt"
    ]
    table = work_precision(scene, variants, t_end=PERIOD, repeats=REPEATS).make().table
    yield (
        f"{scene.name}, {PERIOD:g} s, {1e3 * COMMON_STEP:g} ms: us of CPU a step, "
        f"medians of {table['repeats'].max():.0f} repeats each"
    )
    yield f"\n{HEADER}"
    yield from table_lines(table.to_dict("records"))


def table_lines(runs: Sequence[Mapping[Any, Any]]) -> Iterator[str]:
    """Yield the rows of the table, and the notes to which they refer; `runs` are rows of `work_precision`."""
    number_of_note: dict[str, int] = {}
    for run in runs:
        version = run["version"] if run["status"] == Status.OK else ""
        cost = step_cost(run)
        if cost is None:
            cells = [f"{run['status']}: {run['reason']}", "", "", ""]
        else:
            mark = ""
            if cost.timing_note:
                number = number_of_note.setdefault(cost.timing_note, len(number_of_note) + 1)
                mark = f" ({number})"
            cells = _cells(cost, mark)
        yield f"| {' | '.join([run['variant'], version, *cells])} |"
    yield ""
    for note, number in number_of_note.items():
        yield f"({number}) {note}"


def step_cost(run: Mapping[Any, Any]) -> StepCost | None:
    """Return the cost of a step of a run, a row of `work_precision`; None if the run did not reach its end."""
    if run["status"] != Status.OK or run["reason"]:
        return None
    microseconds_per_step = 1e6 / (PERIOD / COMMON_STEP)
    return StepCost(
        total_us=microseconds_per_step * run["cpu_time"],
        own_us=microseconds_per_step * run[OWN_CPU],
        position_error=run["position_error"],
        timing_note=run["timing"],
    )


def _cells(cost: StepCost, mark: str) -> list[str]:
    """Return the cells of a cost; `mark` refers to the note about its accuracy."""
    ratio = cost.overhead_ratio
    return [
        f"{cost.total_us:.3g}{mark}",
        f"{cost.own_us:.3g}",
        "" if math.isnan(ratio) else f"{ratio:.1f}",
        f"{cost.position_error:.1e}",
    ]


if __name__ == "__main__":
    main()
