"""What each effect of a scene does and costs: one baseline, and one run per effect with that effect changed.

Differences are to the baseline of the same engine, in motion, events, driving effort, CPU time and counters. What an engine
refuses or cannot finish without an effect is a row with its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from comparisons.accuracy import graph
from comparisons.cost import OUTPUT_STEP, Timing, cost_of, timed_record, timed_run
from comparisons.distances import l1, sup_at
from comparisons.variants import Record, Variant, job, scaled, time_factor
from comparisons.variants import variants as main_variants
from engines.isolation import Isolate, Outcome, Task, isolate
from engines.reference import compile_kernels
from scenes import Scene, Trajectory, vary
from scenes.model import Baumgarte, NoStabilization, Projection

BASELINE = "as declared"
REFERENCE = Variant("reference", "reference", "rtol", (1e-9,))
"""The reference with the stabilization that the scene declares."""
PAPER_VALUES = {"method": "baumgarte", "alpha": 90, "beta": 10}
"""Of Zhuang & Wang 2014, for scenes that declare no Baumgarte parameters."""
KINDS = ("slip", "stick", "reversal", "corner")


@dataclass(frozen=True)
class Effect:
    """A change of a scene: overrides of `scenes.vary`; without any, the scene as it is. Or a change of an engine's settings."""

    name: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


CLEARANCES = {"moreau": (Effect("clearance 0.001 of the size", settings={"clearance": 1e-3}),
                         Effect("clearance 0.01 of the size", settings={"clearance": 1e-2}))}
"""Of engines that have a clearance in their guides: what else it can be than the default."""


def toggles(scene: Scene) -> Iterator[Effect]:
    """The baseline, then every effect that the scene declares removed, all its elements together, and other stabilizations."""
    yield Effect(BASELINE)
    guides, frictional = scene.guides, scene.frictional_guides
    changes = {
        "no gravity": ["gravity"] if scene.gravity and any(scene.gravity) else [],
        "no friction": [f"{name}.{key}" for name, guide in frictional.items() for key in ("mu", "mus")
                        if getattr(guide, key) is not None],
        "no static coefficient (mus = mu)": [f"{name}.mus" for name, guide in frictional.items()
                                             if guide.static_coefficient > guide.mu],
        "no surface levers (width)": [f"{name}.width" for name, guide in frictional.items() if guide.width],
        "no corner forces (length, width)": [f"{name}.{key}" for name, guide in guides.items() for key in ("length", "width")
                                             if getattr(guide, key) is not None],
        "no drive": [f"drives.{name}" for name in scene.drives],
        "no spring": [f"springs.{name}.stiffness" for name, spring in scene.springs.items() if spring.stiffness],
        "no damper": [f"springs.{name}.damping" for name, spring in scene.springs.items() if spring.damping],
        "no load": [f"forces.{name}" for name in scene.forces],
    }
    for name, keys in changes.items():
        if keys:
            yield Effect(name, dict.fromkeys(keys))
    for kind, name, table in ((NoStabilization, "no stabilization", None), (Projection, "projection", {"method": "projection"}),
                              (Baumgarte, "Baumgarte (alpha = 90, beta = 10)", PAPER_VALUES)):
        if not isinstance(scene.stabilization, kind):
            yield Effect(name, {"stabilization": table})


def effects_variants(engines: Sequence[str] = ()) -> tuple[Variant, ...]:
    """The reference at rtol 1e-9 and the main job's variants of the engines named, at the middle of their ladders."""
    others = (variant for variant in main_variants(engines) if variant.engine != "reference")
    return REFERENCE, *(replace(variant, ladder=(variant.ladder[len(variant.ladder) // 2],)) for variant in others)


def effects_table(scene: Scene, variants: Sequence[Variant] = (REFERENCE,), *, t_end: float | None = None, repeats: int = 5,
                  workers: int | None = 1, timeout_s: float = 240.0, on_start: Callable[[int], None] | None = None,
                  on_result: Callable[[Outcome], None] | None = None,
                  on_record: Callable[[Record], None] | None = None, isolated: Isolate = isolate) -> pd.DataFrame:
    """One row per variant and effect; see `comparisons.cost.work_precision` for the arguments.

    Times are medians of the repeats; that of the baseline is compared with on the engine's own. Differences are the largest over all bodies and the output instants that both runs have;
    that of the effort is the mean of |difference| over time, of the scene's first drive.
    """
    compile_kernels()
    chosen = list(toggles(scene))
    runs = [(variant, effect) for variant in scaled(variants, scene, t_end)
            for effect in (*chosen, *(CLEARANCES.get(variant.engine, ()) if scene.guides else ()))]
    tasks = []
    for variant, effect in runs:
        run = job(vary(scene, effect.overrides), variant, variant.ladder[0], t_end=t_end, output_step=OUTPUT_STEP * time_factor(scene, t_end),
                  **effect.settings)
        tasks.append(Task(f"{run.label}/{effect.name}", timed_run, (run.engine, run.scene, dict(run.arguments), repeats)))
    if on_start is not None:
        on_start(len(tasks))
    outcomes = isolated(tasks, workers=workers, timeout_s=timeout_s, on_result=on_result)
    baselines = {variant.label: outcome.value for (variant, effect), outcome in zip(runs, outcomes) if effect.name == BASELINE}
    drive = next(iter(scene.drives), None)
    rows = []
    for (variant, effect), outcome in zip(runs, outcomes):
        timing: Timing | None = outcome.value
        record = timed_record(scene, variant, variant.ladder[0], outcome)
        if on_record is not None:
            on_record(record)
        rows.append({**record.describe(), "effect": effect.name, **_events(record.trajectory),
                     **_changes(timing, baselines[variant.label], drive), **cost_of(timing)})
    return pd.DataFrame(rows)


def _events(trajectory: Trajectory | None) -> dict[str, Any]:
    """Number of events by kind and the first one; empty for an engine that locates none."""
    if trajectory is None or (not trajectory.events and trajectory.engine != "reference"):
        return {}
    count = Counter(event.kind for event in trajectory.events)
    return {**{f"{kind} events": count[kind] for kind in KINDS},
            "first event [s]": trajectory.events[0].time if trajectory.events else None}


def _changes(timing: Timing | None, baseline: Timing | None, drive: str | None) -> dict[str, Any]:
    """Effort, and what differs from the baseline; the part that needs the baseline is empty without one."""
    row: dict[str, Any] = {}
    if timing is None:
        return row
    run, effort = timing.trajectory, f"{drive}.effort"
    if effort in run:
        row[f"{effort}, largest [N, N m]"] = float(np.max(np.abs(graph(run, effort).values)))
    if baseline is None:
        return row
    other = baseline.trajectory
    common = min(len(run.t), len(other.t))
    t = run.t[:common]
    if common < 2 or not np.array_equal(t, other.t[:common]):
        return {**row, "status": "failed", "reason": "output instants differ from those of the run with all effects, which has the same settings"}
    for label, suffixes in (("position change [m]", ("x", "y")), ("velocity change [m/s]", ("vx", "vy"))):
        row[label] = max(sup_at(t, run[name][:common], other[name][:common]).value
                         for name in run.columns if name.rpartition(".")[2] in suffixes and name in other)
    if effort in run and effort in other:
        a, b = graph(run, effort), graph(other, effort)
        row["effort change, L1 mean [N, N m]"] = l1(a, b).value / float(t[-1] - t[0])
    row["time compared [s]"] = float(t[-1])
    row["cpu, of baseline [-]"] = run.cost.own_s / other.cost.own_s if other.cost.own_s else None
    return row
