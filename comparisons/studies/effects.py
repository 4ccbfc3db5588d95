"""Each effect of a scene, what it changes and costs: one baseline, and one run per effect with that effect changed.

The baseline is the best way to run the scene: what it declares, and projection against drift. Baumgarte's terms are one of the effects. Differences are to the baseline of the same engine, in motion, events, driving effort, CPU time and counters. What an engine
refuses or cannot finish without an effect is a row with its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.campaigns.participants import extent
from stiction.comparisons.campaigns.participants import variants as all_variants
from stiction.comparisons.measures.accuracy import graph, is_known
from stiction.comparisons.measures.distances import l1, sup_at
from stiction.comparisons.methods import MISSING_ENGINE, called
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import Column, TableView, view
from stiction.comparisons.presentation.traced_text import Number, TracedText, listed, traced, value
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Scope, Study, Tables
from stiction.comparisons.studies.work_precision import Timed, TimedRun, cost_of, timed_comparison
from stiction.comparisons.timing.intervals import ratio_interval
from stiction.comparisons.timing.rounds import Timing
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import Record, Variant, scaled
from stiction.reference_impl.multibody.equation_blocks import blocks, hlcp_size
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.model import Baumgarte

BASELINE = "all effects, projection"
PROJECTION: Mapping[str, Any] = {"stabilization": {"method": "projection"}}
NO_STABILIZATION, BAUMGARTE = "no stabilization", "Baumgarte"
REFERENCE = Variant("reference", "reference", "rtol", (1e-9,))
"""The reference with the stabilization that an effect sets."""
PAPERS = Baumgarte(method="baumgarte", alpha=90, beta=10)
"""Terms of Zhuang & Wang 2014, for scenes that declare none."""
LEFT_OUT, PAIRS = "blocks left out", "HLCP pairs in slip [-]"
RATIO, LOW, HIGH = "cpu, of baseline [-]", "cpu, of baseline, low [-]", "cpu, of baseline, high [-]"
MOTION = "position change [m]"
KINDS = ("slip", "stick", "reversal", "corner")


@dataclass(frozen=True)
class Effect:
    """A change of a scene: overrides of `stiction.scenes.vary`; without any, the scene as it is. Or a change of an engine's settings."""

    name: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


def toggles(scene: Scene) -> Iterator[Effect]:
    """The baseline, then every effect that the scene declares removed, all its elements together, and other stabilizations than projection."""
    yield Effect(BASELINE, PROJECTION)
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
            yield Effect(name, {**PROJECTION, **dict.fromkeys(keys)})
    terms = scene.stabilization if isinstance(scene.stabilization, Baumgarte) else PAPERS
    yield Effect(NO_STABILIZATION, {"stabilization": {"method": "none"}})
    yield Effect(f"{BAUMGARTE} (alpha = {terms.alpha:g}, beta = {terms.beta:g})",
                 {"stabilization": {"method": "baumgarte", "alpha": terms.alpha, "beta": terms.beta}})


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
            for effect in (*toggles(scene), *(Effect(name, PROJECTION, settings) for name, settings in variant.effects.items()))]
    drive = next(iter(scene.drives), None)

    def rows(records: Sequence[Record], timings: Sequence[Timing | None]) -> Iterator[dict[str, Any]]:
        baselines = {run.variant.label: timing for run, timing in zip(runs, timings) if run.name == BASELINE}
        for run, record, timing in zip(runs, records, timings):
            yield {**record.describe(), "effect": run.name, **_left_out(run.scene, runs[0].scene), **_events(record.trajectory),
                   **_changes(timing, baselines[run.variant.label], drive), **cost_of(timing)}

    return timed_comparison(scene, runs, t_end, repeats, rows)


def _left_out(scene: Scene, baseline: Scene) -> dict[str, Any]:
    """Blocks of the equations that the reference assembles for the baseline and not for a scene, as `stiction explain` names them, and the size of its HLCP."""
    there = {block.name for block in blocks(scene) if block.elements}
    return {LEFT_OUT: ", ".join(block.name for block in blocks(baseline) if block.elements and block.name not in there), PAIRS: hlcp_size(scene)}


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
    for label, suffixes in ((MOTION, ("x", "y")), ("velocity change [m/s]", ("vx", "vy"))):
        row[label] = max(sup_at(t, run[name][:common], other[name][:common]).value
                         for name in run.columns if name.rpartition(".")[2] in suffixes and name in other)
    if is_known(run, effort) and is_known(other, effort):
        a, b = graph(run, effort), graph(other, effort)
        row["effort change, L1 mean [N, N m]"] = l1(a, b).value / float(t[-1] - t[0])
    row["time compared [s]"] = float(t[-1])
    ratio = ratio_interval(*([sample.own_s for sample in each.samples] for each in (timing, baseline)))
    return row | {RATIO: ratio.value, LOW: ratio.low, HIGH: ratio.high}


def plan(scope: Scope) -> Comparison[Tables]:
    """The effects of the first scene, of the reference; with one scene, of the engines that are named as well."""
    named = scope.engines or () if len(scope.scenes) == 1 else ()
    found = effects_comparison(scope.scenes[0], effects_variants(named), t_end=scope.t_end, repeats=scope.repeats
                               or extent(scope.depth).repeats)
    return found.then(lambda timed: timed.as_tables("effects"))


def present(results: Results) -> Presentation:
    """CPU time of the scene without each effect in units of the baseline's, and the other changes that go with it."""
    table = results.table("effects")
    if RATIO not in table or not (table["effect"] == BASELINE).any():
        return Presentation(findings=_failed(table))
    own = table[(table["engine"] == "reference") & (table["effect"] != BASELINE) & table[RATIO].notna()]
    removed = own[[_is_removed(effect) for effect in own["effect"]]]
    faster, slower = removed[removed[HIGH] < 1], removed[removed[LOW] > 1]
    terms = own[own["effect"].str.startswith(BAUMGARTE)]
    parts = [traced("{} without {}", value("effects", table, int(row), RATIO, ".2g"), _named(table.at[row, "effect"]))
             for row in faster.sort_values(RATIO).index[:3]]
    parts += [traced("{} with Baumgarte's terms", value("effects", table, int(row), RATIO, ".2g"))
              for row in terms.index]
    answer = traced("Of its CPU time with projection, the scene takes {}.", listed(parts)) if parts else TracedText("")
    findings = [*_promise(table, faster), *_cost_more(table, slower), *_no_difference(removed),
                *_projection(table, own), *_failed(table)]
    notes = ("CPU is in units of the baseline's, which has all effects of the scene and projection against drift. With "
             "its effect the motion changes, too: other events, other accelerations, "
             "so that a scene may take longer without one. Other engines ignore the stabilization of a scene.",)
    return Presentation(answer, tuple(findings), (), (_shown(table), _whole(table)), (), notes)


def _is_removed(effect: str) -> bool:
    """Tell a scene without an effect of its motion from another stabilization or a setting of an engine."""
    return effect.startswith("no ") and effect != NO_STABILIZATION


def _named(effect: str) -> str:
    """``corner forces`` for ``no corner forces (length, width)``."""
    return effect.removeprefix("no ").partition(" (")[0]


def _half_width(row: pd.Series) -> float:
    """Half a symmetric interval that holds that of the ratio."""
    return float(max(row[RATIO] - row[LOW], row[HIGH] - row[RATIO]))


def _share(table: pd.DataFrame, row: int) -> Number:
    """The ratio of CPU times in a row, with its uncertainty."""
    return Number(Uncertain(float(table.at[row, RATIO]), _half_width(table.loc[row])).both(), "effects", RATIO,
                  rows=(row + 1,))


def _promise(table: pd.DataFrame, faster: pd.DataFrame) -> list[TracedText]:
    """The blocks that are not assembled without the effect that makes the HLCP largest, and what that is worth."""
    sized = faster[faster[LEFT_OUT].fillna("") != ""] if LEFT_OUT in faster else faster.iloc[:0]
    if sized.empty:
        return []
    row = int(sized.sort_values([PAIRS, RATIO]).index[0])
    base = int(table.index[(table["effect"] == BASELINE) & (table["engine"] == "reference")][0])
    evaluations = [value("effects", table, at, "rhs [-]", "g") for at in (row, base)]
    pairs = [value("effects", table, at, PAIRS, "g") for at in (base, row)]
    return [traced("Without {}, `stiction explain` leaves out these blocks: {}.", _named(table.at[row, "effect"]),
                   table.at[row, LEFT_OUT]),
            traced("Its HLCP goes from {} to {} pairs, and CPU time to {}, with {} instead of {} right-hand sides. Its "
                   "motion changes by up to {} m.",
                   *pairs, _share(table, row), *evaluations, value("effects", table, row, MOTION))]


def _cost_more(table: pd.DataFrame, slower: pd.DataFrame) -> list[TracedText]:
    parts = [traced("{} without {}", _share(table, int(row)), _named(table.at[row, "effect"])) for row in slower.index]
    return [traced("Leaving an effect out can cost more time, as the motion changes: {}.",
                   listed(parts))] if parts else []


def _no_difference(removed: pd.DataFrame) -> list[TracedText]:
    same = removed[(removed[LOW] <= 1) & (removed[HIGH] >= 1)]
    return [traced("No distinguishable difference in time without: {}.",
                   listed([_named(effect) for effect in same["effect"]]))] if len(same) else []


def _projection(table: pd.DataFrame, own: pd.DataFrame) -> list[TracedText]:
    """The price of projection: the scene without any stabilization."""
    rows = own.index[own["effect"] == NO_STABILIZATION]
    return [traced("Without any stabilization it takes {}; its motion changes by {} m.", _share(table, int(row)),
                   value("effects", table, int(row), MOTION)) for row in rows]


def _failed(table: pd.DataFrame) -> list[TracedText]:
    """The effects of which there is no run, by method."""
    failed = table[~table["status"].isin(["ok", MISSING_ENGINE])] if "status" in table else table
    return [traced("{} failed: {}.", called(variant), listed(list(rows["effect"]))) for variant,
            rows in failed.groupby("variant", sort=False)] if len(failed) else []


def _shown(table: pd.DataFrame) -> TableView:
    """A row per effect, under the names of methods where there are several."""
    frame = table.assign(half=[_half_width(row) for _, row in table.iterrows()])
    columns = (Column("effect"), Column(RATIO, "CPU of baseline", uncertainty="half", interval=True),
               Column(MOTION, "position change", "m"), Column("stick events"),
               Column("rhs [-]", "right-hand sides"), Column(PAIRS, "HLCP pairs"), Column(LEFT_OUT, brief=False),
               Column("velocity change [m/s]", "velocity change", "m/s", brief=False),
               Column("effort change, L1 mean [N, N m]", "effort change, mean", "N, N m", brief=False),
               Column("reason", brief=False))
    several = table["variant"].nunique() > 1
    return view("effects", "The scene without each of its effects, and with other stabilizations than projection. CPU "
                           "time in units of the baseline's, which comes first; "
                "position: largest change of any body.", frame, columns, source="effects", group="variant" if several
                else "")


def _whole(table: pd.DataFrame) -> TableView:
    names = [name for name in table if name not in ("settings", "version", "key")]
    return view("effects-all", "Every run behind the effects.", table, [Column(name) for name in names],
                source="effects", in_report=False)


STUDY = Study("effects", "Effects", "What does a scene cost without each of its effects?", 7, present, plan,
              seconds=0.25,
              takes=frozenset({"engines", "t_end", "repeats"}))
