"""Effects of a scene: how motion and CPU time change when the scene does without one of its effects.

The baseline is the most accurate way to run the scene: all effects that it declares, and projection onto the
constraints. Each other run differs from the baseline in one effect, such as gravity, friction or the stabilization.
Its motion, events, driving effort, engine time and counters are compared with those of the baseline of the same
engine. A run that an engine refuses or cannot complete is a row with the reason.
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

from stiction.comparisons.bench.methods import of_first_scene
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
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables, joined
from stiction.comparisons.bench.timing.intervals import ratio_interval
from stiction.comparisons.bench.timing.visits import Timing
from stiction.comparisons.bench.variants import Record, Variant, scaled
from stiction.comparisons.measures.accuracy import (
    KINDS,
    POSITIONS,
    VELOCITIES,
    graph,
    is_known,
)
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
"""Name of the effect that changes nothing but the stabilization."""
PROJECTED = "projection"
"""Stabilization of the baseline, as the setting of the engine names it."""
PROJECTION: Mapping[str, Any] = {"stabilization": {"method": PROJECTED}}
"""Overrides of the baseline."""
NO_STABILIZATION = "no stabilization"
BAUMGARTE = "Baumgarte"
REFERENCE = Variant("reference", "reference", "rtol", (1e-9,))
"""The reference; its stabilization is that of the scene, which the effects set."""
PAPERS = Baumgarte(method="baumgarte", alpha=90, beta=10)
"""Terms of Zhuang & Wang 2014, for scenes that declare none."""
LEFT_OUT = "blocks_left_out"
"""Column: blocks of the equations that the run does without."""
PAIRS = "hlcp_pairs"
"""Column: complementarity pairs of the HLCP."""
EFFECT_KIND = "effect_kind"
"""Column: the `EffectKind` of a run."""
WITHOUT = "effect_left_out"
"""Column: the effect that the scene does without, for readers."""
RATIO = "engine_time_ratio"
"""Column: time inside the engine's own calls, relative to the baseline. For the reference it is the whole time."""
LOW = "engine_time_ratio_low"
"""Column: lower end of the interval of `RATIO`."""
HIGH = "engine_time_ratio_high"
"""Column: upper end of the interval of `RATIO`."""
LARGEST_ERROR = 1e-3
"""Largest position error (m) at which the times to equal errors are compared."""
BY_EVENTS: Mapping[str, Any] = {name: SETTINGS[name] for name in ("method", "solver")}
"""Settings of the runs of the reference that are compared with each other at equal errors."""
NAMED = 3
"""Largest number of effects in the answer: those without which the scene is fastest."""
NOTHING: Mapping[str, object] = {
    "faster": [],
    "baumgarte_at_equal_error": None,
    "baumgarte_at_same_tolerance": [],
    "smallest_problem": None,
    "first_of_several": None,
}
"""Rows for the text if no time is known."""
MOTION = "position_change"
"""Column: largest difference of a position from the baseline, m."""


class EffectKind(StrEnum):
    """What an `Effect` changes."""

    BASELINE = "baseline"
    """Nothing but the stabilization, which is projection."""
    LEFT_OUT = "left out"
    """The scene does without one of its effects."""
    UNSTABILIZED = "unstabilized"
    """The scene has no stabilization."""
    BAUMGARTE = "Baumgarte"
    """The scene has Baumgarte's stabilization."""
    SETTING = "setting"
    """A setting of an engine."""


@dataclass(frozen=True)
class Effect:
    """A change of a scene or of the settings of an engine.

    Attributes
    ----------
    name : str
        Name of the effect in tables.
    overrides : Mapping
        Changes of the scene, as for `stiction.scenes.vary`.
    settings : Mapping
        Changes of the engine's settings.
    kind : EffectKind
        What the effect changes.
    left_out : str
        The effect that the scene does without, for readers; empty for effects of other kinds.
    """

    name: str
    overrides: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    kind: EffectKind = EffectKind.SETTING
    left_out: str = ""


def toggles(scene: Scene) -> Iterator[Effect]:
    """Yield the baseline, the scene without each effect that it declares, and stabilizations other than projection."""
    yield Effect(BASELINE, PROJECTION, kind=EffectKind.BASELINE)
    for effect, manner, keys in _removals(scene):
        if not keys:
            continue
        yield Effect(
            f"no {effect} ({manner})" if manner else f"no {effect}",
            {**PROJECTION, **dict.fromkeys(keys)},
            kind=EffectKind.LEFT_OUT,
            left_out=effect,
        )
    yield Effect(
        NO_STABILIZATION, {"stabilization": {"method": "none"}}, kind=EffectKind.UNSTABILIZED
    )
    terms = scene.stabilization if isinstance(scene.stabilization, Baumgarte) else PAPERS
    yield Effect(
        f"{BAUMGARTE} (alpha = {terms.alpha:g}, beta = {terms.beta:g})",
        {"stabilization": {"method": "baumgarte", "alpha": terms.alpha, "beta": terms.beta}},
        kind=EffectKind.BAUMGARTE,
    )


def _removals(scene: Scene) -> list[tuple[str, str, list[str]]]:
    """Return for each effect its name, the manner of its removal, and the keys of the scene to remove.

    The manner is empty where the name says it. There are no keys if the scene does not declare the effect.
    """
    frictional = scene.frictional_guides
    with_static_friction = [
        name
        for name, guide in frictional.items()
        if guide.static_coefficient > guide.kinetic_coefficient
    ]
    with_static_friction += [
        name for name, pin in scene.pins.items() if pin.friction_radii[1] > pin.friction_radii[0]
    ]
    loaded_pins = {name: pin for name, pin in scene.pins.items() if pin.is_under_load}
    with_static_bound = [
        name
        for name, joint in scene.frictional_joints.items()
        if joint.static_friction is not None and joint.static_friction > (joint.friction or 0.0)
    ]
    static_keys = [
        *(f"{name}.mus" for name in with_static_friction),
        *(f"{name}.static_friction" for name in with_static_bound),
    ]
    speed_keys = _declared_keys(scene.frictional_joints, "stribeck_velocity")
    speed_keys += [
        f"{name}.stribeck_shape"
        for name, joint in scene.frictional_joints.items()
        if joint.stribeck_shape != 1.0
    ]
    friction_keys = _declared_keys(
        scene.frictional_joints, "mu", "mus", "radius", "friction", "static_friction"
    )
    load_keys = [f"{name}.normal_load" for name, guide in frictional.items() if guide.normal_load]
    friction_keys += load_keys
    friction_keys += speed_keys  # a curve of friction without friction is refused
    # a clearance needs both sizes of its slider
    gap_keys = _declared_keys(scene.guides, "clearance")
    gap_keys += [f"{name}.restitution" for name, guide in scene.guides.items() if guide.restitution]
    springs = scene.springs.items()
    damping_keys = [
        *(f"springs.{name}.damping" for name, spring in springs if spring.damping),
        *(f"joints.{name}.damping" for name, joint in scene.joints.items() if joint.damping),
    ]
    return [
        ("gravity", "", ["gravity"] if scene.gravity and any(scene.gravity) else []),
        ("friction", "", friction_keys),
        ("static coefficient", "mus = mu", static_keys),
        ("load across the plane", "normal_load", load_keys),
        ("dependence of friction on speed", "stribeck_velocity", speed_keys),
        (
            "friction of pins under load",
            "mu, mus, radius",
            _declared_keys(loaded_pins, "mu", "mus", "radius"),
        ),
        (
            "surface levers",
            "width",
            [f"{name}.width" for name, guide in frictional.items() if guide.width] + gap_keys,
        ),
        (
            "corner forces",
            "length, width",
            _declared_keys(scene.guides, "length", "width") + gap_keys,
        ),
        ("drive", "", [f"drives.{name}" for name in scene.drives]),
        ("limit of a drive", "", [f"{name}.effort_limit" for name in scene.limited_drives]),
        (
            "one-sided springs",
            "act on both sides",
            [f"springs.{name}.acts" for name in scene.one_sided_springs],
        ),
        (
            "spring",
            "",
            [f"springs.{name}.stiffness" for name, spring in springs if spring.stiffness],
        ),
        ("damper", "", damping_keys),
        ("load", "", [f"forces.{name}" for name in scene.forces]),
    ]


def _declared_keys(joints: Mapping[str, Any], *attributes: str) -> list[str]:
    """Return the keys of those attributes of joints that the scene declares: ``guide.mu``."""
    return [
        f"{name}.{attribute}"
        for name, joint in joints.items()
        for attribute in attributes
        if getattr(joint, attribute, None) is not None
    ]


def effects_variants(engines: Sequence[str] = ()) -> tuple[Variant, ...]:
    """Return the reference at rtol 1e-9, and the variants of some engines at the middle of their refinement series."""
    variants = [REFERENCE]
    for variant in all_variants(engines):
        if variant.engine != REFERENCE.engine:
            middle = variant.ladder[len(variant.ladder) // 2]
            variants.append(replace(variant, ladder=(middle,)))
    return tuple(variants)


def effects_comparison(
    scene: Scene,
    variants: Sequence[Variant] = (REFERENCE,),
    *,
    t_end: float | None = None,
    repeats: int = 5,
) -> Comparison[Timed]:
    """Plan a table with a row per variant and effect.

    Parameters are those of `stiction.comparisons.measures.work_precision.work_precision`. Engine times are medians.
    Their ratio to the baseline's has an interval, which follows from the ratios in each round. Differences of motions
    are the largest over all bodies and the output instants that both runs have; the difference of the effort is the
    mean of |difference| over time, for the first drive of the scene.
    """
    runs, effects = list[TimedRun](), list[Effect]()
    for variant in scaled(variants, scene, t_end):
        own_effects = [
            Effect(name, PROJECTION, settings) for name, settings in variant.effects.items()
        ]
        for effect in (*toggles(scene), *own_effects):
            varied = vary(scene, effect.overrides)
            effects.append(effect)
            runs.append(TimedRun(varied, variant, variant.ladder[0], effect.name, effect.settings))
    drive = next(iter(scene.drives), None)

    def rows(
        records: Sequence[Record], timings: Sequence[Timing | None]
    ) -> Iterator[dict[str, Any]]:
        baselines = {
            run.variant.label: timing
            for run, effect, timing in zip(runs, effects, timings, strict=True)
            if effect.kind == EffectKind.BASELINE
        }
        blocks_of_baseline = _nonempty_blocks(runs[0].scene)
        for run, effect, record, timing in zip(runs, effects, records, timings, strict=True):
            blocks_of_run = _nonempty_blocks(run.scene)
            yield {
                **record.describe(),
                "effect": effect.name,
                EFFECT_KIND: str(effect.kind),
                WITHOUT: effect.left_out or None,
                LEFT_OUT: ", ".join(
                    name for name in blocks_of_baseline if name not in blocks_of_run
                ),
                PAIRS: hlcp_size(run.scene),
                **_events(record.trajectory),
                **_changes(timing, baselines[run.variant.label], drive),
                **cost_of(timing),
            }

    return timed_comparison(scene, runs, t_end, repeats, rows)


def _nonempty_blocks(scene: Scene) -> list[str]:
    """Return the names of the blocks that the equations of motion of a scene have."""
    return [block.name for block in blocks(scene) if block.elements]


def _events(trajectory: Trajectory | None) -> dict[str, Any]:
    """Return the number of events of each kind and the time of the first; empty for an engine that locates none."""
    if trajectory is None or trajectory.settings.get(EVENTS_LOCATED_BY) == Supplier.NOBODY:
        return {}
    count = Counter(event.kind for event in trajectory.events)
    return {
        **{f"{kind}_events": count[kind] for kind in KINDS},
        "first_event": trajectory.events[0].time if trajectory.events else None,
    }


def _changes(timing: Timing | None, baseline: Timing | None, drive: str | None) -> dict[str, Any]:
    """Return the largest effort of a run, and its differences from the baseline unless this failed."""
    if timing is None:
        return {}
    row: dict[str, Any] = {}
    run, effort = timing.trajectory, f"{drive}.effort"
    if is_known(run, effort):
        row["largest_effort"] = float(np.max(np.abs(graph(run, effort).values)))
    if baseline is None:
        return row

    # Runs are compared at the same output instants; one of them may have ended early.
    other = baseline.trajectory
    common = min(len(run.t), len(other.t))
    t = run.t[:common]
    if common < 2 or not np.array_equal(t, other.t[:common]):
        row["status"] = Status.FAILED
        row["reason"] = (
            "output instants differ from those of the run with all effects, "
            "which has the same settings"
        )
        return row
    row[MOTION] = _largest_change(run, other, POSITIONS, common)
    row["velocity_change"] = _largest_change(run, other, VELOCITIES, common)
    if is_known(run, effort) and is_known(other, effort):
        area = l1(graph(run, effort), graph(other, effort))
        row["effort_change"] = area.value / float(t[-1] - t[0])
    row["time_compared"] = float(t[-1])

    ratio = ratio_interval(
        [sample.own_s for sample in timing.samples], [sample.own_s for sample in baseline.samples]
    )
    return row | {RATIO: ratio.value, LOW: ratio.low, HIGH: ratio.high}


def _largest_change(
    run: Trajectory, other: Trajectory, labels: Sequence[str], samples: int
) -> float:
    """Return the largest difference between two runs in the columns of all bodies with some labels."""
    return max(
        float(np.max(np.abs(run[name][:samples] - other[name][:samples])))
        for name in run.columns
        if name.rpartition(".")[2] in labels and name in other
    )


def plan(scope: Scope) -> Comparison[Tables]:
    """Plan the effects of each scene with the reference; of the paper's cases, in their validation, of the first.

    `stiction compare` with a single scene also makes them with the engines of the scope.
    """
    engines: tuple[str, ...] = ()
    if len(scope.scenes) == 1 and scope.engines is not None and not scope.is_campaign:
        engines = scope.engines
    comparisons = [
        effects_comparison(
            scene,
            effects_variants(engines),
            t_end=scope.t_end,
            repeats=scope.repeats or extent(scope.depth).repeats,
        ).then(lambda timed: timed.as_tables("effects"))
        for scene in scope.leading_scenes
    ]
    return side_by_side(comparisons, joined)


def present(results: Results) -> Presentation:
    """Present the engine time of the scene without each effect, relative to the baseline, and other changes."""
    table = results.table("effects")
    failed = _failed(table) if len(table) else []
    if RATIO not in table or not (table[EFFECT_KIND] == EffectKind.BASELINE).any():
        return Presentation(rows={**NOTHING, "failed": failed} if failed else {})
    # The text is about the first scene; the tables contain all of them.
    first = of_first_scene(table)
    own = first[
        (first["engine"] == REFERENCE.engine)
        & (first[EFFECT_KIND] != EffectKind.BASELINE)
        & first[RATIO].notna()
    ]
    without_effect = own[own[EFFECT_KIND] == EffectKind.LEFT_OUT]
    # Only runs that are faster than the baseline beyond the uncertainty of the timing.
    faster = without_effect[without_effect[HIGH] < 1].sort_values(RATIO)
    baumgarte = own.index[own[EFFECT_KIND] == EffectKind.BAUMGARTE]
    rows = {
        "faster": [row_of("effects", table, label) for label in faster.index[:NAMED]],
        "baumgarte_at_equal_error": _at_equal_error(
            results.table("equal-error"), _by_stabilization(results.table("cost"))
        ),
        "largest_error": LARGEST_ERROR,
        "baumgarte_at_same_tolerance": [row_of("effects", table, label) for label in baumgarte],
        "smallest_problem": _smallest_problem(first, faster),
        "first_of_several": first["scene"].iloc[0] if len(first) < len(table) else None,
        "failed": failed,
    }
    return Presentation(rows=rows, tables=_tables(table))


def _failed(table: pd.DataFrame) -> list[dict[str, object]]:
    """Return for each variant the effects with which its run failed; engines that are not installed do not count."""
    failures = table[~table["status"].isin([Status.OK, Status.MISSING])]
    return [
        {"variant": variant, "effects": list(dict.fromkeys(runs["effect"]))}
        for variant, runs in failures.groupby("variant", sort=False)
    ]


def _by_stabilization(cost: pd.DataFrame) -> dict[str, str]:
    """Return the variant of the event-driven reference with each stabilization, from the settings of its runs."""
    variants: dict[str, str] = {}
    if not {"engine", "variant", "settings"} <= set(cost):
        return variants
    own = cost[(cost["engine"] == REFERENCE.engine) & cost["settings"].notna()]
    for variant, text in zip(own["variant"], own["settings"]):
        settings = json.loads(text)
        if any(settings.get(name) != value for name, value in BY_EVENTS.items()):
            continue
        stabilization = settings.get("stabilization")
        if isinstance(stabilization, Mapping):
            stabilization = stabilization["method"]
        variants.setdefault(str(stabilization), variant)
    return variants


def _at_equal_error(
    equal: pd.DataFrame, by_stabilization: Mapping[str, str]
) -> dict[str, float] | None:
    """Return the range, over scenes and errors, of the time with Baumgarte's terms relative to that with projection.

    None if there is no error that both reach.
    """
    baumgarte = by_stabilization.get(PAPERS.method)
    projection = by_stabilization.get(PROJECTED)
    if equal.empty or baumgarte is None or projection is None:
        return None
    is_compared = (
        (equal["quantity"] == "position")
        & (equal["error"] <= LARGEST_ERROR)
        & equal[TOTAL].notna()
        & ~equal["is_bound"].eq(True)
    )
    times = equal[is_compared].pivot(index=["scene", "error"], columns="variant", values=TOTAL)
    if not {baumgarte, projection} <= set(times):
        return None
    ratios = (times[baumgarte] / times[projection]).dropna()
    return None if ratios.empty else {"least": ratios.min(), "largest": ratios.max()}


def _smallest_problem(table: pd.DataFrame, faster: pd.DataFrame) -> dict[str, Row] | None:
    """Return the run with the smallest HLCP of those that are faster without an effect, and the baseline."""
    if LEFT_OUT not in faster:
        return None
    with_fewer_blocks = faster[faster[LEFT_OUT].fillna("") != ""]
    if with_fewer_blocks.empty:
        return None
    smallest = with_fewer_blocks.sort_values([PAIRS, RATIO]).index[0]
    is_baseline = (table[EFFECT_KIND] == EffectKind.BASELINE) & (
        table["engine"] == REFERENCE.engine
    )
    return {
        "run": row_of("effects", table, smallest),
        "baseline": row_of("effects", table, table.index[is_baseline][0]),
    }


def _tables(table: pd.DataFrame) -> list[TableView]:
    """Return the table of effects, and that of all columns of all runs."""
    ratios = [
        "" if pd.isna(ratio) else with_ends(ratio, low, high, is_single=low == high)
        for ratio, low, high in zip(table[RATIO], table[LOW], table[HIGH])
    ]
    several_scenes = [Column("scene")] if len(of_first_scene(table)) < len(table) else []
    columns = (
        *several_scenes,
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
    all_columns = [Column(name) for name in table if name not in ("settings", "version", "key")]
    return [shown, view("effects-all", table, all_columns, source="effects", in_report=False)]


STUDY = Study(
    "effects",
    "Effects",
    "How much CPU time does each effect in the scene cost?",
    present,
    plan,
    seconds=0.1,
    takes=frozenset({"engines", "t_end", "repeats", "scenes"}),
    tables={
        "effects": "What each effect of a scene changes, and costs",
    },
)
