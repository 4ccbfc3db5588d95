"""Effects of a scene: the change and the time of each, from one baseline and one run with that effect changed.

The baseline is the best way to run the scene: what it declares, and projection against drift. Baumgarte's terms are one
of the effects. Differences are to the baseline of the same engine, in motion, events, driving effort, engine time and
counters. A run that an engine refuses or cannot finish without an effect is a row with its reason.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.bench.participants import extent
from stiction.comparisons.bench.participants import variants as all_variants
from stiction.comparisons.bench.presentation import (
    Column,
    Presentation,
    Row,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.bench.timing.intervals import ratio_interval
from stiction.comparisons.bench.timing.visits import Timing
from stiction.comparisons.bench.variants import Record, Variant, scaled
from stiction.comparisons.measures.accuracy import graph, is_known
from stiction.comparisons.measures.distances import l1
from stiction.comparisons.measures.work_precision import (
    TOTAL,
    Timed,
    TimedRun,
    cost_of,
    timed_comparison,
)
from stiction.engines.protocol import EVENTS_LOCATED_BY, Supplier
from stiction.engines.reference.engine import SETTINGS
from stiction.engines.status import Status
from stiction.reference_impl.multibody.equation_summary import blocks, hlcp_size
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.model import Baumgarte
from stiction.uncertain import with_ends

BASELINE = "all effects, projection"
PROJECTED = "projection"
PROJECTION: Mapping[str, Any] = {"stabilization": {"method": PROJECTED}}
NO_STABILIZATION, BAUMGARTE = "no stabilization", "Baumgarte"
REFERENCE = Variant("reference", "reference", "rtol", (1e-9,))
"""The reference with the stabilization that an effect sets."""
PAPERS = Baumgarte(method="baumgarte", alpha=90, beta=10)
"""Terms of Zhuang & Wang 2014, for scenes that declare none."""
LEFT_OUT, PAIRS = "blocks_left_out", "hlcp_pairs"
EFFECT_KIND, WITHOUT = "effect_kind", "effect_left_out"
RATIO, LOW, HIGH = (f"engine_time_ratio{end}" for end in ("", "_low", "_high"))
"""Ratio of times inside the engine's own calls, which are all of the reference's, and the ends of its interval."""
LARGEST_ERROR = 1e-3
"""m; the largest error at which times to equal errors are compared."""
BY_EVENTS: Mapping[str, Any] = {name: SETTINGS[name] for name in ("method", "solver")}
"""Settings of the reference's runs whose times to equal errors are compared, one stabilization with another."""
NAMED = 3
"""Effects in the answer, at most: those without which a scene is fastest."""
NOTHING: Mapping[str, object] = {
    "faster": [],
    "baumgarte_at_equal_error": None,
    "baumgarte_at_same_tolerance": [],
    "smallest_problem": None,
}
"""Rows where no time is known."""
MOTION = "position_change"
KINDS = ("slip", "stick", "reversal", "corner")


class EffectKind(StrEnum):
    """What an `Effect` changes."""

    BASELINE = "baseline"
    LEFT_OUT = "left out"
    """The scene does without one of its effects."""
    UNSTABILIZED = "unstabilized"
    BAUMGARTE = "Baumgarte"
    SETTING = "setting"
    """A setting of an engine."""


@dataclass(frozen=True)
class Effect:
    """A change of a scene, by overrides of `stiction.scenes.vary`, or of an engine's settings.

    `kind` tells what is changed; `left_out` is the effect that the scene does without, in words.
    """

    name: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    kind: EffectKind = EffectKind.SETTING
    left_out: str = ""


def toggles(scene: Scene) -> Iterator[Effect]:
    """The baseline; the scene without each effect that it declares; other stabilizations than projection."""
    yield Effect(BASELINE, PROJECTION, kind=EffectKind.BASELINE)
    guides, frictional = scene.guides, scene.frictional_guides
    removed = (
        ("gravity", "", ["gravity"] if scene.gravity and any(scene.gravity) else []),
        (
            "friction",
            "",
            [
                f"{name}.{key}"
                for name, joint in scene.frictional_joints.items()
                for key in ("mu", "mus", "friction", "static_friction")
                if getattr(joint, key, None) is not None
            ],
        ),
        (
            "static coefficient",
            "mus = mu",
            [
                f"{name}.mus"
                for name, guide in frictional.items()
                if guide.static_coefficient > guide.kinetic_coefficient
            ]
            + [
                f"{name}.static_friction"
                for name, joint in scene.frictional_joints.items()
                if joint.bounds[1] > joint.bounds[0]
            ],
        ),
        (
            "surface levers",
            "width",
            [f"{name}.width" for name, guide in frictional.items() if guide.width],
        ),
        (
            "corner forces",
            "length, width",
            [
                f"{name}.{key}"
                for name, guide in guides.items()
                for key in ("length", "width")
                if getattr(guide, key) is not None
            ],
        ),
        ("drive", "", [f"drives.{name}" for name in scene.drives]),
        (
            "spring",
            "",
            [
                f"springs.{name}.stiffness"
                for name, spring in scene.springs.items()
                if spring.stiffness
            ],
        ),
        (
            "damper",
            "",
            [f"springs.{name}.damping" for name, spring in scene.springs.items() if spring.damping]
            + [f"joints.{name}.damping" for name, joint in scene.joints.items() if joint.damping],
        ),
        ("load", "", [f"forces.{name}" for name in scene.forces]),
    )
    for effect, how, keys in removed:
        if keys:
            name = f"no {effect} ({how})" if how else f"no {effect}"
            yield Effect(
                name,
                {**PROJECTION, **dict.fromkeys(keys)},
                kind=EffectKind.LEFT_OUT,
                left_out=effect,
            )
    terms = scene.stabilization if isinstance(scene.stabilization, Baumgarte) else PAPERS
    yield Effect(
        NO_STABILIZATION, {"stabilization": {"method": "none"}}, kind=EffectKind.UNSTABILIZED
    )
    yield Effect(
        f"{BAUMGARTE} (alpha = {terms.alpha:g}, beta = {terms.beta:g})",
        {"stabilization": {"method": "baumgarte", "alpha": terms.alpha, "beta": terms.beta}},
        kind=EffectKind.BAUMGARTE,
    )


def effects_variants(engines: Sequence[str] = ()) -> tuple[Variant, ...]:
    """The reference at rtol 1e-9, and the variants of the engines named at the middle of their refinement series."""
    others = (variant for variant in all_variants(engines) if variant.engine != "reference")
    return REFERENCE, *(
        replace(variant, ladder=(variant.ladder[len(variant.ladder) // 2],)) for variant in others
    )


def effects_comparison(
    scene: Scene,
    variants: Sequence[Variant] = (REFERENCE,),
    *,
    t_end: float | None = None,
    repeats: int = 5,
) -> Comparison[Timed]:
    """One row per variant and effect; arguments as of `stiction.comparisons.measures.work_precision.work_precision`.

    Engine times are medians; their ratio to the baseline's has an interval, from the ratios of each round. Differences
    are the largest over all bodies and the output instants that both runs have; that of the effort is the mean of
    |difference| over time, of the scene's first drive.
    """
    runs, effects = list[TimedRun](), list[Effect]()
    for variant in scaled(variants, scene, t_end):
        own = (Effect(name, PROJECTION, settings) for name, settings in variant.effects.items())
        changed = (*toggles(scene), *own)
        effects += changed
        runs += [
            TimedRun(
                vary(scene, effect.overrides),
                variant,
                variant.ladder[0],
                effect.name,
                effect.settings,
            )
            for effect in changed
        ]
    drive = next(iter(scene.drives), None)

    def rows(
        records: Sequence[Record], timings: Sequence[Timing | None]
    ) -> Iterator[dict[str, Any]]:
        baselines = {
            run.variant.label: timing for run, timing in zip(runs, timings) if run.name == BASELINE
        }
        assembled = [block.name for block in blocks(runs[0].scene) if block.elements]
        for run, effect, record, timing in zip(runs, effects, records, timings):
            there = {block.name for block in blocks(run.scene) if block.elements}
            yield {
                **record.describe(),
                "effect": run.name,
                EFFECT_KIND: str(effect.kind),
                WITHOUT: effect.left_out or None,
                LEFT_OUT: ", ".join(name for name in assembled if name not in there),
                PAIRS: hlcp_size(run.scene),
                **_events(record.trajectory),
                **_changes(timing, baselines[run.variant.label], drive),
                **cost_of(timing),
            }

    return timed_comparison(scene, runs, t_end, repeats, rows)


def _events(trajectory: Trajectory | None) -> dict[str, Any]:
    """Number of events by kind and the first one; empty for an engine that locates none."""
    if trajectory is None or trajectory.settings.get(EVENTS_LOCATED_BY) == Supplier.NOBODY:
        return {}
    count = Counter(event.kind for event in trajectory.events)
    return {
        **{f"{kind}_events": count[kind] for kind in KINDS},
        "first_event": trajectory.events[0].time if trajectory.events else None,
    }


def _changes(timing: Timing | None, baseline: Timing | None, drive: str | None) -> dict[str, Any]:
    """Largest effort, and differences from the baseline where there is one."""
    row: dict[str, Any] = {}
    if timing is None:
        return row
    run, effort = timing.trajectory, f"{drive}.effort"
    if is_known(run, effort):
        row["largest_effort"] = float(np.max(np.abs(graph(run, effort).values)))
    if baseline is None:
        return row
    other = baseline.trajectory
    common = min(len(run.t), len(other.t))
    t = run.t[:common]
    if common < 2 or not np.array_equal(t, other.t[:common]):
        return {
            **row,
            "status": Status.FAILED,
            "reason": "output instants differ from those of the run with all effects, "
            "which has the same settings",
        }
    for label, suffixes in ((MOTION, ("x", "y")), ("velocity_change", ("vx", "vy"))):
        row[label] = max(
            float(np.max(np.abs(run[name][:common] - other[name][:common])))
            for name in run.columns
            if name.rpartition(".")[2] in suffixes and name in other
        )
    if is_known(run, effort) and is_known(other, effort):
        a, b = graph(run, effort), graph(other, effort)
        row["effort_change"] = l1(a, b).value / float(t[-1] - t[0])
    row["time_compared"] = float(t[-1])
    ratio = ratio_interval(
        *([sample.own_s for sample in each.samples] for each in (timing, baseline))
    )
    return row | {RATIO: ratio.value, LOW: ratio.low, HIGH: ratio.high}


def plan(scope: Scope) -> Comparison[Tables]:
    """The effects of the first scene, of the reference; with one scene, of the engines that are named as well."""
    named = scope.engines or () if len(scope.scenes) == 1 else ()
    found = effects_comparison(
        scope.scenes[0],
        effects_variants(named),
        t_end=scope.t_end,
        repeats=scope.repeats or extent(scope.depth).repeats,
    )
    return found.then(lambda timed: timed.as_tables("effects"))


def present(results: Results) -> Presentation:
    """Engine time of the scene without each effect over the baseline's, and the other changes that go with it."""
    table = results.table("effects")
    failed = _failed(table) if len(table) else []
    if RATIO not in table or not (table[EFFECT_KIND] == EffectKind.BASELINE).any():
        return Presentation(rows={**NOTHING, "failed": failed} if failed else {})
    own = table[
        (table["engine"] == REFERENCE.engine)
        & (table[EFFECT_KIND] != EffectKind.BASELINE)
        & table[RATIO].notna()
    ]
    removed = own[own[EFFECT_KIND] == EffectKind.LEFT_OUT]
    # what cannot be told from the time of the baseline saves none
    faster = removed[removed[HIGH] < 1].sort_values(RATIO)
    baumgarte = own.index[own[EFFECT_KIND] == EffectKind.BAUMGARTE]
    rows = {
        "faster": [row_of("effects", table, label) for label in faster.index[:NAMED]],
        "baumgarte_at_equal_error": _at_equal_error(
            results.table("equal-error"), _by_stabilization(results.table("cost"))
        ),
        "largest_error": LARGEST_ERROR,
        "baumgarte_at_same_tolerance": [row_of("effects", table, label) for label in baumgarte],
        "smallest_problem": _smallest_problem(table, faster),
        "failed": failed,
    }
    return Presentation(rows=rows, tables=_tables(table))


def _failed(table: pd.DataFrame) -> list[dict[str, object]]:
    """The effects with which a run failed, by variant; engines that are not installed are none of them."""
    failures = table[~table["status"].isin([Status.OK, Status.MISSING])]
    return [
        {"variant": variant, "effects": list(runs["effect"])}
        for variant, runs in failures.groupby("variant", sort=False)
    ]


def _by_stabilization(cost: pd.DataFrame) -> dict[str, str]:
    """Variants of the event-driven reference, by the method of stabilization that their runs state."""
    found: dict[str, str] = {}
    if not {"engine", "variant", "settings"} <= set(cost):
        return found
    own = cost[(cost["engine"] == REFERENCE.engine) & cost["settings"].notna()]
    for variant, settings in zip(own["variant"], map(json.loads, own["settings"])):
        if all(settings.get(name) == value for name, value in BY_EVENTS.items()):
            stated = settings.get("stabilization")
            method = stated["method"] if isinstance(stated, Mapping) else stated
            found.setdefault(str(method), variant)
    return found


def _at_equal_error(
    equal: pd.DataFrame, by_stabilization: Mapping[str, str]
) -> dict[str, float] | None:
    """The least and the largest ratio of the times of Baumgarte's terms and of projection, over scenes and errors."""
    baumgarte, projection = map(by_stabilization.get, (PAPERS.method, PROJECTED))
    if equal.empty or baumgarte is None or projection is None:
        return None
    times = equal[
        (equal["quantity"] == "position")
        & (equal["error"] <= LARGEST_ERROR)
        & equal[TOTAL].notna()
        & ~equal["is_bound"].eq(True)
    ].pivot(index=["scene", "error"], columns="variant", values=TOTAL)
    if not {baumgarte, projection} <= set(times):
        return None
    ratios = (times[baumgarte] / times[projection]).dropna()
    return None if ratios.empty else {"least": ratios.min(), "largest": ratios.max()}


def _smallest_problem(table: pd.DataFrame, faster: pd.DataFrame) -> dict[str, Row] | None:
    """The run without the effect that makes the HLCP largest, of those that are faster without it, and the baseline."""
    if LEFT_OUT not in faster:
        return None
    sized = faster[faster[LEFT_OUT].fillna("") != ""]
    if sized.empty:
        return None
    is_baseline = table[EFFECT_KIND] == EffectKind.BASELINE
    return {
        "run": row_of("effects", table, sized.sort_values([PAIRS, RATIO]).index[0]),
        "baseline": row_of(
            "effects", table, table.index[is_baseline & (table["engine"] == REFERENCE.engine)][0]
        ),
    }


def _tables(table: pd.DataFrame) -> list[TableView]:
    ratios = [
        "" if pd.isna(ratio) else with_ends(ratio, low, high, is_single=low == high)
        for ratio, low, high in zip(table[RATIO], table[LOW], table[HIGH])
    ]
    columns = (
        Column("effect"),
        Column("ratio", "engine time / baseline"),
        Column(MOTION),
        Column("stick_events"),
        Column("counter:rhs", "right-hand sides"),
        Column(PAIRS, "HLCP pairs"),
        Column(LEFT_OUT, brief=False),
        Column("velocity_change", brief=False),
        Column("effort_change", brief=False),
        Column("reason", brief=False),
    )
    shown = view(
        "effects",
        table.assign(ratio=ratios),
        columns,
        group="variant" if table["variant"].nunique() > 1 else "",
    )
    every = [Column(name) for name in table if name not in ("settings", "version", "key")]
    return [shown, view("effects-all", table, every, source="effects", in_report=False)]


STUDY = Study(
    "effects",
    "Effects",
    "How much CPU time does each effect in the scene cost?",
    present,
    plan,
    seconds=0.1,
    takes=frozenset({"engines", "t_end", "repeats"}),
    tables={
        "effects": "What each effect of a scene changes, and costs",
    },
)
