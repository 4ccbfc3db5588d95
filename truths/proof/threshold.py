"""The end of a band of load amplitudes with a stick phase in the periodic motion, between two bounds: a theorem.

P takes the state (x, x') of the slider-bar at t = 0 to that n common periods T of bar and load later. For a set
B = {c + W y : |y1|, |y2| <= e} let N enclose W^-1 DP W on B. Where

    q = ||N||_inf < 1   and   ||W^-1 (P(c) - c)||_inf <= (1 - q) e ,

P maps B into itself and contracts it (Banach). Then exactly one motion of period n T starts in B, and every motion from
B tends to it. Its changes of mode are those proven for all of B at once, so that it has a stick phase or has none. If
the motion from the scene's start is in B after some periods, the periodic motion is the steady state that the scene
leads to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat

from stiction.scenes import Scene, vary
from stiction.truths.proof.enclosures import NotProven
from stiction.truths.proof.enclosures.exact import Exact, exact_scene
from stiction.truths.proof.enclosures.series import identity
from stiction.truths.proof.mechanisms.sliding_mass import SlidingMass
from stiction.truths.proof.motion import ProvenMotion, prove
from stiction.truths.proof.step import Precision, ProvenEvent, StateSet, column, middles
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import steady_state, stick_threshold

_DIGITS = 24
"""Decimal digits of the working precision; no smaller size of B is tried than one unit of the last digit."""
_REFINEMENTS = 6
"""Number of Newton steps for the fixed point. From the error of floats, 1e-11, Newton's method reaches the working
precision after one or two steps, as the error is squared in each; the others are a reserve."""
_FIRST_SIZE_EXPONENT = 8
"""The first size of B that is tried is 10 to the power of minus this number."""
_SIZE_EXPONENT_STEP = 2
"""Difference of the exponents of successive sizes of B."""
_MAX_PERIODS = 200
"""Largest number of periods after which the motion from the scene's start must be in B."""


@dataclass(frozen=True)
class ProvenSteadyState:
    """An attracting periodic motion whose existence is proven, and bounds of it.

    Attributes
    ----------
    F0 : Fraction
        Amplitude of the load, N.
    period : arb
        Period of the motion, s: `count` common periods of bar and load.
    state : tuple of arb
        State (x, x') at t = 0, m and m/s.
    contraction : float
        Upper bound of q, by which the map P contracts B.
    states : StateSet
        The set B.
    count : int
        Number n of common periods of bar and load.
    periods : int
        Number of periods after which the motion from the scene's start is in B.
    events : list of ProvenEvent
        Events of one period.
    sticks : bool
        Whether the motion has a stick phase.
    digits : int
        Decimal digits of the working precision.
    """

    F0: Fraction
    period: arb
    state: tuple[arb, arb]
    contraction: float
    states: StateSet
    count: int
    periods: int
    events: list[ProvenEvent]
    sticks: bool
    digits: int

    def sentence(self) -> str:
        """Return the theorem in words."""
        x, speed = (value.str(15) for value in self.state)
        phase = "has a stick phase" if self.sticks else "has no stick phase"
        radius = float(self.states.size[0].rad())
        return (
            f"At F0 = {decimal(self.F0)} N the motion from the scene's start tends to a periodic one, the only one "
            f"near (x, x') = ({x} m, {speed} m/s) at t = 0; it {phase} (period {self.period.str(12)} s, "
            f"contraction by {self.contraction:.4g} per period on a set of size {radius:.0e}, "
            f"reached after {self.periods} periods)."
        )


@dataclass(frozen=True)
class ProvenThreshold:
    """Two amplitudes between which the threshold of stick phases is proven to lie.

    Attributes
    ----------
    low, high : ProvenSteadyState
        The steady states from the scene's start, with a stick phase at `low` and without one at `high`.
    """

    low: ProvenSteadyState
    high: ProvenSteadyState

    def sentences(self) -> list[str]:
        """Return the hypotheses and the statements of the theorem."""
        low, high = decimal(self.low.F0), decimal(self.high.F0)
        return [
            "Hypotheses: the scene's numbers are exact as they are written; rigid bodies; Coulomb's law with mu "
            "and mus; the slider rests exactly while full static friction holds it.",
            self.low.sentence(),
            self.high.sentence(),
            f"The threshold of stick phases that is crossed there lies between {low} N and {high} N.",
        ]


def decimal(number: Fraction) -> str:
    """Write a decimal fraction in full; any other one as a quotient."""
    text = f"{Decimal(number.numerator) / number.denominator:f}"
    return text if Fraction(text) == number else str(number)


def proven_threshold(scene: Scene, places: int = 9) -> ProvenThreshold:
    """Prove bounds of the threshold near that of `stick_threshold`, at a distance of 10^-places N from each other.

    Raises
    ------
    NotThisMechanism
        If the scene is not a slider-bar.
    NotProven
        If `stick_threshold` finds no threshold, or a proof fails.
    """
    # The threshold in floats says where to look; the proofs do not trust it.
    threshold = stick_threshold(scene)
    if threshold.F0 is None:
        raise NotProven(f"{scene.name}: {threshold.note}")
    unit = Fraction(1, 10**places)
    low = (Fraction(threshold.F0) // unit) * unit
    ends = [proven_steady_state(scene, F0) for F0 in (low, low + unit)]
    if not ends[0].sticks or ends[1].sticks:
        raise NotProven(
            f"{scene.name}: stick phase at {float(low):.12g} N: {ends[0].sticks}, "
            f"at {float(low + unit):.12g} N: {ends[1].sticks}"
        )
    return ProvenThreshold(*ends)


def proven_steady_state(scene: Scene, F0: Fraction) -> ProvenSteadyState:
    """Prove the steady state at an amplitude F0 (N), with a set B around the steady state in floats.

    Raises the same errors as `proven_threshold`.
    """
    near = steady_state(SliderBar.from_scene(_at_amplitude(scene, F0)))
    with Precision.of(_DIGITS).working():
        mechanism = _mechanism(scene, F0, near.periods)
        centre = [arb(float(value)) for value in near.state]
        centre, slope = _fixed_point(mechanism, centre)
        frame = _frame(slope)
        # Try the largest sets first: the motion from the scene's start enters them after the fewest periods.
        reason = ""
        for exponent in range(_FIRST_SIZE_EXPONENT, _DIGITS, _SIZE_EXPONENT_STEP):
            size = arb(10.0**-exponent) * arb(0, 1)
            states = StateSet(tuple(centre), frame, (size, size))
            try:
                return proven_on(scene, F0, near.periods, states, _DIGITS)
            except ArithmeticError as error:
                reason = str(error)
        raise NotProven(reason)


def _fixed_point(mechanism: SlidingMass, guess: list[arb]) -> tuple[list[arb], arb_mat]:
    """Approximate the solution c of P(c) = c by Newton's method, in balls without width.

    Returns
    -------
    centre : list of arb
        (x, x') of c, m and m/s; an approximation, about which the proof makes no assumption.
    slope : arb_mat
        DP at the last iterate but one.
    """
    centre = guess
    for _ in range(_REFINEMENTS):
        motion = _motion_from(mechanism, StateSet.box(centre), _DIGITS)
        slope = motion.derivative()
        residual = column(after - before for before, after in zip(centre, motion.end.hull()))
        correction = (identity(2) - slope).solve(residual)
        centre = [(c + correction[i, 0]).mid() for i, c in enumerate(centre)]
    return centre, slope


def _at_amplitude(scene: Scene, F0: Fraction) -> Scene:
    [load] = scene.forces
    return vary(scene, {f"forces.{load}.law.amplitude": str(F0)})


def _mechanism(scene: Scene, F0: Fraction, count: int) -> SlidingMass:
    """Return the slider-bar over `count` common periods of bar and load; raise NotProven if they have none."""
    loaded = _at_amplitude(scene, F0)
    numbers, [drive], [load] = exact_scene(loaded), scene.drives, scene.forces
    rate, frequency = numbers.drives[drive].law.rate, numbers.forces[load].law.frequency
    # frequency/rate = p/q: the common period is that of q turns of the bar, 2 pi q / rate, as an
    # exact number
    ratio = (frequency / rate).factors
    if ratio is None or ratio[1] != 0:
        raise NotProven(
            f"{scene.name}: found frequencies {frequency.ball.str(10)} and {rate.ball.str(10)}; "
            "expected a rational ratio"
        )
    q, k = rate.factors or (1, 0)
    period = abs(Exact.of(2 * ratio[0].q / q, 1 - k).ball)
    return replace(SlidingMass.from_scene(loaded), t_end=period * count)


def _motion_from(mechanism: SlidingMass, states: StateSet, digits: int) -> ProvenMotion:
    """Return the motion over one period from all states of a set, none of which is at rest."""
    x, speed = states.hull()
    return prove(replace(mechanism, q=[x], v=[speed], at_rest=False), Precision.of(digits), states)


def proven_on(
    scene: Scene, F0: Fraction, count: int, states: StateSet, digits: int
) -> ProvenSteadyState:
    """Prove the steady state at an amplitude, on a given set B.

    Parameters
    ----------
    scene : Scene
        A slider-bar.
    F0 : Fraction
        Amplitude of the load, N.
    count : int
        Number of common periods of bar and load in a period of the motion.
    states : StateSet
        The set B.
    digits : int
        Decimal digits of the working precision, which is set here.

    Raises
    ------
    NotProven
        If one of Banach's two conditions is not satisfied, or the motion from the scene's start is not proven to come
        into B.
    """
    with Precision.of(digits).working():
        return _proven_on(scene, F0, count, states, digits)


def _proven_on(
    scene: Scene, F0: Fraction, count: int, states: StateSet, digits: int
) -> ProvenSteadyState:
    """Do the work of `proven_on` at the working precision."""
    mechanism = _mechanism(scene, F0, count)
    centre, frame = list(states.centre), states.frame
    inverse = frame.inv()
    radius = min((size.rad() for size in states.size), key=float)

    # Banach's two conditions: the contraction q = ||W^-1 DP W|| on all of B, and the residual
    # ||W^-1 (P(c) - c)|| at its centre.
    motion = _motion_from(mechanism, states, digits)
    contraction = _norm(inverse * motion.derivative() * frame)
    image = _motion_from(mechanism, StateSet.box(centre), digits).end.hull()
    residual = _norm(inverse * column(after - before for before, after in zip(centre, image)))
    if not (contraction < 1 and residual <= (1 - contraction) * radius):
        raise NotProven(
            f"F0 = {float(F0):.12g} N: no contraction: factor {contraction.str(5)}, "
            f"residual {residual.str(3)}"
        )
    # The fixed point lies within residual / (1 - q) of the centre, in the coordinates of the frame.
    distance = residual / (1 - contraction)
    state = []
    for i, value in enumerate(centre):
        row_sum = sum((abs(frame[i, j]) for j in range(2)), arb(0))
        state.append(value + row_sum * distance * arb(0, 1))
    has_stick_event = any(event.kind == "stick" for event in motion.events)
    begins_at_rest = motion.legs[0].mode[0] == 0
    return ProvenSteadyState(
        F0=F0,
        period=mechanism.t_end,
        state=tuple(state),
        contraction=float(contraction.upper()),
        states=states,
        count=count,
        periods=_periods_until_inside(mechanism, states, Precision.of(digits)),
        events=motion.events,
        sticks=has_stick_event or begins_at_rest,
        digits=digits,
    )


def _frame(slope: arb_mat) -> arb_mat:
    """Return the real and imaginary parts of the eigenvectors of a derivative: a basis in which its norm is small."""
    values, vectors = np.linalg.eig(middles(slope))
    basis = vectors
    if np.iscomplexobj(values):
        basis = np.column_stack([vectors[:, 0].real, vectors[:, 0].imag])
    return arb_mat(basis.tolist())


def _norm(matrix: arb_mat) -> arb:
    """Return an upper bound of the maximum norm of a matrix: the largest sum of absolute values in a row."""
    return max((sum(map(abs, row), arb(0)).upper() for row in matrix.tolist()), key=float)


def _periods_until_inside(mechanism: SlidingMass, states: StateSet, precision: Precision) -> int:
    """Return the number of periods after which the motion from the scene's start is proven to be in a set."""
    current, start = mechanism, None
    for count in range(1, _MAX_PERIODS + 1):
        motion = prove(current, precision, start)
        held = mechanism.held(motion.legs[-1].mode)
        x, speed = motion.end.hull()
        if states.contains([x, speed]):
            return count
        # The next period starts from the enclosure of this one's end; at rest the velocity is known
        # exactly.
        start = StateSet.box([x, held[0]]) if held else motion.end
        x, speed = start.hull()
        current = replace(mechanism, q=[x], v=[speed], at_rest=bool(held))
    raise NotProven(
        f"the motion from the scene's start is not near the periodic one after {_MAX_PERIODS} periods"
    )
