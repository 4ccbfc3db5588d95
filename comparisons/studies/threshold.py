"""The stick bands: all values of a parameter, within a range, for which the steady state has a stick phase.

`measures.true_bands` yields the truth. The threshold is the upper end of the interval with stick that contains the
scene's own value, or is next to it. Every engine searches for the threshold and for the other ends, and is asked
whether it sticks at a few values over the whole range (`measures.engine_bands`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import extent, threshold_variants
from stiction.comparisons.bench.runner import Comparison, side_by_side
from stiction.comparisons.bench.study import Scope, Study, Tables, joined, unless_refused
from stiction.comparisons.bench.variants import Variant, has_static_coefficient, truth_key
from stiction.comparisons.measures.engine_bands import (
    main_search,
    measure_bands,
    other_ends,
    scanned_values,
)
from stiction.comparisons.measures.reference_bands import (
    AMPLITUDE,
    Variation,
    bands_from_own_start,
    usual_end,
    variation_of,
)
from stiction.comparisons.measures.settling import (
    NoCommonPeriod,
    common_period,
    excitation_period,
)
from stiction.comparisons.measures.true_bands import (
    TrueBands,
    is_slider_bar,
    true_bands,
    unknown_bands,
)
from stiction.comparisons.studies.threshold_presentation import present
from stiction.comparisons.studies.threshold_tables import (
    BANDS,
    MAP,
    band_table,
    map_table,
    threshold_table,
)
from stiction.engines.isolation import Outcome, Task
from stiction.engines.status import Status
from stiction.scenes import Scene, vary
from stiction.truths.bands import Band
from stiction.truths.physics import physics_of, physics_over_values
from stiction.truths.proof.truth import threshold_of_theorem

LOCATED_WIDTH = 1e-9
"""Width of the bracket of an engine with located events, in the unit of the parameter."""
BRACKET_RANGE = 12.0
"""N; range to which the width of a bracket of `depth.Extent` refers. For other parameters it is the same part of their
range."""
DEFAULT_VALUES = 60
"""Values in the range at the default depth of `stiction validate`, which has many other studies to make."""
SCAN_VALUES = 8
"""Values from end to end of the range, besides the middles of the bands, at which an engine is asked whether it sticks
at full depth: some runs at its coarsest step, which cost less than one bracket."""
COEFFICIENT = "mu"
"""Parameter over which bands are mapped."""
MAP_FACTORS = tuple(np.linspace(1 / 6, 7 / 6, 13))
"""Values of the map in units of the scene's own: for the paper's mu = 0.03 from 0.005 to 0.035 by 0.0025."""
TRUTH = "threshold truth"
"""Name of the comparison that `plan` requires."""

TruthByScene = Mapping[str, Mapping[bool, TrueBands]]
"""True bands by the name of the scene, and by whether the static coefficient is one of its own."""


def variation_in(scope: Scope, scene: Scene) -> Variation:
    """Return what the study varies in a scene, by the options of the command.

    Raises
    ------
    InputError
        As `variation_of`; NoCommonPeriod if loads and drives are neither constant nor periodic, so that no motion but
        rest is a steady state.
    """
    options = scope.options
    variation = variation_of(
        scene,
        options.get("parameter"),
        options.get("joint"),
        options.get("range"),
        options.get("resolution"),
    )
    # A law may be a table that has come to its end when the steady state is looked for.
    excitation_period(scene, usual_end(scene) / 3)
    if scope.depth != Depth.DEFAULT or "resolution" in options:
        return variation
    searched = variation.searched
    resolution = (searched.high - searched.low) / DEFAULT_VALUES
    return replace(variation, searched=replace(searched, resolution=resolution))


def check(scope: Scope) -> None:
    """Raise InputError if one of the examined scenes has no bands to search for."""
    for scene in scope.leading_scenes:
        variation_in(scope, scene)


def reason_against(scope: Scope) -> str:
    """Return why a campaign does not make the study, with the command that searches over another number."""
    if "parameter" not in scope.options:
        for scene in scope.leading_scenes:
            has_joint = scene.frictional_guides or scene.frictional_joints
            if has_joint and AMPLITUDE not in scene.parameters:
                return (
                    f"the scene has no parameter {AMPLITUDE}; `stiction compare threshold SCENE --parameter KEY "
                    "--range LOW:HIGH` searches over any other of its numbers"
                )
    return unless_refused(check)(scope)


def true_thresholds(scope: Scope) -> Comparison[TruthByScene]:
    """Return the true bands of each scene, for the physics with and without a static coefficient of its own.

    Raises
    ------
    InputError
        As `variation_in`.
    """
    scenes = scope.leading_scenes
    variants = threshold_variants(scope.engines, scope.depth)
    is_one_compared = not all(map(has_static_coefficient, variants))
    parts = [
        _truth_of_scene(scene, variation_in(scope, scene), is_one_compared) for scene in scenes
    ]

    def by_scene(truths: list[dict[bool, TrueBands]]) -> TruthByScene:
        return {scene.name: truth for scene, truth in zip(scenes, truths, strict=True)}

    return side_by_side(parts, by_scene)


def _truth_of_scene(
    scene: Scene, variation: Variation, is_one_compared: bool
) -> Comparison[dict[bool, TrueBands]]:
    """Return the true bands of a scene; a computation that failed has no bands, and its reason.

    `is_one_compared`: whether there is a method with one coefficient of friction. Without one, nothing is compared with
    the bands for mus = mu, and the scene does not have them.
    """
    # Where both physics are the same, as in a scene without a static coefficient, one is enough.
    physics = {True: scene}
    if is_one_compared and physics_of(scene, False) != scene:
        physics[False] = physics_over_values(scene, False)
    tasks = []
    for has_mus, varied in physics.items():
        proven = threshold_of_theorem(varied) if is_slider_bar(varied) else None
        label = f"threshold/{truth_key(scene.name, has_mus)}/truth"
        tasks.append(Task(label, true_bands, (varied, variation, proven)))

    def tabulate(outcomes: Sequence[Outcome]) -> dict[bool, TrueBands]:
        bands = {
            has_mus: outcome.value or unknown_bands(f"{outcome.status}: {outcome.reason}")
            for has_mus, outcome in zip(physics, outcomes, strict=True)
        }
        if not is_one_compared:
            return bands
        return {False: bands.get(False, bands[True]), True: bands[True]}

    return Comparison(tuple(tasks), tabulate)


def plan(scope: Scope) -> Comparison[Tables]:
    """Return the searches of every engine on each scene, along the engine's refinement series.

    The first search begins at the scene's own value, finer ones at the variant's own coarser bracket. Only the range of
    a search uses the truth. Each ends with a bracket of the depth's width (with located events: `LOCATED_WIDTH`). The
    bracket is the variant's own: it was seen to stick at one end and not at the other.
    """
    truths: TruthByScene = scope.known[TRUTH]
    variants = threshold_variants(scope.engines, scope.depth)
    parts = [
        _SceneSearch(scene, variation_in(scope, scene), variants, truths[scene.name], scope.depth)
        for scene in scope.leading_scenes
    ]
    return side_by_side([part.comparison() for part in parts], joined)


@dataclass(frozen=True)
class _SceneSearch:
    """The searches of all engines on a scene.

    Attributes
    ----------
    scene : Scene
    variation : Variation
        What is varied.
    variants : tuple of Variant
        Engines with their refinement series.
    true : Mapping
        True bands, by whether the static coefficient is one of its own.
    depth : Depth
        It determines the width of brackets, the values of the scan, and whether there is a map.
    """

    scene: Scene
    variation: Variation
    variants: tuple[Variant, ...]
    true: Mapping[bool, TrueBands]
    depth: Depth

    def comparison(self) -> Comparison[Tables]:
        """Return the runs, and the tables of `threshold_tables` that follow from them."""
        reason = reason_against_engines(self.scene)
        tasks = [] if reason else [self._engine_task(variant) for variant in self.variants]
        mapped = self._map_tasks()

        def tabulate(outcomes: Sequence[Outcome]) -> Tables:
            of_engines, of_map = list(outcomes[: len(tasks)]), outcomes[len(tasks) :]
            if reason:
                of_engines = [
                    Outcome(variant.label, Status.REFUSED, reason=reason)
                    for variant in self.variants
                ]
            about = self.scene, self.variation
            return Tables(
                {
                    "threshold": threshold_table(*about, self.variants, of_engines, self.true),
                    BANDS: band_table(*about, self.variants, of_engines, self.true),
                    MAP: map_table(*about, list(mapped), of_map),
                }
            )

        used = self.variants if tasks else ()
        return Comparison((*tasks, *mapped.values()), tabulate, used)

    def _engine_task(self, variant: Variant) -> Task:
        """Return the searches of a variant."""
        has_mus = has_static_coefficient(variant)
        bands = self.true[has_mus].bands
        threshold = self.true[has_mus].threshold.F0
        bracket = LOCATED_WIDTH if variant.parameter == "rtol" else self._bracket()
        scanned = SCAN_VALUES if self.depth == Depth.FULL else 0
        arguments = (
            physics_over_values(self.scene, has_mus),
            variant,
            self.variation,
            main_search(bands, self.variation, threshold, bracket),
            other_ends(bands, threshold, bracket),
            scanned_values(bands, self.variation, scanned),
        )
        return Task(f"threshold/{self.scene.name}/{variant.label}", measure_bands, arguments)

    def _bracket(self) -> float:
        """Return the width of a bracket without located events, in the unit of the parameter."""
        width = extent(self.depth).bracket
        if self.variation.parameter == AMPLITUDE:
            return width
        searched = self.variation.searched
        return width * (searched.high - searched.low) / BRACKET_RANGE

    def _map_tasks(self) -> dict[float, Task]:
        """Return the computation of the bands at each coefficient of friction; none at lower depths.

        Only F0 of a scene that has the parameter `COEFFICIENT` is mapped.
        """
        own = self.scene.parameters.get(COEFFICIENT)
        if self.depth != Depth.FULL or self.variation.parameter != AMPLITUDE or not own:
            return {}
        tasks = {}
        for factor in MAP_FACTORS:
            coefficient = factor * own
            label = f"threshold/{self.scene.name}/map {coefficient:.6g}"
            arguments = self.scene, self.variation, coefficient
            tasks[coefficient] = Task(label, map_bands, arguments)
        return tasks


def reason_against_engines(scene: Scene) -> str:
    """Return why no engine is compared on a scene; empty if engines are compared.

    The motion of an engine is looked at over whole periods of loads and drives (`engine_threshold`). If these are
    constant, the period is that of the motion itself, which engines do not locate exactly.
    """
    try:
        common_period(scene)
    except NoCommonPeriod as error:
        return f"engines are compared over a period of loads and drives; {error}"
    return ""


def map_bands(scene: Scene, variation: Variation, coefficient: float) -> tuple[Band, ...]:
    """Return the bands by the reference at a coefficient of friction."""
    return bands_from_own_start(vary(scene, {COEFFICIENT: coefficient}), variation).bands


STUDY = Study(
    "threshold",
    "Stick limit",
    "For which values of a parameter, such as the load amplitude F0, does the slider stick in the steady state?",
    present,
    plan,
    {TRUTH: true_thresholds},
    seconds=10.0,
    takes=frozenset({"engines", "parameter", "range", "joint", "resolution", "scenes"}),
    applies=reason_against,
    tables={
        "threshold": "Stick thresholds",
        BANDS: "Bands with and without stick phases",
        MAP: "Bands over the coefficient of friction",
    },
    stored=(BANDS, "threshold"),
)
