"""Mass on a spring with dry friction: Den Hartog's closed forms and the whole motion, phase by phase in closed form.

    m x'' = -k (x - x0) + F0 + P sin(Omega t + phi) - mu N sgn(x' - u)

with a surface that moves at constant speed u (0: Den Hartog's oscillator; not 0: mass on a belt). In slip this
is a linear oscillator about a shifted centre, in stick x' = u, and a phase ends at the first zero of an
elementary function whose third derivative is bounded. `first_zero` steps towards it from the left over
h where the Taylor polynomial minus the bound is positive: it can overlook no zero, and converges like Newton's method.

Source of the closed forms: J. P. Den Hartog, Forced vibrations with combined Coulomb and viscous friction,
Trans. ASME 53 (1931), APM-53-9; scaled with wn = 1, P/k = 1, b = mu N / P, r = Omega / wn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from stiction.comparisons.truth.reduced.slider_contact import Contact
from stiction.comparisons.truth.truth import CLOSED_FORM, NotThisMechanism, Truth
from stiction.scenes import Event, Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, Linear, Sine
from stiction.scenes.model import Force, LinearSpring

_STARTING = 1e-6
"""Fraction of 1/wn for which a slip phase is known not to end (it starts at relative velocity zero)."""
_EPS = np.finfo(float).eps


def non_stop_peak(r: float, b: float) -> float:
    """Largest displacement over P/k of the steady motion without stops: sqrt(V^2 - b^2 U^2).

    Valid for r > 0 except 1 and 1/n with odd n (poles of V and U) and b up to `non_stop_limit`. At r = 1/n with
    even n, U = 0 and the peak does not depend on b.

    Raises
    ------
    ValueError
        Outside of that domain.
    """
    limit = non_stop_limit(r)
    if not 0 <= b <= limit:
        raise ValueError(f"b: found {b:g}; a motion without stops at r = {r:g} exists for 0 <= b <= {limit:.6g}")
    V, U = _response(r)
    return float(np.sqrt(V * V - b * b * U * U))


def non_stop_limit(r: float) -> float:
    """Largest b = mu N / P for which the steady motion has no stops: |V| / sqrt(U^2 + (S / r^2)^2).

    S = max over 0 < s < pi of [r sin(s/r) + U r^2 (cos s - cos(s/r))] / sin s, whose limits are 1 at 0, where the
    motion reverses, and -1 at pi.

    Raises
    ------
    ValueError
        Where V or U has a pole: r <= 0, r = 1 and r = 1/n with odd n.
    """
    V, U = _response(r)

    def quotient(s: np.ndarray) -> np.ndarray:
        return (r * np.sin(s / r) + U * r * r * (np.cos(s) - np.cos(s / r))) / np.sin(s)

    grid = np.linspace(0, np.pi, 4001)[1:-1]
    best = int(np.argmax(quotient(grid)))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    peak = minimize_scalar(lambda s: -quotient(s), bounds=bounds, method="bounded", options={"xatol": 1e-10})
    S = max(-peak.fun, 1.0)
    return float(abs(V) / np.sqrt(U * U + (S / (r * r)) ** 2))


def _response(r: float) -> tuple[float, float]:
    if not (r > 0 and abs(r - 1) > 1e-9 and abs(1 + np.cos(np.pi / r)) > 1e-12):
        raise ValueError(f"r: found {r:g}; expected a positive ratio other than 1 and 1/n with odd n")
    return 1 / (1 - r * r), np.sin(np.pi / r) / (r * (1 + np.cos(np.pi / r)))


def first_zero(function: Callable[[float], tuple[float, float, float]], bound: float, start: float,
               end: float) -> float:
    """First t >= start at which a positive function reaches zero; inf if it does not before end.

    Parameters
    ----------
    function
        Value, first and second derivative at t.
    bound
        On the third derivative.
    """
    t = start
    while t < end:
        value, first, second = function(t)
        if value <= 0:
            return t
        roots = np.roots([-bound / 6, second / 2, first, value]) if bound else np.roots([second / 2, first, value])
        ahead = roots.real[(np.abs(roots.imag) < 1e-12 * (1 + np.abs(roots.real))) & (roots.real > 0)]
        step = ahead.min() if len(ahead) else np.inf
        if step <= 4 * _EPS * max(t, 1.0):
            return t
        t += step
    return np.inf


@dataclass(frozen=True)
class DryOscillator:
    """A mass on a spring that rubs on a surface of constant speed; symbols as in the module's equation.

    `normal`: normal force R of the guide, from which `slider.py` with M = 0 gives N (|R| unless mu b > a).
    """

    mass: float
    stiffness: float
    anchor: float
    offset: float
    amplitude: float
    frequency: float
    phase: float
    speed: float
    normal: float
    contact: Contact
    x: float
    v: float

    @property
    def w(self) -> float:
        """Natural frequency wn, rad/s."""
        return float(np.sqrt(self.stiffness / self.mass))

    def capacity(self, coefficient: float) -> float:
        """coefficient * N with friction fully mobilized at that coefficient, N."""
        n1, n2 = self.contact.corners(self.normal, 0.0, coefficient)
        return coefficient * (abs(n1) + abs(n2))

    def forcing(self, t, derivative: int = 0):
        """F0 + P sin(Omega t + phi) or a derivative of it."""
        return (self.offset if derivative == 0 else 0.0) + self.amplitude * self.frequency ** derivative * np.sin(
            self.frequency * t + self.phase + derivative * np.pi / 2)


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
        o = self.oscillator
        centre = o.anchor + (o.offset - self.slip * o.capacity(o.contact.mu)) / o.stiffness
        forced = o.amplitude / (o.stiffness - o.mass * o.frequency ** 2) if o.amplitude else 0.0
        angle = o.frequency * self.start + o.phase
        return (centre, forced, self.x - centre - forced * np.sin(angle),
                (self.v - forced * o.frequency * np.cos(angle)) / o.w)

    def derivative(self, t, order: int):
        """x (order 0), its velocity, acceleration, ... at times t."""
        o = self.oscillator
        if self.slip == 0:
            return [self.x + o.speed * (t - self.start), o.speed + 0.0 * t, 0.0 * t][order]
        centre, forced, cosine, sine = self._slip_solution()
        turn = order * np.pi / 2
        angle = o.w * (t - self.start) + turn
        return ((centre if order == 0 else 0.0)
                + forced * o.frequency ** order * np.sin(o.frequency * t + o.phase + turn)
                + o.w ** order * (cosine * np.cos(angle) + sine * np.sin(angle)))

    def friction(self, t):
        """Force on the mass: given by Coulomb's law in slip, by equilibrium in stick."""
        o = self.oscillator
        if self.slip:
            return -self.slip * o.capacity(o.contact.mu) + 0.0 * t
        return o.stiffness * (self.derivative(t, 0) - o.anchor) - o.forcing(t)

    def close(self, t_end: float) -> Phase:
        """The phase with its end: relative velocity zero in slip, static friction exhausted in stick."""
        o = self.oscillator
        if self.slip:
            _, forced, cosine, sine = self._slip_solution()
            bound = abs(forced) * o.frequency ** 4 + o.w ** 4 * np.hypot(cosine, sine)
            start = self.start + (_STARTING / o.w if self.v == o.speed else 0.0)
            end = first_zero(lambda t: (self.slip * (self.derivative(t, 1) - o.speed),
                                        self.slip * self.derivative(t, 2), self.slip * self.derivative(t, 3)),
                             bound, start, t_end)
        else:
            bound = abs(o.amplitude) * o.frequency ** 3
            limit = o.capacity(o.contact.mus)
            end = min(first_zero(lambda t: (limit + s * self.friction(t),
                                            s * (o.stiffness * o.speed - o.forcing(t, 1)), -s * o.forcing(t, 2)),
                                 bound, self.start, t_end) for s in (1, -1))
        return replace(self, end=end)

    def next(self) -> Phase:
        """The phase that follows at the end of this one."""
        o = self.oscillator
        x = float(self.derivative(self.end, 0))
        needed = float(replace(self, slip=0, start=self.end, x=x).friction(self.end))
        away = -int(np.sign(needed))
        sticks = self.slip != 0 and abs(needed) < o.capacity(o.contact.mus)
        if not sticks:
            o.contact.require_unique_slip(self.end)
        return Phase(o, 0 if sticks else away, self.end, x, o.speed)


def phases(oscillator: DryOscillator, t_end: float) -> list[Phase]:
    """The motion from its start to t_end."""
    o = oscillator
    relative = int(np.sign(o.v - o.speed))
    first = Phase(o, relative, 0.0, o.x, o.v)
    if relative == 0:
        first = replace(first, slip=1, end=0.0).next()
    found = [first.close(t_end)]
    while found[-1].end < t_end:
        found.append(found[-1].next().close(t_end))
    return found


@dataclass(frozen=True)
class _Names:
    """What the scene calls the parts, and where the moving surface is at t = 0 (None: fixed)."""

    body: str
    guide: str
    belt: str | None = None
    drive: str | None = None
    origin: float = 0.0
    belt_x: float = 0.0


def oscillator_truth(scene: Scene, t_end: float | None = None) -> Truth:
    """The motion of a mass on a spring with dry friction, on a fixed guide or on a belt.

    Parameters
    ----------
    scene
        One frictional guide along the x axis, fixed or on a body that a linear distance drive moves along x; its slider
        on one linear spring to the ground along x, with at most one constant or sine force along x.
    t_end
        Seconds; the scene's own where None.

    Raises
    ------
    NotThisMechanism
        If the scene has another structure, or the forcing is at resonance.
    """
    oscillator, names = _from_scene(scene)
    t_end = scene.t_end if t_end is None else t_end
    motion = phases(oscillator, t_end)

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        return _columns(oscillator, motion, names, t, side)

    events = []
    for before, after in zip(motion, motion[1:]):
        kind = "stick" if after.slip == 0 else "slip" if before.slip == 0 else "reversal"
        time = np.array([after.start])
        sides = [{name: float(value[0]) for name, value in columns(time, side).items()} for side in ("before", "after")]
        events.append(Event(after.start, kind, names.guide, *sides))
    sample = columns(np.linspace(0, t_end, 2000), "after")
    rounding = 8 * _EPS * len(motion)
    uncertainty = {name: rounding * float(np.max(np.abs(value)) + 1) for name, value in sample.items()}
    uncertainty["event time"] = rounding * max(t_end, 1.0)
    return Truth(scene.name, CLOSED_FORM, t_end, columns, uncertainty, tuple(events))


def _columns(oscillator: DryOscillator, motion: list[Phase], names: _Names, t: np.ndarray,
             side: str) -> dict[str, np.ndarray]:
    o = oscillator
    ends = [phase.end for phase in motion[:-1]]
    owner = np.searchsorted(ends, t, side="right" if side == "after" else "left")
    x, v, a, friction, mode = (np.empty(len(t)) for _ in range(5))
    for i in np.unique(owner):
        where = owner == i
        for column, order in ((x, 0), (v, 1), (a, 2)):
            column[where] = motion[i].derivative(t[where], order)
        friction[where], mode[where] = motion[i].friction(t[where]), motion[i].slip
    phi = o.contact.mobilization(o.normal, 0.0, friction)
    values = o.contact.columns(np.full(len(t), o.normal), np.zeros(len(t)), phi)
    values |= {"mode": mode, "displacement": x - names.origin - o.speed * t, "slip_velocity": v - o.speed}
    columns = {f"{names.body}.x": x, f"{names.body}.vx": v, f"{names.body}.ax": a}
    columns |= {f"{names.guide}.{name}": value for name, value in values.items()}
    if names.belt is not None:
        columns |= {f"{names.belt}.x": names.belt_x + o.speed * t, f"{names.belt}.vx": np.full(len(t), o.speed),
                    f"{names.drive}.effort": friction}
    return columns


def _from_scene(scene: Scene) -> tuple[DryOscillator, _Names]:
    def require(condition: bool, text: str) -> None:
        if not condition:
            raise NotThisMechanism(f"{scene.name} is not a mass on a spring with dry friction: {text}")

    def along_x(direction: tuple[float, float] | None) -> bool:
        return direction is not None and direction[0] > 0 and direction[1] == 0

    require(len(scene.frictional_guides) == 1,
            f"joints: found {len(scene.frictional_guides)} frictional guides; expected 1")
    ((guide_name, guide),) = scene.frictional_guides.items()
    require(along_x(guide.direction) and guide.slider_point == (0, 0) and guide.angle == 0,
            f"joints.{guide_name}: expected the slider's centre on a guide along (1, 0), without an angle")
    speed, origin, belt, drive_name, belt_x = 0.0, guide.point[0], None, None, 0.0
    if guide.guide != GROUND:
        belt = guide.guide
        tracks = [joint for joint in scene.guides.values() if joint.slider == belt]
        require(len(tracks) == 1 and tracks[0].guide == GROUND and along_x(tracks[0].direction),
                f"joints: expected {belt} to slide on the ground along (1, 0)")
        drives = [(name, drive) for name, drive in scene.drives.items() if drive.bodies[0] == belt]
        require(len(scene.drives) == 1 and len(drives) == 1 and drives[0][1].type == "distance"
                and along_x(drives[0][1].axis) and isinstance(drives[0][1].law, Linear),
                f"drives: expected one linear distance drive of {belt} along (1, 0)")
        ((drive_name, drive),) = drives
        speed, belt_x = drive.law.rate, scene.bodies[belt].position[0]
        origin += belt_x
    body = scene.bodies[guide.slider]
    require(set(scene.bodies) == {guide.slider, belt} - {None}, f"bodies: found {', '.join(scene.bodies)}")
    require(len(scene.springs) == 1, f"springs: found {len(scene.springs)}; expected 1")
    ((spring_name, spring),) = scene.springs.items()
    require(isinstance(spring, LinearSpring) and spring.bodies == (guide.slider, GROUND) and spring.points[0] == (0, 0)
            and spring.stiffness > 0 and spring.damping == 0
            and (along_x(spring.axis)
                 or spring.axis is None and spring.rest_length == 0 and spring.points[1][1] == body.position[1]),
            f"springs.{spring_name}: expected an undamped linear spring from the slider's centre to the ground along x")
    require(len(scene.forces) <= 1, f"forces: found {len(scene.forces)}; expected at most 1")
    offset, amplitude, frequency, phase = 0.0, 0.0, 0.0, 0.0
    for name, load in scene.forces.items():
        require(isinstance(load, Force) and isinstance(load.law, (Sine, Constant)) and load.body == guide.slider
                and load.point == (0, 0) and along_x(load.direction),
                f"forces.{name}: expected a constant or sine force on the slider's centre along (1, 0)")
        if isinstance(load.law, Sine):
            offset, amplitude = load.law.offset, load.law.amplitude
            frequency, phase = load.law.frequency, load.law.phase
        else:
            offset = load.law.value
    gravity = scene.gravity or (0.0, 0.0)
    resonance = spring.stiffness - body.mass * frequency ** 2
    require(not amplitude or abs(resonance) > 1e-6 * spring.stiffness,
            "the force is at resonance; expected Omega != wn")
    return DryOscillator(body.mass, spring.stiffness, spring.points[1][0] + spring.rest_length,
                         offset + body.mass * gravity[0], amplitude, frequency, phase, speed,
                         -body.mass * gravity[1], Contact.of(guide), body.position[0], body.velocity[0]), \
        _Names(guide.slider, guide_name, belt, drive_name, origin, belt_x)
