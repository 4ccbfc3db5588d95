"""Margins by which statements of the paper hold.

Each function of `MEASURES` computes quantities from stretches of motion, and passes them to one of
the functions `below`, `above`, `all_of` and `as_said`. These return a margin, which is positive if
the statement holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.comparisons.measures.steady_stretch import Stretch
from stiction.scenes import Scene, vary
from stiction.truths import StickThreshold
from stiction.truths.reduced.slider_bar import SliderBar

LINE = 1 / 500
"""Largest change per period, relative to the range, of a motion that repeats itself.

The paper shows this by figures. The value is the width of a line, 0.1 mm, divided by the height of
a printed figure, 50 mm; a smaller change would not be visible.
"""
AMPLITUDES = (0.1, 0.5, 0.99, 1.01, 2.0)
"""Amplitudes F0, relative to the threshold, at which the slider must stick or must not.

The smallest distance from the threshold, 1 %, is about forty times the uncertainty of the scheme's
threshold with a step of 2.5 ms.
"""
STILL = 1e-9
"""Velocity and acceleration in a stick phase, relative to their largest values, that rounding can
cause."""
CORNERS = ("guide.F1", "guide.F2", "guide.F3", "guide.F4")
"""Columns of the corner forces, N."""
EFFORT = "motor.effort"
"""Column of the driving torque, N m."""
ACCELERATION = "slider.ax"
"""Column of the acceleration of the slider, m/s^2."""
FRICTION = "guide.friction"
"""Column of the friction force, N."""
ADJACENT = ("1+2", "3+4")
"""Configurations in which both corners of one surface carry load."""
OPPOSITE = ("1+3", "2+4")
"""Configurations in which corners of opposite surfaces carry load."""


@dataclass(frozen=True)
class ClaimMargin:
    """The margin by which a statement holds.

    Attributes
    ----------
    margin : float
        Positive if the statement holds.
    some : bool
        True if the statement holds for a part of its subject.
    why : str
        Why no margin can be computed; empty if it can.
    """

    margin: float
    some: bool = False
    why: str = ""

    @property
    def holds(self) -> bool:
        """True if the statement holds."""
        return self.margin > 0


@dataclass(frozen=True)
class Example:
    """The example of the paper.

    Attributes
    ----------
    cases : Mapping[int, Scene]
        The three cases by number.
    threshold : StickThreshold
        Stick threshold of case 1.
    stretch_of : callable
        Returns the part of the motion of a scene on which statements are tested.
    """

    cases: Mapping[int, Scene]
    threshold: StickThreshold
    stretch_of: Callable[[Scene], Stretch]

    def stretch(self, case: int, **parameters: float) -> Stretch:
        """Return the motion of a case, with other values of some parameters."""
        scene = self.cases[case]
        if parameters:
            scene = vary(scene, parameters)
        return self.stretch_of(scene)

    def with_parameter(self, name: str, case: int, other: int) -> Stretch:
        """Return the motion of a case with the value that a parameter has in another case."""
        return self.stretch(case, **{name: self.cases[other].parameters[name]})


def below(value: float, limit: float) -> ClaimMargin:
    """Return the margin of the statement that a value is less than a limit."""
    return ClaimMargin(limit - value)


def above(values: Sequence[float], limit: float) -> ClaimMargin:
    """Return the margin of the statement that all values exceed a limit."""
    return ClaimMargin(min(values) - limit, max(values) > limit)


def all_of(conditions: Sequence[bool]) -> ClaimMargin:
    """Return the margin of the statement that all conditions hold: half of the part of a single one if they do."""
    count = len(conditions)
    return ClaimMargin(sum(conditions) / count - 1 + 1 / (2 * count), any(conditions))


def as_said(holds: bool, sizes: Sequence[float], some: bool = False) -> ClaimMargin:
    """Return the margin of a statement whose quantities have some sizes: the smallest if it holds, else -1."""
    return ClaimMargin(min(sizes) if holds else -1.0, some)


def sticks(example: Example, case: int) -> ClaimMargin:
    """Test that the slider sticks; the margin is the duration of the shortest stick phase, s.

    If there is none, it is minus the acceleration after a stop; if velocity or acceleration do not
    vanish in a stick phase, it is minus their size relative to their largest value.
    """
    stretch = example.stretch(case)
    if not stretch.phases:
        return ClaimMargin(-_smallest_acceleration_after_stop(stretch))
    motion = 0.0
    for start, end in stretch.phases:
        inside = (stretch.t > start) & (stretch.t < end)
        for name in ("slider.vx", ACCELERATION):
            largest = np.max(np.abs(stretch.columns[name][inside]), initial=0.0)
            motion = max(motion, float(largest) / stretch.maximum(name))
    if motion > STILL:
        return ClaimMargin(-motion)
    return ClaimMargin(min(end - start for start, end in stretch.phases))


def slips(example: Example, case: int) -> ClaimMargin:
    """Test that the slider never sticks; the margin is the smallest acceleration after a stop, m/s^2.

    If the slider sticks, it is minus the time for which it does, s.
    """
    stretch = example.stretch(case)
    if stretch.phases:
        return ClaimMargin(-stretch.stick_time)
    return ClaimMargin(_smallest_acceleration_after_stop(stretch))


def _smallest_acceleration_after_stop(stretch: Stretch) -> float:
    """Return the smallest acceleration of the slider after its velocity has been zero, m/s^2; inf without stops."""
    return min((abs(event.after[ACCELERATION]) for event in stretch.turning), default=np.inf)


NO_EVENT = ClaimMargin(-1.0, why="no event")
"""Margin of a statement about events, if there are none."""
LARGEST_REST = 0.5
"""Part of a jump that has other causes than friction, below which friction is its cause."""


def periodic(example: Example, case: int) -> ClaimMargin:
    """Test that the motion repeats itself, by the largest change from one period to the next."""
    return below(example.stretch(case).change(), LINE)


def jumps(example: Example, case: int, column: str, unit: str) -> ClaimMargin:
    """Test that a column jumps at events by more than its largest smooth change.

    The margin is in the unit of the column, which is the argument `unit`.
    """
    stretch = example.stretch(case)
    sizes = [abs(event.jump(column)) for event in stretch.turning]
    return above(sizes, stretch.resolution(column)) if sizes else NO_EVENT


def friction_causes_jumps(example: Example, case: int) -> ClaimMargin:
    """Test that friction causes the jumps of the acceleration.

    At all events, the part of the jump of mass times acceleration that is not a jump of friction is
    below `LARGEST_REST`.
    """
    mass = SliderBar.from_scene(example.cases[case]).mass
    rests = [
        abs(1 - event.jump(FRICTION) / (mass * event.jump(ACCELERATION)))
        for event in example.stretch(case).turning
        if event.jump(ACCELERATION)
    ]
    return below(max(rests), LARGEST_REST) if rests else NO_EVENT


def friction_turns(example: Example, case: int) -> ClaimMargin:
    """Test that the friction changes its sign at all events."""
    events = example.stretch(case).turning
    if not events:
        return NO_EVENT
    return all_of([event.before[FRICTION] * event.after[FRICTION] < 0 for event in events])


def contacts_alternate(example: Example, case: int) -> ClaimMargin:
    """Test that adjacent and opposite corners carry load alternately; the margin is the shorter of their times, s."""
    configurations = example.stretch(case).configurations
    are_pairs = all(name in ADJACENT + OPPOSITE for name, _ in configurations)
    is_adjacent = [name in ADJACENT for name, _ in configurations]
    alternate = all(one != other for one, other in zip(is_adjacent, is_adjacent[1:]))
    adjacent_s = sum(seconds for name, seconds in configurations if name in ADJACENT)
    opposite_s = sum(seconds for name, seconds in configurations if name not in ADJACENT)
    return as_said(are_pairs and alternate, [adjacent_s, opposite_s])


def contacts_in_order(example: Example, case: int, order: Sequence[str]) -> ClaimMargin:
    """Test the order of the first configurations; the margin is the time of the shortest, s."""
    configurations = example.stretch(case).configurations[: len(order)]
    names = [name for name, _ in configurations]
    return as_said(names == list(order), [seconds for _, seconds in configurations])


def contacts_as_in(example: Example, case: int, other: int) -> ClaimMargin:
    """Test that two cases have the same cycle of configurations in the last period.

    The margin is the time of the shortest configuration, s, except the first and the last, which
    the period cuts off.
    """
    cycles, times = [], []
    for number in (case, other):
        stretch = example.stretch(number)
        last_period = stretch.between(stretch.end - stretch.period, stretch.end)
        cycles.append(last_period.cycle())
        complete = last_period.configurations[1:-1] or last_period.configurations
        times += [seconds for _, seconds in complete]
    return as_said(cycles[0] == cycles[1], times)


def all_contacts(example: Example, case: int) -> ClaimMargin:
    """Test that all four configurations occur; the margin is the shortest of their total times, s."""
    configurations = example.stretch(case).configurations
    times = [
        sum(seconds for name, seconds in configurations if name == pair)
        for pair in OPPOSITE + ADJACENT
    ]
    return as_said(all(times), times, any(times))


def _ratios(stretch: Stretch, other: Stretch) -> list[float]:
    """Return the ratios of the largest corner forces and of the largest driving torques of two motions."""
    return [stretch.maximum(*columns) / other.maximum(*columns) for columns in (CORNERS, (EFFORT,))]


def larger_than_in(example: Example, case: int, other: int) -> ClaimMargin:
    """Test that the largest corner force and the largest driving torque exceed those of another case."""
    return above(_ratios(example.stretch(case), example.stretch(other)), 1)


def larger_by_parameters(
    example: Example, case: int, other: int, names: Sequence[str]
) -> ClaimMargin:
    """Test that each parameter alone, changed in the other case to its value in this one, makes loads larger.

    The loads are the largest corner force and the largest driving torque.
    """
    ratios: list[float] = []
    for name in names:
        ratios += _ratios(example.with_parameter(name, other, case), example.stretch(other))
    return above(ratios, 1)


def parameter_decides(example: Example, case: int, other: int, name: str) -> ClaimMargin:
    """Test that one parameter, exchanged between two cases, decides: this case sticks, the other does not."""
    return _only_first_sticks(
        example.with_parameter(name, case, other), example.with_parameter(name, other, case)
    )


def amplitude_decides(example: Example, case: int, other: int) -> ClaimMargin:
    """Test that two cases differ in F0 only, and that this case sticks and the other does not."""
    parameters = example.cases[other].parameters
    differing = {
        name for name, value in example.cases[case].parameters.items() if value != parameters[name]
    }
    only_F0 = differing == {"F0"}
    return _only_first_sticks(example.stretch(case), example.stretch(other), only_F0)


def _only_first_sticks(first: Stretch, second: Stretch, condition: bool = True) -> ClaimMargin:
    """Test a condition, and that the first of two motions sticks and the second does not.

    The margin is the smaller of the first one's stick time (s) and the second one's acceleration
    after a stop (m/s^2).
    """
    first_sticks, second_sticks = bool(first.stick_time), bool(second.stick_time)
    sizes = (first.stick_time, _smallest_acceleration_after_stop(second))
    holds = first_sticks and not second_sticks and condition
    return as_said(holds, sizes, first_sticks != second_sticks)


def sticks_below_threshold(example: Example, case: int) -> ClaimMargin:
    """Test that there are stick phases at all `AMPLITUDES` below the threshold, and at none above it."""
    F0 = example.threshold.F0
    if F0 is None:
        return ClaimMargin(-1.0, why=f"no threshold: {example.threshold.note}")
    are_right = []
    for factor in AMPLITUDES:
        has_stick = bool(example.stretch(case, F0=factor * F0).stick_time)
        are_right.append(has_stick == (factor < 1))
    distances = [abs(factor - 1) for factor in AMPLITUDES]
    return as_said(all(are_right), distances, any(are_right))


MEASURES: dict[str, Callable[..., ClaimMargin]] = {
    measure.__name__: measure
    for measure in (
        periodic,
        sticks,
        slips,
        jumps,
        friction_causes_jumps,
        friction_turns,
        contacts_alternate,
        contacts_in_order,
        contacts_as_in,
        all_contacts,
        larger_than_in,
        larger_by_parameters,
        parameter_decides,
        amplitude_decides,
        sticks_below_threshold,
    )
}
"""The functions that test statements, by the names that ``comparisons/data/paper_claims.toml``
uses."""
