"""What each effect of a scene does and costs: one baseline, and one run per effect with that effect changed.

Differences are to the baseline of the same engine, in motion, events, driving effort, CPU time and counters. What an engine
refuses or cannot finish without an effect is a row with its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.campaigns.participants import variants as all_variants
from stiction.comparisons.measures.accuracy import graph, is_known
from stiction.comparisons.measures.distances import l1, sup_at
from stiction.comparisons.studies.work_precision import Timed, TimedRun, cost_of, timed_comparison
from stiction.comparisons.timing.intervals import ratio_interval
from stiction.comparisons.timing.rounds import Timing
from stiction.comparisons.variants import Record, Variant, scaled
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.model import Baumgarte, NoStabilization, Projection

BASELINE = "as declared"
REFERENCE = Variant("reference", "reference", "rtol", (1e-9,))
"""The reference with the stabilization that the scene declares."""
PAPER_VALUES = {"method": "baumgarte", "alpha": 90, "beta": 10}
"""Of Zhuang & Wang 2014, for scenes that declare no Baumgarte parameters."""
KINDS = ("slip", "stick", "reversal", "corner")


@dataclass(frozen=True)
class Effect:
    """A change of a scene: overrides of `stiction.scenes.vary`; without any, the scene as it is. Or a change of an engine's settings."""

    name: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


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
    for kind, name, table in ((NoStabilization, "no stabilization", {"method": "none"}), (Projection, "projection", {"method": "projection"}),
                              (Baumgarte, "Baumgarte (alpha = 90, beta = 10)", PAPER_VALUES)):
        if not isinstance(scene.stabilization, kind):
            yield Effect(name, {"stabilization": table})


def effects_variants(engines: Sequence[str] = ()) -> tuple[Variant, ...]:
    """The reference at rtol 1e-9 and the main job's variants of the engines named, at the middle of their ladders."""
    others = (variant for variant in all_variants(engines) if variant.engine != "reference")
    return REFERENCE, *(replace(variant, ladder=(variant.ladder[len(variant.ladder) // 2],)) for variant in others)


def effects_comparison(scene: Scene, variants: Sequence[Variant] = (REFERENCE,), *, t_end: float | None = None,
                       repeats: int = 5) -> Comparison[Timed]:
    """One row per variant and effect; see `stiction.comparisons.studies.work_precision.work_precision` for the arguments.

    Times are medians. That of a run is compared with the baseline's of the same round, on the engine's own; their ratio has an interval. Differences are the largest over all bodies and the output instants that both runs have;
    that of the effort is the mean of |difference| over time, of the scene's first drive.
    """
    runs = [TimedRun(vary(scene, effect.overrides), variant, variant.ladder[0], effect.name, effect.settings)
            for variant in scaled(variants, scene, t_end)
            for effect in (*toggles(scene), *(Effect(name, settings=settings) for name, settings in variant.effects.items()))]
    drive = next(iter(scene.drives), None)

    def rows(records: Sequence[Record], timings: Sequence[Timing | None]) -> Iterator[dict[str, Any]]:
        baselines = {run.variant.label: timing for run, timing in zip(runs, timings) if run.name == BASELINE}
        for run, record, timing in zip(runs, records, timings):
            yield {**record.describe(), "effect": run.name, **_events(record.trajectory),
                   **_changes(timing, baselines[run.variant.label], drive), **cost_of(timing)}

    return timed_comparison(scene, runs, t_end, repeats, rows)


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
    if is_known(run, effort):
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
    if is_known(run, effort) and is_known(other, effort):
        a, b = graph(run, effort), graph(other, effort)
        row["effort change, L1 mean [N, N m]"] = l1(a, b).value / float(t[-1] - t[0])
    row["time compared [s]"] = float(t[-1])
    ratio = ratio_interval(*([sample.own_s for sample in each.samples] for each in (timing, baseline)))
    return row | {"cpu, of baseline [-]": ratio.value, "cpu, of baseline, low [-]": ratio.low, "cpu, of baseline, high [-]": ratio.high}
