"""Quantities that the paper's sentences are about, each with the margin by which a sentence holds.

A quantity is taken of stretches of motion and ends in one of four predicates, which give the margin, positive where the
sentence holds: `below`, `above`, `all_of` and `as_said`.
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
"""Part of the range: the width of a line, 0.1 mm, to the height of a printed figure, 50 mm.

The paper shows by figures that the motion repeats itself; a smaller change per period could not be seen in them.
"""
AMPLITUDES = (0.1, 0.5, 0.99, 1.01, 2.0)
"""Multiples of the threshold on F0: from a tenth of it to twice, and as near as 1 %.

The latter is some forty times the uncertainty of the scheme's threshold at 2.5 ms.
"""
STILL = 1e-9
"""Part of their largest values that rounding leaves of velocity and acceleration in a stick phase."""
CORNERS = ("guide.F1", "guide.F2", "guide.F3", "guide.F4")
EFFORT, ACCELERATION, FRICTION = "motor.effort", "slider.ax", "guide.friction"
ADJACENT, OPPOSITE = ("1+2", "3+4"), ("1+3", "2+4")


@dataclass(frozen=True)
class ClaimMargin:
    """A margin, positive where the claim holds; `some`: it holds of a part of its subject; `why` there is no number."""

    margin: float
    some: bool = False
    why: str = ""

    @property
    def holds(self) -> bool:
        return self.margin > 0


@dataclass(frozen=True)
class Example:
    """The paper's cases, the threshold of case 1, and the stretch of a scene's motion on which claims are measured."""

    cases: Mapping[int, Scene]
    threshold: StickThreshold
    stretch_of: Callable[[Scene], Stretch]

    def stretch(self, case: int, **parameters: float) -> Stretch:
        """Return the motion of a case, with other values of some parameters."""
        return self.stretch_of(
            vary(self.cases[case], parameters) if parameters else self.cases[case]
        )

    def with_parameter(self, name: str, case: int, other: int) -> Stretch:
        """Return the motion of a case with a parameter as in another one."""
        return self.stretch(case, **{name: self.cases[other].parameters[name]})


def below(value: float, limit: float) -> ClaimMargin:
    """Judge a value that is to be less than a limit."""
    return ClaimMargin(limit - value)


def above(values: Sequence[float], limit: float) -> ClaimMargin:
    """Judge values that are all to exceed a limit."""
    return ClaimMargin(min(values) - limit, max(values) > limit)


def all_of(so: Sequence[bool]) -> ClaimMargin:
    """Judge a statement that is to hold each time; the margin is half a time where it does."""
    return ClaimMargin(sum(so) / len(so) - 1 + 1 / (2 * len(so)), any(so))


def as_said(so: bool, sizes: Sequence[float], some: bool = False) -> ClaimMargin:
    """Judge a statement by the smallest of the sizes that make it hold."""
    return ClaimMargin(min(sizes) if so else -1.0, some)


def sticks(example: Example, case: int) -> ClaimMargin:
    """Shortest stick phase, in which velocity and acceleration must vanish."""
    stretch = example.stretch(case)
    if not stretch.phases:
        return ClaimMargin(-_restart(stretch))
    rests = 0.0
    for start, end in stretch.phases:
        inside = (stretch.t > start) & (stretch.t < end)
        for name in ("slider.vx", ACCELERATION):
            largest = np.max(np.abs(stretch.columns[name][inside]), initial=0.0)
            rests = max(rests, float(largest) / stretch.maximum(name))
    return ClaimMargin(
        min(end - start for start, end in stretch.phases) if rests <= STILL else -rests
    )


def slips(example: Example, case: int) -> ClaimMargin:
    """Smallest acceleration after a stop."""
    stretch = example.stretch(case)
    return ClaimMargin(-stretch.stick_time if stretch.phases else _restart(stretch))


def _restart(stretch: Stretch) -> float:
    """Smallest acceleration with which the slider goes on after its velocity was zero, m/s^2."""
    return min((abs(event.after[ACCELERATION]) for event in stretch.turning), default=np.inf)


NO_EVENT = ClaimMargin(-1.0, why="no event")


def periodic(example: Example, case: int) -> ClaimMargin:
    """Change from one period to the next."""
    return below(example.stretch(case).change(), LINE)


def jumps(example: Example, case: int, column: str, unit: str) -> ClaimMargin:
    """Jumps of a column at events, against the largest smooth change; in its unit."""
    stretch = example.stretch(case)
    sizes = [abs(event.jump(column)) for event in stretch.turning]
    return above(sizes, stretch.resolution(column)) if sizes else NO_EVENT


def friction_causes_jumps(example: Example, case: int) -> ClaimMargin:
    """Part of the jump of mass times acceleration that is no jump of friction, the largest of all events."""
    mass = SliderBar.from_scene(example.cases[case]).mass
    rest = [
        abs(1 - event.jump(FRICTION) / (mass * event.jump(ACCELERATION)))
        for event in example.stretch(case).turning
        if event.jump(ACCELERATION)
    ]
    return below(max(rest), 0.5) if rest else NO_EVENT


def friction_turns(example: Example, case: int) -> ClaimMargin:
    """Friction of opposite signs before and after each event."""
    events = example.stretch(case).turning
    return (
        all_of([event.before[FRICTION] * event.after[FRICTION] < 0 for event in events])
        if events
        else NO_EVENT
    )


def contacts_alternate(example: Example, case: int) -> ClaimMargin:
    """Two adjacent and two opposite corners in turn, and how long each kind lasts."""
    configurations = example.stretch(case).configurations
    adjacent = [name in ADJACENT for name, _ in configurations]
    pairs = all(name in ADJACENT + OPPOSITE for name, _ in configurations)
    turns = all(one != other for one, other in zip(adjacent, adjacent[1:]))
    return as_said(
        pairs and turns,
        [
            sum(
                seconds
                for (_, seconds), is_adjacent in zip(configurations, adjacent)
                if is_adjacent == kind
            )
            for kind in (True, False)
        ],
    )


def contacts_in_order(example: Example, case: int, order: Sequence[str]) -> ClaimMargin:
    """The first configurations, and how long each lasts."""
    configurations = example.stretch(case).configurations[: len(order)]
    return as_said(
        [name for name, _ in configurations] == list(order),
        [seconds for _, seconds in configurations],
    )


def contacts_as_in(example: Example, case: int, other: int) -> ClaimMargin:
    """The same cycle of configurations in the last period, and how long each lasts."""
    whole = (example.stretch(case), example.stretch(other))
    last = [stretch.between(stretch.end - stretch.period, stretch.end) for stretch in whole]
    one, two = (stretch.cycle() for stretch in last)
    return as_said(
        one == two,
        [
            seconds
            for stretch in last
            for _, seconds in stretch.configurations[1:-1] or stretch.configurations
        ],
    )


def all_contacts(example: Example, case: int) -> ClaimMargin:
    """Times of the four configurations."""
    configurations = example.stretch(case).configurations
    times = [
        sum(seconds for name, seconds in configurations if name == pair)
        for pair in OPPOSITE + ADJACENT
    ]
    return as_said(all(times), times, any(times))


def _ratios(one: Stretch, other: Stretch) -> list[float]:
    """Largest corner force and largest moment, in units of another motion's."""
    return [one.maximum(*columns) / other.maximum(*columns) for columns in (CORNERS, (EFFORT,))]


def larger_than_in(example: Example, case: int, other: int) -> ClaimMargin:
    """Largest corner force and largest moment, in units of the other case's."""
    return above(_ratios(example.stretch(case), example.stretch(other)), 1)


def larger_by_parameters(
    example: Example, case: int, other: int, names: Sequence[str]
) -> ClaimMargin:
    """Largest corner force and moment of the other case with each of the parameters alone as in this one."""
    return above(
        [
            ratio
            for name in names
            for ratio in _ratios(example.with_parameter(name, other, case), example.stretch(other))
        ],
        1,
    )


def parameter_decides(example: Example, case: int, other: int, name: str) -> ClaimMargin:
    """One parameter exchanged between the two cases: this one must stick, the other must not."""
    return _one_sticks(
        example.with_parameter(name, case, other), example.with_parameter(name, other, case)
    )


def amplitude_decides(example: Example, case: int, other: int) -> ClaimMargin:
    """Two cases that differ in F0 alone: this one must stick, the other must not."""
    parameters = example.cases[other].parameters
    differing = {
        name for name, value in example.cases[case].parameters.items() if value != parameters[name]
    }
    return _one_sticks(example.stretch(case), example.stretch(other), alone=differing == {"F0"})


def _one_sticks(sticking: Stretch, slipping: Stretch, alone: bool = True) -> ClaimMargin:
    one, two = bool(sticking.stick_time), bool(slipping.stick_time)
    return as_said(one and not two and alone, (sticking.stick_time, _restart(slipping)), one != two)


def sticks_below_threshold(example: Example, case: int) -> ClaimMargin:
    """Stick phases below the threshold, none above it, at `AMPLITUDES` of it."""
    F0 = example.threshold.F0
    if F0 is None:
        return ClaimMargin(-1.0, why=f"no threshold: {example.threshold.note}")
    right = [
        bool(example.stretch(case, F0=factor * F0).stick_time) == (factor < 1)
        for factor in AMPLITUDES
    ]
    return as_said(all(right), [abs(factor - 1) for factor in AMPLITUDES], any(right))


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
