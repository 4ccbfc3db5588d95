"""Cost of a step of each engine, the table of their pages (``make bench-engines``).

Times are CPU times of the process that did the work, measured by the protocol of `bench.timing.visits`:
medians over rounds that visit all that is compared. They depend on the machine: read the ratios.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from dataclasses import replace

from stiction.comparisons.bench.participants import REFERENCE, cost_variants
from stiction.comparisons.bench.variants import COMMON_STEP, OWN_CPU
from stiction.comparisons.measures.work_precision import work_precision
from stiction.engines.status import Status
from stiction.scenes import Scene, load_scene

SCENE = "slider-bar-case-1"
PERIOD = 8.0
"""Seconds of the runs: one period."""
REPEATS = 8
"""Rounds: the interval leaves out the smallest and the largest sample."""


def main() -> None:
    """Print the machine and `engine_costs`."""
    machine = f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} CPUs"
    print(f"{machine}, load {os.getloadavg()[0]:.2f} at the start\n")
    for line in engine_costs(load_scene(SCENE)):
        print(line, flush=True)


def engine_costs(scene: Scene) -> Iterator[str]:
    """Lines of Markdown for the engines' pages: microseconds of CPU a `COMMON_STEP`, in all and inside the engine.

    Every method of every engine is run at that step, equally often, in turns; where there is no time the reason stands.
    """
    engines = [
        replace(variant, ladder=(COMMON_STEP,))
        for variant in cost_variants()
        if variant.engine != REFERENCE and variant.parameter == "dt"
    ]
    table = work_precision(scene, engines, t_end=PERIOD, repeats=REPEATS).make().table
    yield (
        f"{scene.name}, {PERIOD:g} s, {1e3 * COMMON_STEP:g} ms: us of CPU a step, "
        f"medians of {table['repeats'].max():.0f} repeats each"
    )
    yield "\n| method | version | total | the engine | the rest / its own | error [m] |\n|---|---|---|---|---|---|"
    notes: dict[str, int] = {}
    for row in table.to_dict("records"):
        found = [f"{row['status']}: {row['reason']}", "", "", ""]
        if row["status"] == Status.OK and not row["reason"]:
            total, own = (
                1e6 * row[name] / (PERIOD / COMMON_STEP) for name in ("cpu_time", OWN_CPU)
            )
            mark = f" ({notes.setdefault(row['timing'], len(notes) + 1)})" if row["timing"] else ""
            found = [
                f"{total:.3g}{mark}",
                f"{own:.3g}",
                f"{total / own - 1:.1f}",
                f"{row['position_error']:.1e}",
            ]
        version = row["version"] if row["status"] == Status.OK else ""
        yield f"| {' | '.join([row['variant'], version, *found])} |"
    yield ""
    yield from (f"({number}) {note}" for note, number in notes.items())


if __name__ == "__main__":
    main()
