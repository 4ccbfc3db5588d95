"""Parameters of the scene that a table of results may have been made with instead: friction and weight.

A table that is off may be the exact motion of a scene with another coefficient of friction, with one coefficient where
the scene has two, or with another g. Each of these is a hypothesis with one number or none. The number is fitted: the
error is linear in a small change p of it, r(p) = r - s p with the sensitivity s from two runs of the reference, so that
least squares give p = (s.r)/(s.s) (Gauss-Newton with a secant for the derivative). Then the run with that number
verifies the hypothesis. Nothing is concluded from the linear prediction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stiction.comparisons.measures.result_errors import CONTINUOUS, TURN
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene, StictionError
from stiction.scenes.columns import unit_of
from stiction.scenes.laws import Table
from stiction.scenes.model import Load
from stiction.scenes.result_table import ResultTable
from stiction.truths import Truth

MEDIAN_OF_NORMAL = 0.6745
"""Median of |x| of a normal distribution of deviation 1; of here - (before + behind) / 2 the variance is 1.5."""
INSTANTS = 1001
"""Instants of a table that are compared, at most: a thousand numbers determine one."""
RTOL = 1e-9
"""Tolerance of the runs: below all errors that are explained."""
OFF, LOST = 1e-5, 3.0
"""Errors of a table, in parts of the motion's size (root mean square), between which an explanation is sought: smaller
ones are those of most solvers, and larger ones of a motion that has nothing to do with the scene's."""
ABOVE_NOISE = 10.0
"""Ratio of the error to the table's own noise from which on there is something to explain."""
EXPLAINED, QUIET, LEAST = 1e-2, 1.5, 0.1
"""An explanation leaves at most the first part of the error, or the second times the noise of the table if that is
more, but never more than the last part of the error. A mass, a stiffness or a load that is some per cent off looks like
another friction to a twentieth of the error, and is none."""
ALONE, FITTED = 3.0, 1e-3
"""Factor by which every other explanation is worse than one that is named. Below the second part of the error, and
below a hundredth of `OFF`, what is left says how well a number was fitted, and not which number it was."""
FIRST_CHANGE, SMALLEST_CHANGE = 1e-2, 1e-7
"""Relative changes of a number: the first, by which the sensitivity is found, and that at which the fit ends."""
WINDOWS, ROUNDS = (1 / 16, 1 / 4, 1.0), 4
"""Parts of the table's time over which a number is fitted, one after another, and Gauss-Newton steps in each at most.
Near its beginning a motion is close to linear in a number whose later effect is a change of phase."""
RANGE = (0.1, 10.0)
"""Factors on a parameter that are sought."""
USUAL_G = (9.8, 9.80665, 9.81, 10.0)
"""Values of g in common use, m/s²; one that explains a table as well as the fitted value (`AS_GOOD`) is taken."""
AS_GOOD = 1.2
"""Ratio of what a usual value of g may leave of the error to what the fitted one leaves."""
COLUMNS = [
    "hypothesis",
    "element",
    "factor",
    "value",
    "unit",
    "error before",
    "error after",
    "noise",
    "named",
]


class Hypothesis(Enum):
    """What a table may have been made with instead of the scene's own."""

    ONE_COEFFICIENT = "mus = mu"
    KINETIC = "another mu"
    FRICTION = "another mu and mus"
    GRAVITY = "another g"
    MASS = "another mass"
    STIFFNESS = "another stiffness"
    LOAD = "another load"


RELATED = {Hypothesis.KINETIC, Hypothesis.FRICTION}
"""Hypotheses that are the same where no guide comes to rest: neither stands against the other."""


RIVALS = 12
"""Masses, stiffnesses and loads that are held against an explanation, at most: they are fitted only where there is one,
and the parameters of a large mechanism would take minutes."""


@dataclass(frozen=True)
class Parameter:
    """A hypothesis, and the body, spring or load that it is about; the friction of all guides and g have none."""

    hypothesis: Hypothesis
    element: str = ""

    @property
    def has_number(self) -> bool:
        """True where there is a number to fit."""
        return self.hypothesis is not Hypothesis.ONE_COEFFICIENT


@dataclass(frozen=True)
class Explanation:
    """A hypothesis with the number that fits a table best.

    `factor`: on the scene's coefficients or its g; nan of `ONE_COEFFICIENT`. `value`: the coefficient, where all guides
    have the same, or g in m/s²; else nan. `before`, `after`: root mean square of the errors, in parts of the motion's
    size, of the scene and of the hypothesis. `noise`: that of the table's own scatter from row to row. `is_named`: it
    explains the errors, and no other hypothesis does as well.
    """

    parameter: Parameter
    factor: float
    value: float
    before: float
    after: float
    noise: float
    is_named: bool = False

    @property
    def hypothesis(self) -> Hypothesis:
        return self.parameter.hypothesis

    @property
    def explains(self) -> bool:
        """True where little of the error is left, see `EXPLAINED`."""
        return self.after <= min(
            max(EXPLAINED * self.before, QUIET * self.noise), LEAST * self.before
        )

    def row(self) -> tuple[object, ...]:
        """As a row with `COLUMNS`."""
        unit = {Hypothesis.GRAVITY: "m/s²"}.get(self.hypothesis, "")
        return (
            self.hypothesis.value,
            self.parameter.element,
            self.factor,
            self.value,
            unit,
            self.before,
            self.after,
            self.noise,
            self.is_named,
        )


def explanations(scene: Scene, table: ResultTable, truth: Truth) -> list[Explanation]:
    """Return the hypotheses that the scene allows with what they leave of a table's errors, the best first.

    None where the table is not off, or not in a way that a run could explain, see `OFF`. Of a table that is off some
    ten to a hundred runs of the reference are made.
    """
    # Is there something to explain, and may a run explain it?
    parameters = list(_possible(scene))
    seen = _Seen.of(scene, table, truth) if parameters else None
    own = _motion(scene, seen, float(seen.t[-1])) if seen else None
    if seen is None or own is None:
        return []
    before, noise = seen.size_of(own), seen.noise
    if not max(OFF, ABOVE_NOISE * noise) < before < LOST:
        return []
    # errors below this are those of the fit
    equal = max(noise, FITTED * before, OFF / 100)

    def explained(parameter: Parameter, start: float = 1.0) -> Explanation:
        return _explanation(scene, parameter, seen, before, start)

    ranked = sorted(map(explained, parameters), key=_what_is_left)
    best = ranked[0]
    # of two related ones that do as well the one that changes less is meant
    if (
        len(ranked) > 1
        and {best.hypothesis, ranked[1].hypothesis} == RELATED
        and ranked[1].after < ALONE * max(best.after, equal)
    ):
        best = next(each for each in ranked[:2] if each.hypothesis is Hypothesis.KINETIC)
    if not best.explains:
        return ranked

    # The others again, from the best one's number: none must have failed for want of a start.
    others = []
    for other in ranked:
        if other is best:
            continue
        if other.parameter.has_number and best.parameter.has_number:
            other = min(other, explained(other.parameter, best.factor), key=_what_is_left)
        others.append(other)

    # It is named if no rival does nearly as well. What is never named itself, a mass or a
    # stiffness, is a rival too; it is tried last, as that takes most runs, and not against a value
    # of g in common use.
    rivals = [
        other
        for other in others
        if not (best.hypothesis is Hypothesis.KINETIC and other.hypothesis is Hypothesis.FRICTION)
    ]
    is_usual = best.hypothesis is Hypothesis.GRAVITY and any(
        math.isclose(best.value, g) for g in USUAL_G
    )
    least = ALONE * max(best.after, equal)
    if not is_usual and all(rival.after >= least for rival in rivals):
        never_named = list(map(explained, _not_asked(scene)))
        others, rivals = others + never_named, rivals + never_named
    is_named = all(rival.after >= least for rival in rivals)
    return [replace(best, is_named=is_named), *sorted(others, key=_what_is_left)]


def _what_is_left(explanation: Explanation) -> float:
    return explanation.after


def _explanation(
    scene: Scene, parameter: Parameter, seen: _Seen, before: float, start: float
) -> Explanation:
    """A hypothesis with its number fitted, from a start on."""
    t_end = float(seen.t[-1])
    if not parameter.has_number:
        after = _left(scene, parameter, 1.0, seen, t_end)
        return Explanation(
            parameter, math.nan, _value(scene, parameter, 1.0), before, after, seen.noise
        )
    factor, after = _fitted(scene, parameter, seen, start)
    if parameter.hypothesis is Hypothesis.GRAVITY:
        factor, after = _usual(scene, seen, factor, after)
    return Explanation(
        parameter, factor, _value(scene, parameter, factor), before, after, seen.noise
    )


def _possible(scene: Scene) -> Iterator[Parameter]:
    """The hypotheses that change something in a scene."""
    rubbing = [guide for guide in scene.frictional_guides.values() if guide.static_coefficient > 0]
    if any(guide.static_coefficient > guide.kinetic_coefficient for guide in rubbing):
        yield Parameter(Hypothesis.ONE_COEFFICIENT)
        if any(guide.kinetic_coefficient > 0 for guide in rubbing):
            yield Parameter(Hypothesis.KINETIC)
    if rubbing:
        yield Parameter(Hypothesis.FRICTION)
    if any(scene.gravity or ()):
        yield Parameter(Hypothesis.GRAVITY)


def _not_asked(scene: Scene) -> list[Parameter]:
    """Parameters that are never named, but may explain a table as well as one that would be; none of many."""
    parameters = [
        Parameter(kind, name)
        for kind, names in (
            (Hypothesis.MASS, scene.bodies),
            (Hypothesis.STIFFNESS, scene.springs),
            (Hypothesis.LOAD, scene.forces),
        )
        for name in names
    ]
    return parameters if len(parameters) <= RIVALS else []


def changed(scene: Scene, parameter: Parameter, factor: float) -> Scene:
    """Return the scene of a hypothesis; `factor` multiplies the coefficients of all guides, g, or a mass, .."""
    # Copies of the models: a factor on a valid value needs no validation of the file again.
    hypothesis, name = parameter.hypothesis, parameter.element
    if hypothesis is Hypothesis.MASS:
        body = scene.bodies[name]
        return scene.model_copy(
            update={
                "bodies": {
                    **scene.bodies,
                    name: body.model_copy(update={"mass": factor * body.mass}),
                }
            }
        )
    if hypothesis is Hypothesis.STIFFNESS:
        spring = scene.springs[name]
        return scene.model_copy(
            update={
                "springs": {
                    **scene.springs,
                    name: spring.model_copy(update={"stiffness": factor * spring.stiffness}),
                }
            }
        )
    if hypothesis is Hypothesis.LOAD:
        return scene.model_copy(
            update={"forces": {**scene.forces, name: _scaled_load(scene.forces[name], factor)}}
        )
    if hypothesis is Hypothesis.GRAVITY:
        x, y = scene.gravity or (0.0, 0.0)
        return scene.model_copy(update={"gravity": (factor * x, factor * y)})
    # All guides together; mus never falls below mu.
    joints = dict(scene.joints)
    for name, guide in scene.frictional_guides.items():
        if guide.mu is None:
            continue  # its bound is a constant, which no hypothesis varies
        kinetic, static = guide.kinetic_coefficient, guide.static_coefficient
        if hypothesis is Hypothesis.ONE_COEFFICIENT:
            static = kinetic
        else:
            kinetic *= factor
            static = max(kinetic, static * (factor if hypothesis is Hypothesis.FRICTION else 1.0))
        joints[name] = guide.model_copy(update={"mu": kinetic, "mus": static})
    return scene.model_copy(update={"joints": joints})


def _scaled_load(load: Load, factor: float) -> Load:
    """A load whose law is `factor` times as large at all times."""
    law = load.law
    sizes = ("value", "offset", "rate", "amplitude") if not isinstance(law, Table) else ()
    update: dict[str, object] = {
        name: factor * getattr(law, name) for name in sizes if hasattr(law, name)
    }
    if isinstance(law, Table):
        update["values"] = tuple(factor * value for value in law.values)
    return load.model_copy(update={"law": law.model_copy(update=update)})


def _value(scene: Scene, parameter: Parameter, factor: float) -> float:
    """What is used instead: g in m/s², or the coefficient of all guides where it is the same; else nan."""
    hypothesis = parameter.hypothesis
    if hypothesis not in {Hypothesis.GRAVITY, Hypothesis.ONE_COEFFICIENT, *RELATED}:
        return math.nan
    if hypothesis is Hypothesis.GRAVITY:
        return factor * math.hypot(*(scene.gravity or (0.0, 0.0)))
    values = {
        factor * guide.kinetic_coefficient
        for guide in scene.frictional_guides.values()
        if guide.static_coefficient > 0
    }
    return values.pop() if len(values) == 1 else math.nan


@dataclass(frozen=True)
class _Seen:
    """What a fit looks at: instants (n,), columns with their scales, each (n,), and the noise in these units."""

    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    scales: Mapping[str, float]
    noise: float

    @classmethod
    def of(cls, scene: Scene, table: ResultTable, truth: Truth) -> _Seen | None:
        """Some rows of the columns that do not jump; None where there is none with a truth, or nothing moves."""
        rows = np.unique(np.linspace(0, len(table.t) - 1, INSTANTS).round().astype(int))
        true = truth(table.t[rows])
        names = [
            name for name in table.columns if name in true and name.rpartition(".")[2] in CONTINUOUS
        ]
        units = {name: unit_of(name, scene) for name in names}
        largest: dict[str, float] = {}
        for name in names:
            size = float(np.max(np.abs(true[name] - true[name][0])))
            largest[units[name]] = max(size, largest.get(units[name], 0.0))
        scales = {name: largest[units[name]] for name in names if largest[units[name]] > 0}
        if not scales:
            return None
        columns = {name: np.array(table.columns[name][rows]) for name in scales}
        return cls(table.t[rows], columns, scales, _noise(table, truth, scales))

    def errors(self, motion: Mapping[str, np.ndarray]) -> np.ndarray:
        """Errors of the table's first instants against a motion, in parts of its size, all columns in one array."""
        parts = []
        for name, scale in self.scales.items():
            off = self.columns[name][: len(motion[name])] - motion[name]
            if name.endswith(".angle"):
                off = off - TURN * np.round(off / TURN)
            parts.append(off / scale)
        return np.concatenate(parts)

    def size_of(self, motion: Mapping[str, np.ndarray] | None) -> float:
        """Root mean square of the errors; infinite where there is no motion."""
        return math.inf if motion is None else _rms(self.errors(motion))


def _noise(table: ResultTable, truth: Truth, scales: Mapping[str, float]) -> float:
    """Scatter of a table from row to row, in parts of the motion's size, root mean square over its columns.

    Half the second differences of an error that is smooth are small; those of independent scatter of deviation d have
    the deviation sqrt(1.5) d. Their median does not depend on the few at kinks.
    """
    single = table.last[1:-1]
    if len(single) < 3:
        return 0.0
    middle = np.unique(np.linspace(1, len(single) - 2, INSTANTS).round().astype(int))
    scatter = []
    times = [table.t[single[middle + shift]] for shift in (-1, 0, 1)]
    true = [truth(t) for t in times]
    share = (times[1] - times[0]) / (times[2] - times[0])
    for name, scale in scales.items():
        before, at, behind = (
            table.columns[name][single[middle + shift]] - exact[name]
            for shift, exact in zip((-1, 0, 1), true)
        )
        bend = at - (1 - share) * before - share * behind
        deviation = np.median(np.abs(bend)) / MEDIAN_OF_NORMAL / math.sqrt(1.5)
        scatter.append(deviation / scale)
    return _rms(np.array(scatter))


def _rms(values: np.ndarray) -> float:
    """Root mean square; scaled by the largest, as squares of huge numbers overflow."""
    largest = float(np.max(np.abs(values), initial=0.0))
    return largest * float(np.sqrt(np.mean((values / largest) ** 2))) if largest > 0.0 else 0.0


def _motion(scene: Scene, seen: _Seen, until: float) -> Mapping[str, np.ndarray] | None:
    """The reference's motion of a scene at the instants until one of them; None where it does not get there."""
    t = seen.t[seen.t <= until]
    mechanism = Mechanism(scene, "projection")
    try:
        result = simulate_event_driven(mechanism, *consistent_start(mechanism), t, until, RTOL)
    except StictionError:  # a scene without a consistent start or a motion explains nothing
        return None
    if result.termination != "end":
        return None
    columns = {name: result.columns[name] for name in seen.scales}
    return columns if all(np.isfinite(values).all() for values in columns.values()) else None


def _left(scene: Scene, parameter: Parameter, factor: float, seen: _Seen, until: float) -> float:
    return seen.size_of(_motion(changed(scene, parameter, factor), seen, until))


def _fitted(scene: Scene, parameter: Parameter, seen: _Seen, best: float) -> tuple[float, float]:
    """The factor on a parameter with the smallest error, from a start on, and that error over the whole table."""
    for window in WINDOWS:
        until = float(seen.t[0] + window * (seen.t[-1] - seen.t[0]))
        until = float(seen.t[np.searchsorted(seen.t, until, side="right") - 1])
        if until <= 0.0:
            continue

        def errors(factor: float, until: float = until) -> np.ndarray | None:
            motion = _motion(changed(scene, parameter, factor), seen, until)
            return None if motion is None else seen.errors(motion)

        best = _gauss_newton(errors, best)
    return best, _left(scene, parameter, best, seen, float(seen.t[-1]))


def _gauss_newton(errors: Callable[[float], np.ndarray | None], start: float) -> float:
    """The factor of the smallest sum of squares from a start on; the start where nothing is better."""
    # Two factors with their errors: the secant between them stands for the derivative.
    current, other = start, start * (1 + FIRST_CHANGE)
    r_current, r_other = errors(current), errors(other)
    for _ in range(ROUNDS):
        if r_current is None or r_other is None:
            break
        slope = (r_other - r_current) / (other - current)
        weight = float(slope @ slope)
        if not weight > 0.0:
            break
        # a step from the better of the two
        if r_other @ r_other < r_current @ r_current:
            current, other = other, current
            r_current, r_other = r_other, r_current
        following = float(np.clip(current - slope @ r_current / weight, *RANGE))
        if abs(following - current) <= SMALLEST_CHANGE * current:
            break
        other, r_other = current, r_current
        current, r_current = following, errors(following)
        if r_current is None or r_current @ r_current > r_other @ r_other:
            # no better: half the way, once a round
            current = (following + other) / 2
            r_current = errors(current)
    candidates = [
        (r @ r, factor) for factor, r in ((current, r_current), (other, r_other)) if r is not None
    ]
    return min(candidates)[1] if candidates else start


def _usual(scene: Scene, seen: _Seen, factor: float, after: float) -> tuple[float, float]:
    """The nearest value of g in common use, where it explains as much; else the fitted one."""
    own = math.hypot(*(scene.gravity or (0.0, 0.0)))
    usual = min(USUAL_G, key=lambda g: abs(g / own - factor)) / own
    # the scene's own value has been tried before: it is what does not explain the table
    left = math.inf
    if usual != 1.0:
        left = _left(scene, Parameter(Hypothesis.GRAVITY), usual, seen, float(seen.t[-1]))
    return (usual, left) if left <= AS_GOOD * max(after, seen.noise) else (factor, after)
