"""CPU time of one step of each engine, for the tables on the pages of the engines (``make bench-engines``).

The times are measured as described in `bench.timing.visits`. As they depend on the machine, only
their ratios are meaningful elsewhere.
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
"""Name of the scene that is simulated."""
PERIOD = 8.0
"""Length of the runs, one period of the motion, s."""
REPEATS = 8
"""Number of timing rounds; the smallest and the largest of eight samples are outside of the
interval."""


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
    yield "\n| method | version | total | the engine | the rest / its own | error [m] |\n|---|---|---|---|---|---|"
    steps = PERIOD / COMMON_STEP
    number_of_note: dict[str, int] = {}
    for row in table.to_dict("records"):
        version = row["version"] if row["status"] == Status.OK else ""
        cells = [f"{row['status']}: {row['reason']}", "", "", ""]
        if row["status"] == Status.OK and not row["reason"]:
            total_us = 1e6 * row["cpu_time"] / steps
            own_us = 1e6 * row[OWN_CPU] / steps
            mark = ""
            if row["timing"]:
                number = number_of_note.setdefault(row["timing"], len(number_of_note) + 1)
                mark = f" ({number})"
            cells = [
                f"{total_us:.3g}{mark}",
                f"{own_us:.3g}",
                f"{total_us / own_us - 1:.1f}",
                f"{row['position_error']:.1e}",
            ]
        yield f"| {' | '.join([row['variant'], version, *cells])} |"
    yield ""
    for note, number in number_of_note.items():
        yield f"({number}) {note}"


if __name__ == "__main__":
    main()
