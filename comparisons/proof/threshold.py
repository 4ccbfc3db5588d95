"""The largest amplitude of the load for which a periodic motion has a stick phase, between two bounds: a theorem.

P takes the state (x, x') of the slider-bar at t = 0 to that n common periods T of bar and load later. For a set
B = {c + W y : |y1|, |y2| <= e} let N enclose W^-1 DP W on B. Where

    q = ||N||_inf < 1   and   ||W^-1 (P(c) - c)||_inf <= (1 - q) e ,

P maps B into itself and contracts it (Banach). Then exactly one motion of period n T starts in B, and every motion from B tends to it. Its
changes of mode are those proven for all of B at once, so that it has a stick phase or has none. If the motion from the scene's start is in
B after some periods, the periodic motion is the steady state that the scene leads to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat

from stiction.comparisons.proof.enclosures.exact import Exact, ExactScene
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.motion import Precision, ProvenEvent, StateSet, prove
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.comparisons.truth.reduced.steady_state import SteadyState, steady_state, stick_threshold
from stiction.scenes import Scene, StictionError, vary

_DIGITS = 24
_MOST_PLACES = 24
_REFINEMENTS = 6
_PERIODS = 200
"""Periods that the motion from the scene's start may take to come into B."""


class NotProven(StictionError, ArithmeticError):
    """A step of the theorem that does not go through."""


@dataclass(frozen=True)
class ProvenSteadyState:
    """An attracting periodic motion that exists, with what is proven of it.

    Attributes
    ----------
    F0 : Fraction
        Amplitude of the load, N, exact.
    period : arb
        n T, s.
    state : tuple of arb
        (x, x') at t = 0, m and m/s.
    contraction : float
        Upper bound of q.
    states : StateSet
        B.
    count : int
        n.
    periods : int
        After so many n T the motion from the scene's start is in B.
    events : tuple of ProvenEvent
        Of one period.
    sticks : bool
        Whether it has a stick phase.
    precision : Precision
        Of the proof, for `digits` decimal places.
    """

    F0: Fraction
    period: arb
    state: tuple[arb, arb]
    contraction: float
    states: StateSet
    count: int
    periods: int
    events: tuple[ProvenEvent, ...]
    sticks: bool
    precision: Precision
    digits: int

    @property
    def radius(self) -> float:
        """e."""
        return float(self.states.size[0].rad())


@dataclass(frozen=True)
class ProvenThreshold:
    """At `low` the steady state from the scene's start has a stick phase, at `high` it has none."""

    low: ProvenSteadyState
    high: ProvenSteadyState

    @property
    def width(self) -> Fraction:
        """N."""
        return self.high.F0 - self.low.F0

    def sentences(self) -> list[str]:
        """The theorem, with its hypotheses."""
        return ["Hypotheses: the scene's numbers are exact as they are written; rigid bodies; Coulomb's law with mu and mus; the slider rests "
                "exactly while full static friction holds it.",
                *(f"At F0 = {decimal(end.F0)} N the motion from the scene's start tends to a periodic one, the only one near "
                  f"(x, x') = ({end.state[0].str(15)} m, {end.state[1].str(15)} m/s) at t = 0; it "
                  f"{'has a stick phase' if end.sticks else 'has no stick phase'} (period {end.period.str(12)} s, contraction by "
                  f"{end.contraction:.4g} per period on a set of size {end.radius:.0e}, reached after {end.periods} periods)."
                  for end in (self.low, self.high)),
                f"The threshold of stick phases that is crossed there lies between {decimal(self.low.F0)} N and {decimal(self.high.F0)} N."]


def decimal(number: Fraction) -> str:
    """A decimal fraction in full; any other one as a quotient."""
    for places in range(_MOST_PLACES):
        if (number * 10 ** places).denominator == 1:
            digits = str(int(number * 10 ** places)).zfill(places + 1)
            return f"{digits[:-places]}.{digits[-places:]}" if places else digits
    return f"{number.numerator}/{number.denominator}"


def proven_threshold(scene: Scene, places: int = 9) -> ProvenThreshold:
    """Two amplitudes with `places` decimals, 10^-places N apart, about the threshold of `stick_threshold`, and the proofs for them.

    Raises
    ------
    NotThisMechanism
        If the scene is no slider-bar.
    NotProven
        Where no threshold is known to begin with, or a proof does not go through.
    Undecided
        Where the contact mode cannot be proven.
    """
    found = stick_threshold(scene)
    if found.F0 is None:
        raise NotProven(f"{scene.name}: {found.note}")
    unit = Fraction(1, 10 ** places)
    low = (Fraction(found.F0) // unit) * unit  # as exact as floats are; the proofs do not trust it
    ends = [proven_steady_state(scene, F0) for F0 in (low, low + unit)]
    if not ends[0].sticks or ends[1].sticks:
        raise NotProven(f"{scene.name}: stick phase at {float(low):.12g} N: {ends[0].sticks}, at {float(low + unit):.12g} N: {ends[1].sticks}")
    return ProvenThreshold(*ends)


def proven_steady_state(scene: Scene, F0: Fraction) -> ProvenSteadyState:
    """The steady state at an amplitude; raises as `proven_threshold`."""
    loaded = at_amplitude(scene, F0)
    near = steady_state(SliderBar.from_scene(loaded))
    precision = Precision.of(_DIGITS)
    with working(precision.bits, precision.order + 1):
        return _found(loaded, near, F0, precision)


def at_amplitude(scene: Scene, F0: Fraction) -> Scene:
    """The scene with an exact amplitude of its load."""
    ((load, _),) = scene.forces.items()
    return vary(scene, {f"forces.{load}.law.amplitude": f"{F0.numerator}/{F0.denominator}"})


def _period(scene: Scene) -> arb:
    """T, where the ratio of the frequencies is rational."""
    e = ExactScene(scene)
    ((drive, _),), ((load, _),) = scene.drives.items(), scene.forces.items()
    rate, frequency = e("drives", drive, "law", "rate"), e("forces", load, "law", "frequency")
    ratio = (frequency / rate).factors
    if ratio is None or ratio[1] != 0:
        raise NotProven(f"{scene.name}: found frequencies {frequency.ball.str(10)} and {rate.ball.str(10)}; expected a rational ratio")
    return abs(Exact.of(2 * ratio[0].q / (rate.factors[0] if rate.factors else 1), 1 - (rate.factors[1] if rate.factors else 0)).ball)


def _from(mechanism: SlidingMass, states: StateSet) -> SlidingMass:
    """The mechanism started from all states of a set, none of them at rest."""
    x, v = states.hull()
    return replace(mechanism, x=x, speed=v, at_rest=False)


def _return(mechanism: SlidingMass, states: StateSet, precision: Precision):
    motion = prove(_from(mechanism, states), precision, states)
    return motion, motion.end.hull(), motion.derivative()


def _found(scene: Scene, near: SteadyState, F0: Fraction, precision: Precision) -> ProvenSteadyState:
    """B sought about a state that was found in floats."""
    mechanism = replace(SlidingMass.from_scene(scene), t_end=_period(scene) * near.periods)
    centre = [arb(float(value)) for value in near.state]
    one = arb_mat([[1, 0], [0, 1]])
    for _ in range(_REFINEMENTS):
        _, image, slope = _return(mechanism, StateSet.box(centre), precision)
        residual = arb_mat([[b - a] for a, b in zip(centre, image)])
        correction = (one - slope).solve(residual)
        centre = [(c + correction[i, 0]).mid() for i, c in enumerate(centre)]
    frame, reason = _frame(slope), ""
    for exponent in range(8, _DIGITS, 2):
        states = StateSet(tuple(centre), frame, (arb(10.0 ** -exponent) * arb(0, 1),) * 2)
        try:
            return proven_on(scene, F0, near.periods, states, precision)
        except (ArithmeticError, NotProven) as error:
            reason = str(error)
    raise NotProven(reason)


def proven_on(scene: Scene, F0: Fraction, count: int, states: StateSet, precision: Precision,
              digits: int = _DIGITS) -> ProvenSteadyState:
    """The steady state of a scene at its amplitude F0, with B given: both inequalities of the theorem, and that the start leads into B.

    Call it with `series.working` at the precision's bits.

    Raises
    ------
    NotProven
        Where an inequality does not hold, or the start does not lead into B.
    Undecided
        Where the contact mode cannot be proven for all of B.
    """
    mechanism = replace(SlidingMass.from_scene(scene), t_end=_period(scene) * count)
    centre, frame, inverse, radius = list(states.centre), states.frame, states.frame.inv(), min((size.rad() for size in states.size), key=float)
    motion, _, slope = _return(mechanism, states, precision)
    rate = _norm(inverse * slope * frame)
    _, image, _ = _return(mechanism, StateSet.box(centre), precision)
    residual = _norm(inverse * arb_mat([[b - a] for a, b in zip(centre, image)]))
    if not (rate < 1 and residual <= (1 - rate) * radius):
        raise NotProven(f"F0 = {float(F0):.12g} N: no contraction: factor {rate.str(5)}, residual {residual.str(3)}")
    tight = residual / (1 - rate)
    state = [c + sum((abs(frame[i, j]) for j in range(2)), arb(0)) * tight * arb(0, 1) for i, c in enumerate(centre)]
    sticks = any(e.kind == "stick" for e in motion.events) or motion.first.mode[0] == 0
    return ProvenSteadyState(F0, mechanism.t_end, tuple(state), float(rate.upper()), states, count,
                             _reached(mechanism, states, inverse, precision), motion.events, sticks, precision, digits)


def _frame(slope: arb_mat) -> arb_mat:
    """A basis in which a map's derivative has a small norm: real and imaginary parts of its eigenvectors."""
    middle = np.array([[float(slope[i, j].mid()) for j in range(2)] for i in range(2)])
    values, vectors = np.linalg.eig(middle)
    basis = np.column_stack([vectors[:, 0].real, vectors[:, 0].imag]) if np.iscomplexobj(values) else vectors
    return arb_mat(basis.tolist())


def _norm(matrix: arb_mat) -> arb:
    """Largest sum of absolute values of a row: an upper bound."""
    sums = [sum((abs(x) for x in row), arb(0)).upper() for row in matrix.tolist()]
    return max(sums, key=float)


def _reached(mechanism: SlidingMass, states: StateSet, inverse: arb_mat, precision: Precision) -> int:
    """Periods after which the motion from the scene's start is proven to be in a set."""
    current, now = mechanism, None
    for count in range(1, _PERIODS + 1):
        motion = prove(current, precision, now)
        now = motion.end
        held = motion.mechanism.held(motion.steps[-1].end_mode)
        hull = now.hull()
        if held:
            now = StateSet.box([hull[0], held[0]])
        current = replace(mechanism, x=now.hull()[0], speed=now.hull()[1], at_rest=bool(held))
        y = inverse * arb_mat([[x - c] for x, c in zip(hull, states.centre)])
        if all(size.contains(y[i, 0]) for i, size in enumerate(states.size)):
            return count
    raise NotProven(f"the motion from the scene's start is not near the periodic one after {_PERIODS} periods")
