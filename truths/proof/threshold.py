"""Proven bounds of the stick threshold: the end of a band of load amplitudes whose steady state has a stick phase.

P maps the state (x, x') of the slider-bar at t = 0 to the state n common periods T of bar and load later. For a set
B = {c + W y : |y1|, |y2| <= e} let N enclose W^-1 DP W on B. If

    q = ||N||_inf < 1   and   ||W^-1 (P(c) - c)||_inf <= (1 - q) e ,

P maps B into itself and contracts it (Banach). Then exactly one motion of period n T starts in B, and every motion from
B converges to it. Its changes of mode are proven for all of B at once, and decide whether it has a stick phase. If the
motion from the scene's start is in B after some periods, the periodic motion is the steady state of the scene.
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
"""Digits of the balls, and with them the smallest size of B that is tried."""
_REFINEMENTS = 6
"""Newton steps on the fixed point: from the 1e-11 of floats to the working precision, quadratically, with a reserve."""
_LARGEST = 8
"""Negative decimal exponent of the first size of B that is tried."""
_SMALLER = 2
"""Difference of the exponents of successive sizes."""
_PERIODS = 200
"""Largest number of periods after which the motion from the scene's start may enter B."""


@dataclass(frozen=True)
class ProvenSteadyState:
    """An attracting periodic motion whose existence is proven.

    Attributes
    ----------
    F0 : Fraction
        Amplitude of the load, N.
    period : arb
        Period n T, s.
    state : tuple of arb
        (x, x') at t = 0, m and m/s.
    contraction : float
        Upper bound of q on B.
    states : StateSet
        The set B.
    count : int
        Number n of common periods.
    periods : int
        Number of periods n T after which the motion from the scene's start is in B.
    events : list of ProvenEvent
        Events of one period.
    sticks : bool
        True if the motion has a stick phase.
    digits : int
        Digits of the proof.
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
        """Return the proof in words."""
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
    """At `low` the steady state from the scene's start has a stick phase, at `high` it has none."""

    low: ProvenSteadyState
    high: ProvenSteadyState

    def sentences(self) -> list[str]:
        """Return the theorem, with its hypotheses."""
        low, high = decimal(self.low.F0), decimal(self.high.F0)
        return [
            "Hypotheses: the scene's numbers are exact as they are written; rigid bodies; Coulomb's law with mu "
            "and mus; the slider rests exactly while full static friction holds it.",
            self.low.sentence(),
            self.high.sentence(),
            f"The threshold of stick phases that is crossed there lies between {low} N and {high} N.",
        ]


def decimal(number: Fraction) -> str:
    """Return a decimal fraction in full, and any other fraction as a quotient."""
    text = f"{Decimal(number.numerator) / number.denominator:f}"
    return text if Fraction(text) == number else str(number)


def proven_threshold(scene: Scene, places: int = 9) -> ProvenThreshold:
    """Return proven bounds of the threshold near that of `stick_threshold`, 10^-places N apart.

    Raises
    ------
    NotThisMechanism
        If the scene is no slider-bar.
    NotProven
        If no threshold is known, or a proof fails.
    """
    # The threshold in floats is only an initial guess of the proofs.
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
    """Return the proven steady state at an amplitude; raise the errors of `proven_threshold`."""
    near = steady_state(SliderBar.from_scene(_at_amplitude(scene, F0)))
    with Precision.of(_DIGITS).working():
        mechanism = _mechanism(scene, F0, near.periods)
        centre = [arb(float(value)) for value in near.state]
        # Newton's method for P(c) = c, in balls of no width.
        for _ in range(_REFINEMENTS):
            motion = _motion_from(mechanism, StateSet.box(centre), _DIGITS)
            slope = motion.derivative()
            correction = (identity(2) - slope).solve(
                column(b - a for a, b in zip(centre, motion.end.hull()))
            )
            centre = [(c + correction[i, 0]).mid() for i, c in enumerate(centre)]
        # Find the largest B on which the map is proven to contract, because the motion from the start
        # enters it soonest.
        frame = _frame(slope)
        reason = ""
        for exponent in range(_LARGEST, _DIGITS, _SMALLER):
            states = StateSet(tuple(centre), frame, (arb(10.0**-exponent) * arb(0, 1),) * 2)
            try:
                return proven_on(scene, F0, near.periods, states, _DIGITS)
            except ArithmeticError as error:
                reason = str(error)
        raise NotProven(reason)


def _at_amplitude(scene: Scene, F0: Fraction) -> Scene:
    """Return the scene with an amplitude of its load, N."""
    [load] = scene.forces
    return vary(scene, {f"forces.{load}.law.amplitude": str(F0)})


def _mechanism(scene: Scene, F0: Fraction, count: int) -> SlidingMass:
    """Return the slider-bar over n = count common periods T of bar and load; raise NotProven if there are none."""
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
    """Return the motion from all states of a set, none of which is at rest."""
    x, speed = states.hull()
    return prove(replace(mechanism, q=[x], v=[speed], at_rest=False), Precision.of(digits), states)


def proven_on(
    scene: Scene, F0: Fraction, count: int, states: StateSet, digits: int
) -> ProvenSteadyState:
    """Prove both inequalities for a set B at an amplitude F0, and that the scene's start leads into B.

    The working precision must be that of the digits.

    Raises
    ------
    NotProven
        If a claim is not proven.
    """
    mechanism = _mechanism(scene, F0, count)
    centre, frame = list(states.centre), states.frame
    inverse, radius = frame.inv(), min((size.rad() for size in states.size), key=float)

    # q = ||W^-1 DP W|| on all of B, and the residual ||W^-1 (P(c) - c)|| at its centre: Banach's
    # two inequalities.
    motion = _motion_from(mechanism, states, digits)
    rate = _norm(inverse * motion.derivative() * frame)
    image = _motion_from(mechanism, StateSet.box(centre), digits).end.hull()
    residual = _norm(inverse * column(b - a for a, b in zip(centre, image)))
    if not (rate < 1 and residual <= (1 - rate) * radius):
        raise NotProven(
            f"F0 = {float(F0):.12g} N: no contraction: factor {rate.str(5)}, residual {residual.str(3)}"
        )
    # The fixed point lies within residual / (1 - q) of the centre, in the coordinates of the frame.
    tight = residual / (1 - rate)
    state = [
        c + sum((abs(frame[i, j]) for j in range(2)), arb(0)) * tight * arb(0, 1)
        for i, c in enumerate(centre)
    ]
    sticks = any(event.kind == "stick" for event in motion.events) or motion.legs[0].mode[0] == 0
    periods = _reached(mechanism, states, Precision.of(digits))
    return ProvenSteadyState(
        F0,
        mechanism.t_end,
        tuple(state),
        float(rate.upper()),
        states,
        count,
        periods,
        motion.events,
        sticks,
        digits,
    )


def _frame(slope: arb_mat) -> arb_mat:
    """Return a basis in which a derivative has a small norm: real and imaginary parts of its eigenvectors."""
    values, vectors = np.linalg.eig(middles(slope))
    basis = vectors
    if np.iscomplexobj(values):
        basis = np.column_stack([vectors[:, 0].real, vectors[:, 0].imag])
    return arb_mat(basis.tolist())


def _norm(matrix: arb_mat) -> arb:
    """Return an upper bound of the largest sum of absolute values of a row."""
    return max((sum(map(abs, row), arb(0)).upper() for row in matrix.tolist()), key=float)


def _reached(mechanism: SlidingMass, states: StateSet, precision: Precision) -> int:
    """Return the number of periods after which the motion from the scene's start is proven to be in a set."""
    current, start = mechanism, None
    for count in range(1, _PERIODS + 1):
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
        f"the motion from the scene's start is not near the periodic one after {_PERIODS} periods"
    )
