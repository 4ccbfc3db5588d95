"""Mass on a spring with dry friction: its motion, phase by phase in closed form.

    m x'' = -k (x - x0) + F0 + P sin(Omega t + phi) - mu N sgn(x' - u)

with a surface that moves at constant speed u (u = 0: Den Hartog's oscillator, otherwise a mass on a belt). In slip this
is a linear oscillator about a shifted centre, in stick x' = u. A constant bound of friction (`friction` of the guide)
adds to mu N, and `static_friction` to mus N. A phase ends at the first zero of an elementary function whose third
derivative is bounded. `first_zero` approaches it from the left by steps within which the Taylor polynomial minus the
bound is positive. It cannot overlook a zero, and converges like Newton's method.
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
"""Fraction of 1/wn within which a slip phase does not end, although it starts at relative velocity zero."""
_REAL = 1e-12
"""Imaginary part, relative to 1 and the real part, up to which a root of the bounding cubic is real: its rounding."""
_CONVERGED = 4 * EPS
"""Step towards a zero, relative to 1 s and the time, at which the time is exact to rounding."""
_RESONANCE = 1e-6
"""Relative distance from resonance, k = m Omega^2, within which the forced amplitude loses six digits."""
_ROUNDING = 8 * EPS
"""Relative rounding of each phase; those of all phases add up."""
_SAMPLES = 2000
"""Number of instants at which the magnitude of columns is taken; it scales the rounding, and need not be exact."""


def first_zero(
    function: Callable[[float], tuple[float, float, float]], bound: float, start: float, end: float
) -> float:
    """Return the first t >= start at which a positive function reaches zero; inf if there is none before end.

    `function` returns the value and the first two derivatives; `bound` is the bound of the third derivative.
    """
    t = start
    while t < end:
        value, first, second = function(t)
        if value <= 0:
            return t
        # value + first h + second h^2/2 - bound h^3/6 is a lower bound of the function at t + h. Up to
        # its first root the function has no zero, so that the step to the root overlooks none. At a
        # simple zero the steps converge quadratically.
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
    """A mass on a spring with friction on a surface of constant speed; see the module's equation.

    Attributes
    ----------
    mass, stiffness, anchor : float
        m (kg), k (N/m) and x0 (m).
    load : Sine
        F0 + P sin(Omega t + phi), N.
    speed : float
        Speed u of the surface, m/s.
    normal : float
        Normal force R of the guide, N, which yields N by `slider_contact.py` with M = 0 (|R| unless mu b > a).
    contact : Contact
        Dimensions and coefficients of the guide.
    x, v : float
        Position (m) and velocity (m/s) at t = 0.
    bound, static_bound : float
        Constant parts of the bounds of friction in slip and at rest, N.
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
        """Return the largest friction by a coefficient, N."""
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
        """Return the load at times t (s), or one of its derivatives."""
        # The derivative of a sine is its frequency times a sine that leads by a quarter of a turn.
        f = self.load
        constant = f.offset if derivative == 0 else 0.0
        angle = f.frequency * t + f.phase + derivative * np.pi / 2
        return constant + f.amplitude * f.frequency**derivative * np.sin(angle)


@dataclass(frozen=True)
class Phase:
    """A phase of slip or stick.

    Attributes
    ----------
    oscillator : DryOscillator
        The oscillator.
    slip : int
        sgn(x' - u), or 0 in stick.
    start, x, v : float
        Time (s), position (m) and velocity (m/s) at the start.
    end : float
        End of the phase, s.
    """

    oscillator: DryOscillator
    slip: int
    start: float
    x: float
    v: float
    end: float = np.inf

    def _slip_solution(self) -> tuple[float, float, float, float]:
        """Return the centre, the amplitude of the forced part, and the cosine and sine amplitudes of the free part."""
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
        """Return the derivative of x of an order (0: x itself) at times t (s)."""
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
        """Return the friction on the mass (N) at times t (s), by Coulomb's law in slip and by equilibrium in stick."""
        o = self.oscillator
        if self.slip:
            return -self.slip * o.kinetic_friction + 0.0 * t
        return o.stiffness * (self.derivative(t, 0) - o.anchor) - o.forcing(t)

    def close(self, t_end: float) -> Phase:
        """Return the phase with its end: relative velocity zero in slip, static friction exhausted in stick.

        The end is inf if it is not before `t_end` (s).
        """
        o = self.oscillator
        if self.slip:
            # The third derivative of the relative velocity is the fourth derivative of x, which is
            # bounded by the amplitudes of both of its parts. A phase that begins at relative velocity
            # zero would end at once; its zeros are sought a little later.
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
            # Find the first zero of the reserves of static friction in both directions. Friction is
            # linear in time except for the load's sine.
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
        # The mass sticks if static friction suffices for equilibrium, and otherwise slips against the
        # friction that equilibrium requires. After a stick phase static friction is exhausted, which
        # is not decided by the rounded number.
        o = self.oscillator
        x = float(self.derivative(self.end, 0))
        needed = float(replace(self, slip=0, start=self.end, x=x).friction(self.end))
        sticks = self.slip != 0 and abs(needed) < o.static_friction
        if not sticks:
            o.contact.require_unique_slip(self.end)
        slip = 0 if sticks else -int(np.sign(needed))
        return Phase(o, slip, self.end, x, o.speed)

    def sample(self, t: np.ndarray) -> list[np.ndarray]:
        """Return x, v, a, friction and direction of slip at times t (s)."""
        return [
            *(self.derivative(t, order) for order in range(3)),
            self.friction(t),
            np.full(len(t), self.slip),
        ]


def phases(o: DryOscillator, t_end: float) -> list[Phase]:
    """Return the motion of an oscillator from its start to t_end."""
    first = Phase(o, int(np.sign(o.v - o.speed)), 0.0, o.x, o.v)
    if first.slip == 0:
        # A start at rest is the phase that follows a slip phase of zero length.
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
        # At an event the side selects the phase before or after it.
        owner = np.searchsorted(ends, t, side="right" if side == "after" else "left")
        sampled = np.empty((5, len(t)))
        for i in np.unique(owner):
            sampled[:, owner == i] = motion[i].sample(t[owner == i])
        x, v, a, friction, mode = sampled
        # A guide with a constant bound has no length, and no friction of its surfaces that phi would
        # divide.
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
    """Return the oscillator of a scene that matches a structure; raise NotThisMechanism at resonance."""
    body, spring = scene.bodies[match.bodies["mass"]], match["spring"]
    if spring.axis is None and spring.points[1][1] != body.position[1]:
        raise structure.misfit(
            scene, f"{match.name('spring')}: expected both of its ends at the same height"
        )
    if match["guide"].friction is not None and match["guide"].length is not None:
        raise structure.misfit(
            scene, f"{match.name('guide')}: expected no length beside a constant bound of friction"
        )
    # A constant force, or none, is a sine without amplitude.
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
