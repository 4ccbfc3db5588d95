"""Other parameters of the scene that explain the errors of a table of results: friction and gravity.

A table with errors may be the accurate motion of a scene with another coefficient of friction, with
mus = mu, or with another g. Each of these is a hypothesis with at most one number, which is fitted
by least squares. For a small change p of the number the error is r(p) = r - s p, with the
sensitivity s from two runs of the reference, and p = (s.r)/(s.s) is the next step (the Gauss-Newton
method with a secant in place of the derivative). A hypothesis is accepted by the errors of a run
with the fitted number, not by the linear prediction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stiction.comparisons.measures.result_errors import CONTINUOUS, KNOWN, TURN
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Scene, StictionError
from stiction.scenes.columns import unit_of
from stiction.scenes.laws import scaled_law
from stiction.scenes.model import Joint, Load
from stiction.scenes.result_table import ResultTable
from stiction.truths import Truth

MEDIAN_OF_NORMAL = 0.6745
"""Median of |x| for a normal distribution with standard deviation 1."""
INSTANTS = 1001
"""Largest number of instants of a table that are compared, which is enough to fit one number."""
RTOL = 1e-9
"""Relative tolerance of the runs, whose errors are then well below those that are explained."""
OFF = 1e-5
"""Error of a table above which an explanation is searched for; many solvers have smaller errors.
Errors are root mean squares relative to the size of the motion."""
LOST = 3.0
"""Error of a table below which an explanation is searched for; a motion with larger errors is
unrelated to the scene."""
ABOVE_NOISE = 10.0
"""Ratio of the error to the noise of the table above which an explanation is searched for."""
EXPLAINED = 1e-2
"""Largest error that remains with an explanation, relative to the error without it."""
QUIET = 1.5
"""Largest error that remains with an explanation, relative to the noise of the table, if this is
larger."""
LEAST = 0.1
"""Upper limit of both. With a mass, a stiffness or a load that is wrong by some per cent, another
friction can reduce the error to a twentieth, but is not the explanation."""
ALONE = 3.0
"""Smallest ratio of the errors that remain with any other explanation and with one that is
named."""
FITTED = 1e-3
"""Error that remains with an explanation, relative to the error without it, below which
explanations are equally good: it then depends on the accuracy of the fit."""
FIRST_CHANGE = 1e-2
"""First relative change of a number, from which the sensitivity is computed."""
SMALLEST_CHANGE = 1e-7
"""Relative change of a number at which the fit ends."""
WINDOWS = (1 / 16, 1 / 4, 1.0)
"""Fractions of the table's duration over which a number is fitted, one after another. The beginning
of a motion depends almost linearly on a number, which later changes the phase."""
ROUNDS = 4
"""Largest number of Gauss-Newton steps in each window."""
RANGE = (0.1, 10.0)
"""Smallest and largest factor on a parameter."""
USUAL_G = (9.8, 9.80665, 9.81, 10.0)
"""Values of g in common use, m/s². One of them is reported instead of the fitted value if it
explains the table as well (`AS_GOOD`)."""
AS_GOOD = 1.2
"""Largest ratio of the errors that remain with a common value of g and with the fitted one."""
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
    """A difference between a scene and the one that a table may have been computed with."""

    ONE_COEFFICIENT = "mus = mu"
    KINETIC = "another mu"
    FRICTION = "another mu and mus"
    NO_BOUND = "no friction with constant bounds"
    ONE_BOUND = "static_friction = friction"
    BOUND = "another bound of friction"
    GRAVITY = "another g"
    MASS = "another mass"
    STIFFNESS = "another stiffness"
    LOAD = "another load"


RELATED = {Hypothesis.KINETIC, Hypothesis.FRICTION}
"""Hypotheses that have the same effect if no guide comes to rest. They do not exclude each
other."""


WITHOUT_NUMBER = {Hypothesis.ONE_COEFFICIENT, Hypothesis.NO_BOUND, Hypothesis.ONE_BOUND}
"""Hypotheses that leave something out of the scene."""
BOUNDS = {Hypothesis.NO_BOUND, Hypothesis.ONE_BOUND, Hypothesis.BOUND}
"""Hypotheses on the constant bounds of friction of joints."""
RIVALS = 12
"""Largest number of masses, stiffnesses and loads that are tested against an explanation; with
more, none is tested, because this would take minutes."""


@dataclass(frozen=True)
class Parameter:
    """A hypothesis, and the body, spring or load that it concerns; empty for the friction of all guides and for g."""

    hypothesis: Hypothesis
    element: str = ""

    @property
    def has_number(self) -> bool:
        """True if the hypothesis has a number, which is fitted."""
        return self.hypothesis not in WITHOUT_NUMBER


@dataclass(frozen=True)
class Explanation:
    """A hypothesis, with the number that fits a table best.

    Attributes
    ----------
    parameter : Parameter
    factor : float
        Factor on the coefficients of friction, or on g, or on the parameter of an element; nan of
        `ONE_COEFFICIENT`.
    value : float
        The coefficient if it is the same in all guides, or g in m/s²; otherwise nan.
    before, after : float
        Error of the table compared with the motion of the scene, and with that of the hypothesis:
        root mean square relative to the size of the motion.
    noise : float
        Scatter of the table from row to row, in the same unit.
    is_named : bool
        True if this is the only hypothesis that explains the errors.
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
        """The hypothesis of the parameter."""
        return self.parameter.hypothesis

    @property
    def explains(self) -> bool:
        """True if the error that remains is small, see `EXPLAINED`, `QUIET` and `LEAST`."""
        limit = max(EXPLAINED * self.before, QUIET * self.noise)
        return self.after <= min(limit, LEAST * self.before)

    def row(self) -> tuple[object, ...]:
        """Return the values of `COLUMNS`."""
        unit = "m/s²" if self.hypothesis is Hypothesis.GRAVITY else ""
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
    """Return the hypotheses that are possible for a scene, fitted to a table, the best first.

    The list is empty if the error of the table is outside of the range from `OFF` to `LOST`.
    Otherwise ten to a hundred runs of the reference are executed.
    """
    # Is there an error that may be explained?
    parameters = list(_possible(scene))
    seen = _Seen.of(scene, table, truth) if parameters else None
    own = _motion(scene, seen, float(seen.t[-1])) if seen else None
    if seen is None or own is None:
        return []
    before, noise = seen.size_of(own), seen.noise
    if not max(OFF, ABOVE_NOISE * noise) < before < LOST:
        return []
    # remaining errors below this are due to noise or to the fit
    equal = max(noise, FITTED * before, OFF / 100)

    def explained(parameter: Parameter, start: float = 1.0) -> Explanation:
        return _explanation(scene, parameter, seen, before, start)

    ranked = sorted(map(explained, parameters), key=_what_is_left)
    best = ranked[0]
    # Of two related hypotheses that are equally good, the one with fewer changes is preferred.
    if (
        len(ranked) > 1
        and {best.hypothesis, ranked[1].hypothesis} == RELATED
        and ranked[1].after < ALONE * max(best.after, equal)
    ):
        best = next(each for each in ranked[:2] if each.hypothesis is Hypothesis.KINETIC)
    if not best.explains:
        return ranked

    # Fit the others again from the best one's number, in case that their start was too far away.
    others = []
    for other in ranked:
        if other is best:
            continue
        if other.parameter.has_number and best.parameter.has_number:
            other = min(other, explained(other.parameter, best.factor), key=_what_is_left)
        others.append(other)

    # The best one is named if all rivals are much worse. Masses, stiffnesses and loads are rivals
    # as well, although they are never named. They are tested last, because they take most runs, and
    # not if a common value of g is the explanation.
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
    """Return the error that remains with an explanation, the key for sorting."""
    return explanation.after


def _explanation(
    scene: Scene, parameter: Parameter, seen: _Seen, before: float, start: float
) -> Explanation:
    """Return a hypothesis with its number fitted, beginning at the factor `start`."""
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
    """Yield the hypotheses that can be named, if they change the scene."""
    rubbing = [guide for guide in scene.frictional_guides.values() if guide.static_coefficient > 0]
    if any(guide.static_coefficient > guide.kinetic_coefficient for guide in rubbing):
        yield Parameter(Hypothesis.ONE_COEFFICIENT)
        if any(guide.kinetic_coefficient > 0 for guide in rubbing):
            yield Parameter(Hypothesis.KINETIC)
    if rubbing:
        yield Parameter(Hypothesis.FRICTION)
    bounds = [joint.bounds for joint in scene.joints.values() if joint.bounds[1] > 0]
    if bounds:
        yield Parameter(Hypothesis.NO_BOUND)
        yield Parameter(Hypothesis.BOUND)
    if any(static > kinetic for kinetic, static in bounds):
        yield Parameter(Hypothesis.ONE_BOUND)
    if any(scene.gravity or ()):
        yield Parameter(Hypothesis.GRAVITY)


def _not_asked(scene: Scene) -> list[Parameter]:
    """Return the parameters that are never named, but may explain a table as well; none if there are many."""
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
    """Return the scene of a hypothesis, whose parameter is multiplied by a factor."""
    # The models are copied without validation, because a factor leaves a valid value valid.
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
    if hypothesis in BOUNDS:
        return scene.model_copy(update={"joints": _with_bounds(scene, hypothesis, factor)})
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


def _with_bounds(scene: Scene, hypothesis: Hypothesis, factor: float) -> dict[str, Joint]:
    """Return the joints with other constant bounds of friction; all bounds together."""
    joints = dict(scene.joints)
    for name, joint in scene.joints.items():
        kinetic, static = joint.bounds
        if not static > 0:
            continue
        if hypothesis is Hypothesis.NO_BOUND:
            kinetic = static = 0.0
        elif hypothesis is Hypothesis.ONE_BOUND:
            static = kinetic
        else:
            kinetic, static = factor * kinetic, factor * static
        joints[name] = joint.model_copy(update={"friction": kinetic, "static_friction": static})
    return joints


def _scaled_load(load: Load, factor: float) -> Load:
    """Return a load whose law is multiplied by a factor."""
    return load.model_copy(update={"law": scaled_law(load.law, factor)})


def _value(scene: Scene, parameter: Parameter, factor: float) -> float:
    """Return the value of a changed parameter: g in m/s², or the coefficient or constant bound that all joints share.

    It is nan for other parameters, and if joints differ.
    """
    hypothesis = parameter.hypothesis
    if hypothesis is Hypothesis.BOUND:
        bounds = {
            factor * joint.bounds[0] for joint in scene.joints.values() if joint.bounds[1] > 0
        }
        return bounds.pop() if len(bounds) == 1 else math.nan
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
    """The part of a table that is compared with motions.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Instants, s.
    columns : Mapping[str, ndarray]
        Columns without jumps, each of shape (n,).
    scales : Mapping[str, float]
        Size of the motion in the unit of each column, by which its errors are divided.
    noise : float
        Scatter of the table from row to row, see `_noise`.
    """

    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    scales: Mapping[str, float]
    noise: float

    @classmethod
    def of(cls, scene: Scene, table: ResultTable, truth: Truth) -> _Seen | None:
        """Select at most `INSTANTS` rows of a table; None if no column has a truth, or if nothing moves."""
        rows = np.unique(np.linspace(0, len(table.t) - 1, INSTANTS).round().astype(int))
        true = truth(table.t[rows])
        names = [
            name for name in table.columns if name in true and name.rpartition(".")[2] in CONTINUOUS
        ]
        units = {name: unit_of(name, scene) for name in names}
        largest: dict[str, float] = {}
        for name in names:
            size = float(np.max(np.abs(true[name] - true[name][0])))
            # A column that is constant but for the uncertainty of the truth does not move.
            if size <= KNOWN * truth.uncertainty.get(name, 0.0):
                size = 0.0
            largest[units[name]] = max(size, largest.get(units[name], 0.0))
        scales = {name: largest[units[name]] for name in names if largest[units[name]] > 0}
        if not scales:
            return None
        columns = {name: np.array(table.columns[name][rows]) for name in scales}
        return cls(table.t[rows], columns, scales, _noise(table, truth, scales))

    def errors(self, motion: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the scaled errors of all columns in one array, at the first instants, which the motion contains."""
        parts = []
        for name, scale in self.scales.items():
            off = self.columns[name][: len(motion[name])] - motion[name]
            if name.endswith(".angle"):
                off = off - TURN * np.round(off / TURN)
            parts.append(off / scale)
        return np.concatenate(parts)

    def size_of(self, motion: Mapping[str, np.ndarray] | None) -> float:
        """Return the root mean square of the errors compared with a motion; inf if there is no motion."""
        return math.inf if motion is None else _rms(self.errors(motion))


def _noise(table: ResultTable, truth: Truth, scales: Mapping[str, float]) -> float:
    """Return the scatter of a table from row to row, relative to the size of the motion.

    It is the root mean square over the columns. For each column it is computed from the second
    differences of the error, x_i - (x_(i-1) + x_(i+1)) / 2, which are small for a smooth error.
    With independent scatter of standard deviation d, they have the standard deviation sqrt(1.5) d.
    The median is insensitive to the few at kinks.
    """
    single = table.rows_after[1:-1]
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
    """Return the root mean square; values are divided by the largest one, so that squares do not overflow."""
    largest = float(np.max(np.abs(values), initial=0.0))
    if not largest > 0.0:
        return 0.0
    return largest * float(np.sqrt(np.mean((values / largest) ** 2)))


def _motion(scene: Scene, seen: _Seen, until: float) -> Mapping[str, np.ndarray] | None:
    """Return the motion of a scene by the reference at the instants up to `until` (s); None if it ends earlier."""
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
    """Return the error that remains with a factor on a parameter, up to the instant `until` (s)."""
    return seen.size_of(_motion(changed(scene, parameter, factor), seen, until))


def _fitted(scene: Scene, parameter: Parameter, seen: _Seen, best: float) -> tuple[float, float]:
    """Fit the factor on a parameter, beginning at `best`; return it and the error over the whole table."""
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
    """Return the factor with the smallest sum of squared errors; the start if no other is better."""
    # The secant between two factors replaces the derivative.
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
            # If the step has increased the error, try half of it.
            current = (following + other) / 2
            r_current = errors(current)
    candidates = [
        (r @ r, factor) for factor, r in ((current, r_current), (other, r_other)) if r is not None
    ]
    return min(candidates)[1] if candidates else start


def _usual(scene: Scene, seen: _Seen, factor: float, after: float) -> tuple[float, float]:
    """Return factor and error of the nearest value of g in common use if it is as good; else those of the fit."""
    own = math.hypot(*(scene.gravity or (0.0, 0.0)))
    usual = min(USUAL_G, key=lambda g: abs(g / own - factor)) / own
    if usual == 1.0:
        return factor, after  # the value of the scene does not explain the table
    left = _left(scene, Parameter(Hypothesis.GRAVITY), usual, seen, float(seen.t[-1]))
    if left <= AS_GOOD * max(after, seen.noise):
        return usual, left
    return factor, after
