"""An elliptic trammel: a bar between two sliders with friction, one on a horizontal and one on a vertical guide.

One degree of freedom: p is the angle of the bar below its own direction, from the upper left pin (0, L sin p) down to
(L cos p, 0); the bar's centre of mass is (ly cos p, lx sin p), lx + ly = L. By Lagrange's equation, with the frictions
fx, fy of the guides as applied forces,

    (J + K sin^2 p) p'' + K sin p cos p p'^2 = -Hx gx sin p + Hy gy cos p - T - L fx sin p + L fy cos p ,
    J = I + m lx^2 + my L^2 ,   K = m (ly^2 - lx^2) + (mx - my) L^2 ,   Hx = m ly + mx L ,   Hy = m lx + my L ,

and by the balances of momentum of the whole, of mass M, across the guides (Ry acts on slider y along -x),

    Rx + fy = Hy (sin p)'' - M gy =: A ,     Ry - fx = -Hx (cos p)'' + M gx =: B .

The truth of the trammel starts from the balances of every body instead: each is a check of the other.

The sliders do not turn and their pins are smooth. So with mu b < a both corners of a slider press on the same surface,
and N = |R|. With the slips sx, sy and the signs ex, ey of Rx, Ry, fx = cx Rx and fy = cy Ry, c = -mu s e, whence

    Rx = (A - cy B) / (1 + cx cy) ,     Ry = (B + cx A) / (1 + cx cy) .

For mu < 1 on both guides Rx and Ry are unique for a given p'' (each equation contracts) and continuous, piecewise
linear functions of it; so is Lagrange's equation. p'' is unique where its slope is positive for all four choices of
(ex, ey).

A slip changes its direction with p', and at the dead point of its slider, where the reactions jump. Where p' reaches
zero both guides rest at once, and what each holds is open (they are statically indeterminate): the proof ends there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

from flint import arb, arb_series

from stiction.scenes import Scene
from stiction.scenes.laws import Constant, Sine
from stiction.scenes.model import Torque
from stiction.truths.proof.enclosures.series import Value, constants, quotient
from stiction.truths.proof.enclosures.zeros import Undecided
from stiction.truths.proof.mechanisms.mechanism import Load, Next, ProvableMechanism
from stiction.truths.proof.mechanisms.scene_reader import SceneReader, balls
from stiction.truths.reduced.trammel import TRAMMEL
from stiction.truths.structure import SEVERAL, Part

Mode = tuple[int, int, int, int, int]
"""Direction of p', sx, sy, ex, ey."""
_TURN = 0
"""Index of the direction of p' in a mode."""
_NORMALS = 3
"""Index of the first sign of a normal force in a mode."""
_SIGNS = tuple(product((1, -1), (1, -1)))
"""Possible signs of two normal forces."""
GUIDES = ("guide-x", "guide-y")
SLIDERS = ("slider-x", "slider-y")
PROVABLE = replace(
    TRAMMEL,
    parts={label: TRAMMEL.parts[label] for label in ("pin-x", "pin-y", *GUIDES)}
    | {"torques": Part(Torque, "bar", count=SEVERAL, law=Constant | Sine)},
)


@dataclass(frozen=True, kw_only=True)
class Trammel(ProvableMechanism):
    """Parameters as in the module's text.

    `arms` are lx, ly; `inertia` J, K; `moments` Hx, Hy; `torque` is the constant part of T, `loads` the others.
    """

    arms: tuple[arb, ...]
    inertia: tuple[arb, ...]
    moments: tuple[arb, ...]
    mass: arb
    gravity: tuple[arb, ...]
    friction: tuple[arb, ...]
    torque: arb
    loads: tuple[Load, ...]

    @property
    def length(self) -> arb:
        """Distance of the pins L, m."""
        return self.arms[0] + self.arms[1]

    def _coefficients(self, mode: Mode) -> tuple[arb, arb]:
        """Return cx and cy."""
        _, sx, sy, ex, ey = mode
        return self.friction[0] * (-sx * ex), self.friction[1] * (-sy * ey)

    def _reactions(
        self, sine: Value, cosine: Value, rate: Value, mode: Mode
    ) -> tuple[tuple[Value, Value], tuple[Value, Value]]:
        """Return Rx and Ry, each as the part without p'' and the factor of p''."""
        cx, cy = self._coefficients(mode)
        (Hx, Hy), (gx, gy) = self.moments, self.gravity
        square, common = rate * rate, 1 / (1 + cx * cy)
        # A and B, each as A0 + A1 p'': (sin p)'' = cos p p'' - sin p p'^2, (cos p)'' = -sin p p'' -
        # cos p p'^2
        A0, A1 = sine * square * -Hy - self.mass * gy, cosine * Hy
        B0, B1 = cosine * square * Hx + self.mass * gx, sine * Hx
        return ((A0 - B0 * cy) * common, (A1 - B1 * cy) * common), (
            (B0 + A0 * cx) * common,
            (B1 + A1 * cx) * common,
        )

    def _balance(self, p: Value, rate: Value, mode: Mode) -> tuple[Value, Value]:
        """Return push and inertia of Lagrange's equation without T: inertia p'' = push."""
        (J, K), (Hx, Hy), (gx, gy) = self.inertia, self.moments, self.gravity
        cx, cy = self._coefficients(mode)
        sine, cosine = p.sin(), p.cos()
        Rx, Ry = self._reactions(sine, cosine, rate, mode)
        # generalized forces -L fx sin p and L fy cos p of the frictions, per unit of Rx and Ry
        lever_x, lever_y = sine * (-self.length * cx), cosine * (self.length * cy)
        weight = cosine * (Hy * gy) - sine * (Hx * gx)
        push = weight - sine * cosine * rate * rate * K + lever_x * Rx[0] + lever_y * Ry[0]
        return push, sine * sine * K + J - lever_x * Rx[1] - lever_y * Ry[1]

    def equation(self, mode: Mode, t: arb_series):
        torque = sum((load(t) for load in self.loads), arb_series([self.torque], t.prec))

        def acceleration(q: list[Value], v: list[Value]) -> list[Value]:
            push, inertia = self._balance(q[0], v[0], mode)
            return [quotient(push - torque, inertia)]

        return acceleration

    def guards(self, mode: Mode, t, q, v, a):
        turn, sx, sy, ex, ey = mode
        sine, cosine = q[0].sin(), q[0].cos()
        (Rx, Rx_a), (Ry, Ry_a) = self._reactions(sine, cosine, v[0], mode)
        # by the place in a mode of the number that changes where the guard is zero
        groups = [
            [v[0] * turn],
            [sine * (-turn * sx)],
            [cosine * (turn * sy)],
            [(Rx_a * a[0] + Rx) * ex],
            [(Ry_a * a[0] + Ry) * ey],
        ]
        return dict(enumerate(groups))

    def start(self) -> Next:
        (p,), (rate,), zero = self.q, self.v, arb(0)
        if any(x.contains(0) for x in (rate, p.sin(), p.cos())):
            raise Undecided(
                "in which direction the bar turns and its sliders slip at the start", zero
            )
        turn = 1 if rate > 0 else -1
        slips = -turn if p.sin() > 0 else turn, turn if p.cos() > 0 else -turn
        return Next(self._pressed(turn, *slips, zero, self.q, self.v))

    def after(self, mode: Mode, guard: int, t, q, v) -> Next:
        if guard == _TURN:
            raise Undecided(
                "the bar stops: both guides rest at once, and what each of them holds is open", t
            )
        turn, sx, sy, ex, ey = (
            -sign if place == guard else sign for place, sign in enumerate(mode)
        )
        if guard >= _NORMALS:
            return Next((turn, sx, sy, ex, ey), {guard: 1}, "corner")
        return Next(self._pressed(turn, sx, sy, t, q, v), {guard: 1}, "reversal", False)

    def _pressed(self, turn: int, sx: int, sy: int, t: arb, q: list[arb], v: list[arb]) -> Mode:
        """Return the mode with consistent signs of Rx and Ry, which are unique because p'' is."""
        for ex, ey in _SIGNS:
            mode = turn, sx, sy, ex, ey
            guards = self.guards_at(mode, t, q, v)
            if all(value > 0 for number in range(_NORMALS, len(mode)) for value in guards[number]):
                return mode
        raise Undecided("which surfaces the sliders press on", t)

    def require_unique(self, mode: Mode, t, bound) -> None:
        p, rate = constants(bound.state)
        turn, sx, sy, *_ = mode
        for ex, ey in _SIGNS:
            if not self._balance(p, rate, (turn, sx, sy, ex, ey))[1][0] > 0:
                raise Undecided("friction gain < 1, on which existence and uniqueness rest", t)

    def event_joint(self, before: Mode, after: Mode) -> str:
        slips = [i for i in (0, 1) if before[1 + i] != after[1 + i]]
        return GUIDES[slips[0] if slips else int(before[_NORMALS] == after[_NORMALS])]

    def columns(self, t, q, v):
        (p,), (rate,), L = q, v, self.length
        sine, cosine = p.sin(), p.cos()
        return {
            "bar.angle": -p,
            "bar.omega": -rate,
            "slider-x.x": cosine * L,
            "slider-x.vx": -(sine * rate * L),
            "slider-y.y": sine * L,
            "slider-y.vy": cosine * rate * L,
        }

    def bodies(self, t, q, v):
        (lx, ly), (p,), (rate,) = self.arms, q, v
        sine, cosine = p.sin(), p.cos()
        return self.columns(t, q, v) | {
            "bar.x": cosine * ly,
            "bar.y": sine * lx,
            "bar.vx": -(sine * rate * ly),
            "bar.vy": cosine * rate * lx,
        }

    @classmethod
    def from_scene(cls, scene: Scene) -> Trammel:
        reader = SceneReader(scene, PROVABLE)
        bar, x, y = (reader.body(name) for name in ("bar", *SLIDERS))
        lx = reader.element("pin-x").points[0][0]
        ly = -reader.element("pin-y").points[0][0]
        m, L = bar.mass, lx + ly
        torque, loads = reader.loads("torques")
        mechanism = cls(
            arms=balls((lx, ly)),
            mass=(m + x.mass + y.mass).ball,
            gravity=balls(reader.gravity),
            inertia=balls(
                (
                    bar.inertia + m * lx * lx + y.mass * L * L,
                    m * (ly * ly - lx * lx) + (x.mass - y.mass) * L * L,
                )
            ),
            moments=balls((m * ly + x.mass * L, m * lx + y.mass * L)),
            friction=tuple(_friction(reader, name) for name in GUIDES),
            torque=torque.ball,
            loads=loads,
            q=[-bar.angle.ball],
            v=[-bar.angular_velocity.ball],
            t_end=reader.t_end,
        )
        # the sliders stay on their axes and do not turn
        x_name, y_name = SLIDERS
        residuals = {
            f"{x_name}.y": x.position[1],
            f"{x_name}.vy": x.velocity[1],
            f"{y_name}.x": y.position[0],
            f"{y_name}.vx": y.velocity[0],
            f"{x_name}.angle": x.angle,
            f"{x_name}.omega": x.angular_velocity,
            f"{y_name}.angle": y.angle,
            f"{y_name}.omega": y.angular_velocity,
        }
        reader.require_start(mechanism, residuals)
        return mechanism


def _friction(reader: SceneReader, name: str) -> arb:
    """Return mu of a guide; raise NotThisMechanism if the guide is not as in the module's text."""
    guide = reader.element(name)
    declared = reader.match[name]
    one_surface = (
        guide.length is None
        or guide.width is None
        or bool(declared.frictional and guide.mu.ball * guide.width.ball < guide.length.ball)
    )
    reader.require(
        declared.frictional and declared.angle == 0 and bool(guide.mu.ball < 1) and one_surface,
        f"joints.{name}: expected no angle, friction with mu < 1, and mu * width < length",
    )
    return guide.mu.ball
