"""Mass on a spring with dry friction: its motion, phase by phase in closed form.

    m x'' = -k (x - x0) + F0 + P sin(Omega t + phi) - mu N sgn(x' - u)

with a surface that moves at constant speed u (0: Den Hartog's oscillator; not 0: mass on a belt). In slip this is a
linear oscillator about a shifted centre, in stick x' = u. A constant bound of friction (`friction` of the guide) adds
to mu N, and `static_friction` to mus N. A phase ends at the first zero of an elementary function
whose third derivative is bounded. `first_zero` steps towards it from the left over h where the Taylor polynomial minus
the bound is positive: it can overlook no zero, and converges like Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, Sine
from stiction.scenes.model import Drive, Force, LinearSpring, Translational
from stiction.truths.reduced.slider_contact import Contact
from stiction.truths.structure import (
    ANY,
    CENTRE,
    FORWARD,
    OPTIONAL,
    POSITIVE,
    PULLS_ALONG_X,
    Match,
    Part,
    Structure,
)
from stiction.truths.truth import EPS, Truth, kind_of_change

_GUIDE: dict[str, Any] = {
    "direction": FORWARD,
    "slider_point": CENTRE,
    "angle": 0,
    "frictional": True,
    "friction": ANY,
    "static_friction": ANY,
}
_OTHERS = {
    "spring": Part(
        LinearSpring,
        "mass",
        GROUND,
        points=(CENTRE, ANY),
        stiffness=POSITIVE,
        damping=0,
        where=PULLS_ALONG_X,
    ),
    "force": Part(
        Force, "mass", count=OPTIONAL, point=CENTRE, direction=FORWARD, law=Constant | Sine
    ),
}
ON_GROUND = Structure(
    "a mass on a spring with dry friction",
    ("mass",),
    {"guide": Part(Translational, "mass", GROUND, **_GUIDE), **_OTHERS},
    any_names=True,
)
ON_BELT = Structure(
    "a mass on a spring with dry friction, on a belt",
    ("mass", "belt"),
    {
        "guide": Part(Translational, "mass", "belt", **_GUIDE),
        **_OTHERS,
        "track": Part(Translational, "belt", GROUND, direction=FORWARD, frictional=False),
        "drive": Part(Drive, "belt", GROUND, type="distance", axis=FORWARD, law=Linear),
    },
    any_names=True,
)
_STARTING = 1e-6
"""Fraction of 1/wn for which a slip phase is known not to end (it starts at relative velocity zero)."""
_REAL = 1e-12
"""Imaginary part, relative to 1 and the real part, up to which a root of the bounding cubic is real: its rounding."""
_CONVERGED = 4 * EPS
"""Step towards a zero, relative to 1 s and the time, at which the time is exact to rounding."""
_RESONANCE = 1e-6
"""Relative distance from resonance, k = m Omega^2, within which the forced amplitude loses six digits."""
_ROUNDING = 8 * EPS
"""Relative rounding of each phase; those of all phases add up."""
_SAMPLES = 2000
"""Instants at which the size of columns is taken; it scales the rounding, and need not be exact."""


def first_zero(
    function: Callable[[float], tuple[float, float, float]], bound: float, start: float, end: float
) -> float:
    """Find the first t >= start at which a positive function reaches zero; inf if it does not before end.

    The function gives its value, first and second derivative; `bound` is that of the third.
    """
    t = start
    while t < end:
        value, first, second = function(t)
        if value <= 0:
            return t
        # value + first h + second h^2/2 - bound h^3/6 is a lower bound of the function ahead. Up to
        # its first root there is no zero, so that the step to it passes over none; at a simple zero
        # the steps shrink quadratically.
        coefficients = [second / 2, first, value]
        if bound:
            coefficients.insert(0, -bound / 6)
        roots = np.roots(coefficients)
        real = np.abs(roots.imag) < _REAL * (1 + np.abs(roots.real))
        ahead = roots.real[real & (roots.real > 0)]
        step = ahead.min() if len(ahead) else np.inf
        if step <= _CONVERGED * max(t, 1.0):
            return t
        t += step
    return np.inf


@dataclass(frozen=True)
class DryOscillator:
    """A mass on a spring that rubs on a surface of constant speed; symbols as in the module's equation.

    `load` is F0 + P sin(Omega t + phi); of the `normal` force R of the guide `slider_contact.py` with M = 0 makes N
    (|R| unless mu b > a). `bound` and `static_bound` are the constant parts of the bounds of friction, N.
    """

    mass: float
    stiffness: float
    anchor: float
    load: Sine
    speed: float
    normal: float
    contact: Contact
    x: float
    v: float
    bound: float = 0.0
    static_bound: float = 0.0

    @property
    def w(self) -> float:
        """Natural frequency wn, rad/s."""
        return float(np.sqrt(self.stiffness / self.mass))

    def capacity(self, coefficient: float) -> float:
        """coefficient * N with friction fully mobilized at that coefficient, N."""
        return self.contact.capacity(self.normal, 0.0, coefficient)

    @property
    def kinetic_friction(self) -> float:
        """The friction in slip, N."""
        return self.bound + self.capacity(self.contact.mu)

    @property
    def static_friction(self) -> float:
        """The largest friction at rest, N."""
        return self.static_bound + self.capacity(self.contact.mus)

    def forcing(self, t, derivative: int = 0):
        """The load or a derivative of it."""
        # a derivative of a sine is a sine a quarter of a turn ahead, times its frequency
        f = self.load
        constant = f.offset if derivative == 0 else 0.0
        angle = f.frequency * t + f.phase + derivative * np.pi / 2
        return constant + f.amplitude * f.frequency**derivative * np.sin(angle)


@dataclass(frozen=True)
class Phase:
    """Slip along `slip` = sgn(x' - u), or stick (0), from (start, x, v) to end."""

    oscillator: DryOscillator
    slip: int
    start: float
    x: float
    v: float
    end: float = np.inf

    def _slip_solution(self) -> tuple[float, float, float, float]:
        """Centre, amplitude of the forced part, and cosine and sine amplitude of the free part."""
        o, f = self.oscillator, self.oscillator.load
        centre = o.anchor + (f.offset - self.slip * o.kinetic_friction) / o.stiffness
        forced = f.amplitude / (o.stiffness - o.mass * f.frequency**2) if f.amplitude else 0.0
        angle = f.frequency * self.start + f.phase
        return (
            centre,
            forced,
            self.x - centre - forced * np.sin(angle),
            (self.v - forced * f.frequency * np.cos(angle)) / o.w,
        )

    def derivative(self, t, order: int):
        """x (order 0), its velocity, acceleration, ... at times t."""
        o, f = self.oscillator, self.oscillator.load
        if self.slip == 0:
            return [self.x + o.speed * (t - self.start), o.speed + 0.0 * t, 0.0 * t][order]
        centre, forced, cosine, sine = self._slip_solution()
        turn = order * np.pi / 2
        angle = o.w * (t - self.start) + turn
        return (
            (centre if order == 0 else 0.0)
            + forced * f.frequency**order * np.sin(f.frequency * t + f.phase + turn)
            + o.w**order * (cosine * np.cos(angle) + sine * np.sin(angle))
        )

    def friction(self, t):
        """Force on the mass: given by Coulomb's law in slip, by equilibrium in stick."""
        o = self.oscillator
        if self.slip:
            return -self.slip * o.kinetic_friction + 0.0 * t
        return o.stiffness * (self.derivative(t, 0) - o.anchor) - o.forcing(t)

    def close(self, t_end: float) -> Phase:
        """Return the phase with its end: relative velocity zero in slip, static friction exhausted in stick."""
        o = self.oscillator
        if self.slip:
            # Relative velocity: its third derivative is the fourth of x, bounded by the amplitudes
            # of both its parts. A phase that begins at relative velocity zero would end at once: it
            # starts to be looked at a little later.
            _, forced, cosine, sine = self._slip_solution()
            bound = abs(forced) * o.load.frequency**4 + o.w**4 * np.hypot(cosine, sine)
            start = self.start + (_STARTING / o.w if self.v == o.speed else 0.0)
            end = first_zero(
                lambda t: (
                    self.slip * (self.derivative(t, 1) - o.speed),
                    self.slip * self.derivative(t, 2),
                    self.slip * self.derivative(t, 3),
                ),
                bound,
                start,
                t_end,
            )
        else:
            # Reserve of static friction in both directions: friction is linear in time but for the
            # load's sine.
            bound = abs(o.load.amplitude) * o.load.frequency**3
            limit = o.static_friction
            end = min(
                first_zero(
                    lambda t: (
                        limit + s * self.friction(t),
                        s * (o.stiffness * o.speed - o.forcing(t, 1)),
                        -s * o.forcing(t, 2),
                    ),
                    bound,
                    self.start,
                    t_end,
                )
                for s in (1, -1)
            )
        return replace(self, end=end)

    def next(self) -> Phase:
        """Return the phase that follows at the end of this one."""
        # Friction that stick would need decides: it sticks if static friction can supply it, else
        # it slips against it. After a stick phase static friction is exhausted, which rounding must
        # not deny.
        o = self.oscillator
        x = float(self.derivative(self.end, 0))
        needed = float(replace(self, slip=0, start=self.end, x=x).friction(self.end))
        sticks = self.slip != 0 and abs(needed) < o.static_friction
        if not sticks:
            o.contact.require_unique_slip(self.end)
        return Phase(o, 0 if sticks else -int(np.sign(needed)), self.end, x, o.speed)

    def sample(self, t: np.ndarray) -> list[np.ndarray]:
        """x, v, a, friction and direction of slip at times t."""
        return [
            *(self.derivative(t, order) for order in range(3)),
            self.friction(t),
            np.full(len(t), self.slip),
        ]


def phases(o: DryOscillator, t_end: float) -> list[Phase]:
    """Return the motion of an oscillator from its start to t_end."""
    first = Phase(o, int(np.sign(o.v - o.speed)), 0.0, o.x, o.v)
    if first.slip == 0:
        # a start at rest is what follows a slip phase of no length
        first = replace(first, slip=1, end=0.0).next()
    motion = [first.close(t_end)]
    while motion[-1].end < t_end:
        motion.append(motion[-1].next().close(t_end))
    return motion


def oscillator_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """Return the motion of a mass on a spring with dry friction, on a fixed guide or on a belt, off resonance."""
    t_end = scene.t_end if t_end is None else t_end
    structure = ON_BELT if len(scene.bodies) == 2 else ON_GROUND
    match = structure.match(scene)
    o = _read_oscillator(scene, structure, match)
    motion = phases(o, t_end)
    ends = [phase.end for phase in motion[:-1]]
    guide = match.name("guide")
    mass, belt = match.bodies["mass"], match.bodies.get("belt")
    belt_x = scene.bodies[belt].position[0] if belt else 0.0
    origin = match["guide"].point[0] + belt_x
    has_bound = match["guide"].friction is not None

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        # an event belongs to the phase before or after it
        owner = np.searchsorted(ends, t, side="right" if side == "after" else "left")
        sampled = np.empty((5, len(t)))
        for i in np.unique(owner):
            sampled[:, owner == i] = motion[i].sample(t[owner == i])
        x, v, a, friction, mode = sampled
        # a guide with a constant bound has no length, and no friction of its surfaces that phi would split
        phi = 0.0 * t if has_bound else o.contact.mobilization(o.normal, 0.0, friction)
        values = {f"{mass}.x": x, f"{mass}.vx": v, f"{mass}.ax": a}
        values |= o.contact.columns(
            guide,
            np.full(len(t), o.normal),
            np.zeros(len(t)),
            phi,
            mode,
            displacement=x - origin - o.speed * t,
            slip_velocity=v - o.speed,
        )
        if has_bound:
            values[f"{guide}.friction"] = friction
        if belt:
            values |= {
                f"{belt}.x": belt_x + o.speed * t,
                f"{belt}.vx": np.full(len(t), o.speed),
                f"{match.name('drive')}.effort": friction,
            }
        return values

    switches = [
        (after.start, kind_of_change(before.slip, after.slip), guide)
        for before, after in zip(motion, motion[1:])
    ]
    rounding = _ROUNDING * len(motion)
    return Truth.of_formulas(scene, t_end, columns, rounding, _SAMPLES, switches)


def _read_oscillator(scene: Scene, structure: Structure, match: Match) -> DryOscillator:
    """Read the parameters of a scene."""
    body, spring = scene.bodies[match.bodies["mass"]], match["spring"]
    if spring.axis is None and spring.points[1][1] != body.position[1]:
        raise structure.misfit(
            scene, f"{match.name('spring')}: expected both of its ends at the same height"
        )
    if match["guide"].friction is not None and match["guide"].length is not None:
        raise structure.misfit(
            scene, f"{match.name('guide')}: expected no length beside a constant bound of friction"
        )
    # a constant force, or none, is a sine without amplitude
    load = match["force"].law if match["force"] else None
    if not isinstance(load, Sine):
        load = Sine(type="sine", offset=load.value if load else 0.0, amplitude=0.0, frequency=0.0)
    detuning = abs(spring.stiffness - body.mass * load.frequency**2)
    if load.amplitude and detuning <= _RESONANCE * spring.stiffness:
        raise structure.misfit(
            scene, f"{match.name('force')}: found resonance; expected Omega != wn"
        )
    gx, gy = scene.gravity or (0.0, 0.0)
    return DryOscillator(
        body.mass,
        spring.stiffness,
        spring.points[1][0] + spring.rest_length,
        load.model_copy(update={"offset": load.offset + body.mass * gx}),
        match["drive"].law.rate if structure is ON_BELT else 0.0,
        -body.mass * gy,
        Contact.of(match["guide"]),
        body.position[0],
        body.velocity[0],
        *match["guide"].bounds,
    )
