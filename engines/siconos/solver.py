"""Moreau-Jean time stepping of a resolved scene by the kernel of Siconos, as a program for a Python that has it.

All bodies are one LagrangianDS with q = (x, y, angle of each body, time). Time is a coordinate with the rate 1 and an
infinite inertia, so that the rows of a relation can depend on time. Relations are LagrangianLinearTIR whose matrices
are those of the mechanism at q_M = q + h/2 v, t_M = t + h/2, written in place before each step: one with an
EqualityConditionNSL for all bilateral constraints (pins, drives, angles of sliders without length), one with a
NewtonImpactFrictionNSL for the normal and the tangent of each corner that may touch a surface, and one with a RelayNSL
for the slip of each joint whose friction has a constant bound. MoreauJeanOSI and
GenericMechanical solve

    M (v+ - v) = h F(t_M, q_M, v) + J' L + sum of C' P,    q+ = q + h (theta v+ + (1 - theta) v)
    J v+ = rate - Phi/h,    0 <= P_N _|_ C_N (v+ + e v) >= 0,    |P_T| <= mu P_N, against the slip C_T v+

A corner is active if its gap at q_M is not positive: the kernel requires y + h/2 y' <= 0. The bilateral constraints
add r J' (rate - Phi/h - J v+), which is zero in the solution, to the balance, so that Gauss-Seidel uses M + r J'J
instead of M. Then constraints and corners hardly depend on each other (the method of multipliers, Hestenes 1969).

Symbols: q, v are coordinates and velocities, h is the step, F the applied forces, J the rows of the constraints, L
their impulses, C the two rows (normal, tangent) of a corner, P its impulses, W the matrix that the kernel takes for M.
`frames` are positions and angles of all bodies.
"""

import bisect
import json
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Scene = dict[str, Any]
Frames = dict[int | None, tuple[float, float, float, float, float]]
"""Position, cosine and sine of the angle, and angle, by the number of the body; None is the ground."""
Function = Callable[[Frames, np.ndarray], float]
"""Computes a coordinate from the frames of all bodies, and writes its derivatives to the row."""
ENDLESS = 1e30
"""Inertia of the time coordinate in units of the largest mass, so that forces change its rate by less than rounding."""
STIFF = 1e4
"""Value of r J M^-1 J'. In case 1 a step takes 561 iterations without it, and 44, 39 and 39 with 1e2, 1e4 and 1e6."""
AT_REST = 100
"""Slip speed in units of the step's tolerance below which a corner is at rest: error of the solver in stick."""
UNSOLVED = 1000
"""Residual of a step in units of its tolerance above which the program ends."""
LEAST_FACTOR = 1e-3
"""Least ratio of the kernel's tolerance to that of the step. It is 1/(1 + speed) otherwise, as the kernel measures
errors of contacts relative to 1 + speed; in very fast motions that would ask for less than rounding."""
SMALLEST = 1e-300
"""Least divisor, for rows and motions that are zero: above underflow, below any other number here."""
NEVER = 1e12
"""End of the kernel's model in seconds, which no run reaches."""
GRID_ROUNDING = 1e-9
"""Rounding of the quotient of an interval and the step."""
BLOCK = 3
"""Index of the solver of a planar contact among the solvers of GenericMechanical."""


class Law:
    """A law of time; a call returns value and rate at a time (s)."""

    def __init__(self, data: Scene) -> None:
        self.data = data
        self.kind = data["type"]
        if self.kind == "table":
            # x, y: the points of the table
            x, y = np.array(data["times"]), np.array(data["values"])
            bend, h = np.zeros(len(x)), np.diff(x)
            if data["interpolation"] == "cubic" and len(x) > 2:
                # Natural spline (Numerical Recipes, Sect. 3.3): second derivatives `bend` at the points
                # with which the first derivative is continuous; they are zero at the ends.
                matrix = np.diag(2 * (h[:-1] + h[1:])) + np.diag(h[1:-1], 1) + np.diag(h[1:-1], -1)
                bend[1:-1] = np.linalg.solve(matrix, 6 * np.diff(np.diff(y) / h))
            self.x, self.y, self.bend = x.tolist(), y.tolist(), bend.tolist()

    def __call__(self, t: float) -> tuple[float, float]:
        data = self.data
        if self.kind == "constant":
            return data["value"], 0.0
        if self.kind == "linear":
            return data["offset"] + data["rate"] * t, data["rate"]
        if self.kind == "sine":
            amplitude, frequency = data["amplitude"], data["frequency"]
            phase = frequency * t + data["phase"]
            return (
                data["offset"] + amplitude * math.sin(phase),
                amplitude * frequency * math.cos(phase),
            )
        # A table. The interval i of `inside` has the length h; u and s are the distances from its
        # ends, a and b the second derivatives there, which are zero for a linear table.
        x, y = self.x, self.y
        inside = min(max(t, x[0]), x[-1])
        i = min(bisect.bisect_right(x, inside), len(x) - 1)
        h, u, s = x[i] - x[i - 1], inside - x[i - 1], x[i] - inside
        a, b = self.bend[i - 1 : i + 1]
        value = (
            (a * s**3 + b * u**3) / (6 * h)
            + (y[i - 1] / h - a * h / 6) * s
            + (y[i] / h - b * h / 6) * u
        )
        rate = (b * u**2 - a * s**2) / (2 * h) + (y[i] - y[i - 1]) / h - h / 6 * (b - a)
        # Outside, a cubic table continues along the tangent of its end, a linear one with its last value.
        if data["interpolation"] == "cubic":
            return value + rate * (t - inside), rate
        return value, rate if inside == t else 0.0


def angle(place: dict[str, int], bodies: list[str]) -> Function:
    """Return the function of the angle between two bodies; `place` contains their numbers."""
    a, b = (place.get(name) for name in bodies)

    def at(frames: Frames, row: np.ndarray) -> float:
        for i, sign in ((a, 1.0), (b, -1.0)):
            if i is not None:
                row[3 * i + 2] = sign
        return frames[a][4] - frames[b][4]

    return at


def distance(
    place: dict[str, int], bodies: list[str], points: Any, axis: Any = None, of_ground: bool = False
) -> Function:
    """Return the function of the distance of two points, or of their coordinate along an axis.

    The axis is the second body's, or the ground's.
    """
    (a, b), ((ax, ay), (bx, by)) = (place.get(name) for name in bodies), points

    def at(frames: Frames, row: np.ndarray) -> float:
        # centres of the two bodies, cosines and sines of their angles
        xa, ya, cos_a, sin_a, _ = frames[a]
        xb, yb, cos_b, sin_b, _ = frames[b]
        # levers of the two points in ground axes
        px, py = cos_a * ax - sin_a * ay, sin_a * ax + cos_a * ay
        ox, oy = cos_b * bx - sin_b * by, sin_b * bx + cos_b * by
        # (dx, dy) from the second point to the first, (ex, ey) the direction in which it is
        # measured. The second body moves along it with its lever (lx, ly): the first point, as
        # the axis turns with the body; its own point, where the axis is the ground's.
        lx, ly = xa + px - xb, ya + py - yb
        dx, dy = ex, ey = lx - ox, ly - oy
        if axis and of_ground:
            ex, ey = axis
        elif axis:
            ex = cos_b * axis[0] - sin_b * axis[1]
            ey = sin_b * axis[0] + cos_b * axis[1]
        if of_ground:
            lx, ly = ox, oy
        length = math.hypot(ex, ey) or 1.0
        ex, ey = ex / length, ey / length
        if a is not None:
            row[3 * a : 3 * a + 3] = ex, ey, px * ey - py * ex
        if b is not None:
            row[3 * b : 3 * b + 3] = -ex, -ey, ly * ex - lx * ey
        return ex * dx + ey * dy

    return at


def coordinate(place: dict[str, int], element: Scene) -> Function:
    """Return the function of the coordinate of a drive or a spring."""
    if element["type"] in ("angle", "torsional"):
        return angle(place, element["bodies"])
    return distance(place, element["bodies"], element["points"], element["axis"])


def slip_coordinate(place: dict[str, int], joint: Scene) -> Function:
    """Return the function of a joint's coordinate whose rate is its slip velocity: an angle, or a way along a guide."""
    if joint["type"] == "revolute":
        return angle(place, joint["bodies"])
    bodies, points = (
        [joint["slider"], joint["guide"]],
        [joint["slider_point"], joint["point"]],
    )
    return distance(place, bodies, points, joint["direction"])


class Contact:
    """A corner of a slider next to a surface of its guide: side 1 pushes along the normal, -1 against it."""

    def __init__(
        self,
        name: str,
        guide: Scene,
        corner: int,
        clearance: float,
        place: dict[str, int],
    ) -> None:
        import siconos.kernel as kernel  # late: this module can be read where there is none

        x, y = guide["direction"]
        length = guide["length"] or 0.0
        half_width = (guide["width"] or 0.0) / 2
        # The corner's place from the slider's point, along and across the guide; `room` is the
        # distance of that point from the surface when the corner touches it.
        self.side, front = ((1, -1), (1, 1), (-1, 1), (-1, -1))[corner]
        self.along, self.across = front * length / 2, -self.side * half_width
        self.room = half_width + (guide["clearance"] or clearance)
        # the same place in the axes of the slider, as a point that moves with it
        turn = math.atan2(y, x) - guide["angle"]
        c, s = math.cos(turn), math.sin(turn)
        lever = c * self.along - s * self.across, s * self.along + c * self.across
        points = [p + d for p, d in zip(guide["slider_point"], lever)], guide["point"]
        bodies = [guide["slider"], guide["guide"]]
        self.normal, self.tangent = (
            distance(place, bodies, points, (-y, x)),
            distance(place, bodies, points, (x, y)),
        )
        self.mu, self.mus, self.restitution = (
            guide["mu"] or 0.0,
            guide["mus"] or 0.0,
            guide["restitution"],
        )
        self.law = kernel.NewtonImpactFrictionNSL(self.restitution, 0.0, self.mu, 2)
        self.relation = kernel.LagrangianLinearTIR(np.zeros((2, 3 * len(place) + 1)), np.zeros(2))
        self.interaction = kernel.Interaction(self.law, self.relation)
        # columns of the guide to which the corner contributes
        self.resultant, self.moment = f"{name}.normal_force", f"{name}.moment"
        self.mode = f"{name}.mode" if guide["mu"] is not None else ""
        self.normals = [f"{name}.F{corner + 1}"] if length else []
        self.frictions = [f"{name}.friction"] if self.mode else []
        if self.mode and length:
            self.frictions.append(f"{name}.friction_{'lower' if self.side > 0 else 'upper'}")

    def look(self) -> None:
        """Store references to the kernel's arrays of the contact, which are written and read in place."""
        self.C, self.e, self.P = self.relation.C(), self.relation.e(), self.interaction.lambda_(1)
        self.y, self.rate, self.before = (
            self.interaction.y(0),
            self.interaction.y(1),
            self.interaction.y_k(1),
        )

    def write(self, frames: Frames, q: np.ndarray) -> None:
        """Write the relation at q and its frames; its output there is the gap."""
        value = self.normal(frames, self.C[0])
        self.C[0] *= self.side
        self.tangent(frames, self.C[1])
        self.e[0] = self.side * value + self.room - self.C[0] @ q

    def add(self, impulses: dict[str, float]) -> None:
        """Add the impulses of the contact to those of the guide's columns."""
        normal, friction = self.P.tolist()
        impulses[self.resultant] += self.side * normal
        impulses[self.moment] += self.along * self.side * normal - self.across * friction
        for column in self.normals:
            impulses[column] += normal
        for column in self.frictions:
            impulses[column] += friction


class Relay:
    """Dry friction with a constant bound, in a pin or a guide: the kernel's RelayNSL on the slip velocity of the joint.

    The law is -(slip velocity) in the normal cone of [-bound h, bound h] at the impulse. The kernel only solves laws
    whose output is not positive: it is made at most -1 here, as the law itself does not read it.
    """

    def __init__(self, name: str, joint: Scene, place: dict[str, int], unit: float, h: float):
        import siconos.kernel as kernel  # late: this module can be read where there is none

        self.slip = slip_coordinate(place, joint)
        # largest impulses of a step, in the unit of mass, in slip and at rest
        kinetic = joint["friction"] or 0.0
        self.kinetic = kinetic * h / unit
        self.static = (joint["static_friction"] or kinetic) * h / unit
        self.bound = self.kinetic
        self.law = kernel.RelayNSL(1, -self.kinetic, self.kinetic)
        self.relation = kernel.LagrangianLinearTIR(np.zeros((1, 3 * len(place) + 1)), np.zeros(1))
        self.interaction = kernel.Interaction(self.law, self.relation)
        self.mode, self.frictions = f"{name}.mode", [f"{name}.friction"]

    def look(self) -> None:
        """Store references to the kernel's arrays of the law, which are written and read in place."""
        self.C, self.e, self.P = self.relation.C(), self.relation.e(), self.interaction.lambda_(1)

    def write(self, frames: Frames, q: np.ndarray, v: np.ndarray, h: float, small: float) -> None:
        """Write the relation and the bound of a step of length h that begins at q, v.

        `frames` are those of its middle. The bound is that at rest if the slip velocity is at most AT_REST * `small`.
        """
        self.slip(frames, self.C[0])
        speed = abs(self.C[0] @ v)
        self.e[0] = -1.0 - self.C[0] @ q - h * speed
        self.bound = self.static if speed <= AT_REST * small else self.kinetic
        self.law.setLb(-self.bound)
        self.law.setUb(self.bound)


class Mechanism:
    """The scene as a system of Siconos.

    The largest mass is the unit of mass, so that impulses are of the size of speeds, and tolerances of both the same.
    """

    def __init__(self, scene: Scene, h: float, chosen: Scene) -> None:
        bodies, self.h = scene["bodies"], h
        place = {name: i for i, name in enumerate(bodies)}
        mass = [
            m for body in bodies.values() for m in (body["mass"], body["mass"], body["inertia"])
        ]
        self.n, self.engine_s = len(mass), 0.0
        self.unit = max(body["mass"] for body in bodies.values())
        self.mass = np.array([*mass, ENDLESS * self.unit]) / self.unit
        self.weight = self.mass[:-1] * self.unit * np.tile((*scene["gravity"], 0.0), len(bodies))
        self.held: dict[str, tuple[Function, Law]] = {}  # by the columns of their forces
        self.contacts: list[Contact] = []
        self.relays = [
            Relay(name, joint, place, self.unit, h)
            for name, joint in scene["joints"].items()
            if joint["friction"] or joint["static_friction"]
        ]
        self.dampers = [
            (slip_coordinate(place, joint), joint["damping"])
            for joint in scene["joints"].values()
            if joint["damping"]
        ]
        clearance = chosen["clearance"] * size_of(scene)
        # Bilateral rows by joints and drives, and contacts of corners. A slider without a length
        # has one corner for each surface, and a row that holds its angle.
        for name, joint in scene["joints"].items():
            if joint["type"] == "revolute":
                for label, axis in (("fx", (1.0, 0.0)), ("fy", (0.0, 1.0))):
                    function = distance(place, joint["bodies"], joint["points"], axis, True)
                    self.held[f"{name}.{label}"] = function, Law({"type": "constant", "value": 0.0})
                continue
            self.contacts += [
                Contact(name, joint, corner, clearance, place)
                for corner in (range(4) if joint["length"] else (0, 2))
            ]
            if not joint["length"]:
                function = angle(place, [joint["slider"], joint["guide"]])
                self.held[f"{name}.moment"] = (
                    function,
                    Law({"type": "constant", "value": joint["angle"]}),
                )
        for name, drive in scene["drives"].items():
            self.held[f"{name}.effort"] = coordinate(place, drive), Law(drive["law"])
        self.springs = [
            (
                coordinate(place, spring),
                spring["stiffness"],
                spring["damping"],
                spring["rest_angle" if spring["type"] == "torsional" else "rest_length"],
            )
            for spring in scene["springs"].values()
        ]
        self.loads = [
            (load, place[load["body"]], Law(load["law"])) for load in scene["forces"].values()
        ]
        guides = [
            column
            for contact in self.contacts
            for column in (contact.resultant, contact.moment, *contact.normals, *contact.frictions)
        ]
        frictions = [column for relay in self.relays for column in relay.frictions]
        self.columns = list(dict.fromkeys([*self.held, *guides, *frictions]))
        modes = [contact.mode for contact in self.contacts if contact.mode]
        self.modes = list(dict.fromkeys([*modes, *(relay.mode for relay in self.relays)]))
        self._build(
            [x for body in bodies.values() for x in (*body["position"], body["angle"])],
            [x for body in bodies.values() for x in (*body["velocity"], body["angular_velocity"])],
            chosen,
        )

    def _build(self, q: list[float], v: list[float], chosen: Scene) -> None:
        """Make the kernel's objects for the start q, v and the chosen settings."""
        import siconos.kernel as kernel
        import siconos.numerics as numerics

        system = kernel.LagrangianDS(np.array([*q, 0.0]), np.array([*v, 1.0]), np.diag(self.mass))
        system.setFExtPtr(np.zeros(self.n + 1))
        model = kernel.NonSmoothDynamicalSystem(0.0, NEVER)
        model.insertDynamicalSystem(system)
        if self.held:
            relation = kernel.LagrangianLinearTIR(
                np.zeros((len(self.held), self.n + 1)), np.zeros(len(self.held))
            )
            bilateral = kernel.Interaction(kernel.EqualityConditionNSL(len(self.held)), relation)
            model.link(bilateral, system)
        laws: list[Contact | Relay] = [*self.contacts, *self.relays]
        for law in laws:
            model.link(law.interaction, system)
        # Gauss-Seidel over the block of bilateral rows and the blocks of contacts, each with a
        # solver of its own.
        problem = kernel.GenericMechanical()
        options = problem.numericsSolverOptions()
        options.iparam[numerics.SICONOS_IPARAM_MAX_ITER] = int(chosen["iterations"])
        block = getattr(numerics, f"SICONOS_FRICTION_2D_{chosen['block'].upper()}")
        kernel.solver_options_update_internal(options, BLOCK, block)
        self.precision, self.done = numerics.SICONOS_DPARAM_TOL, numerics.SICONOS_IPARAM_ITER_DONE
        self.simulation = kernel.TimeStepping(
            model,
            kernel.TimeDiscretisation(0.0, self.h),
            kernel.MoreauJeanOSI(chosen["theta"]),
            problem,
        )
        # The relations are linear within a step, as they are written anew before each.
        self.simulation.setNewtonOptions(kernel.SICONOS_TS_LINEAR)
        self.simulation.initialize()
        # The arrays are the kernel's own memory, which lives as long as the objects that own it.
        self.owners = system, problem, options
        self.q, self.v = system.q(), system.velocity()
        self.applied, self.total = system.fExt(), system.forces()
        self.W, self.integers, self.reals = system.mass(), options.iparam, options.dparam
        self.theta, self.tolerance = chosen["theta"], chosen["tolerance"]
        self.J, self.L = np.zeros((0, self.n + 1)), np.zeros(0)
        if self.held:
            self.J, self.L = relation.C(), bilateral.lambda_(1)
        self.slips: dict[str, int] = {}  # direction of each guide with friction, by its column
        for law in laws:
            law.look()

    def forces(self, t: float, frames: Frames, v: np.ndarray) -> np.ndarray:
        """Return the applied forces on all coordinates: weight, springs, loads."""
        total = self.weight.copy()
        for function, stiffness, damping, rest in self.springs:
            row = np.zeros(self.n)
            value = function(frames, row)
            total -= (stiffness * (value - rest) + damping * (row @ v)) * row
        for function, damping in self.dampers:
            row = np.zeros(self.n)
            function(frames, row)
            total -= damping * (row @ v) * row
        for load, i, law in self.loads:
            size = law(t)[0]
            if load["type"] == "torque":
                total[3 * i + 2] += size
                continue
            (x, y), (px, py), (_, _, c, s, _) = load["direction"], load["point"], frames[i]
            size /= math.hypot(x, y)
            total[3 * i : 3 * i + 3] += (
                size * x,
                size * y,
                size * ((c * px - s * py) * y - (s * px + c * py) * x),
            )
        return total

    def step(self, t: float) -> list[float]:
        """Take the step from time t (s), and return its mean accelerations, reactions and modes."""
        # Everything that depends on positions is evaluated at the midpoint of the step.
        h, n, v = self.h, self.n, self.v.copy()
        middle = self.q + h / 2 * v
        frames: Frames = {None: (0.0, 0.0, 1.0, 0.0, 0.0)}
        coordinates = middle[:n].tolist()
        for i in range(n // 3):
            x, y, turn = coordinates[3 * i : 3 * i + 3]
            frames[i] = x, y, math.cos(turn), math.sin(turn), turn
        F = np.zeros(n + 1)
        F[:n] = self.forces(t + h / 2, frames, v[:n]) / self.unit
        # Held rows: J v+ = rate - Phi/h removes the error of the position within the step. The last
        # coordinate, time, has the rate 1, so that its entry of a row is the constant term.
        for row, (function, law) in zip(self.J, self.held.values()):
            wanted, rate = law(t + h / 2)
            row[n] = (function(frames, row) - wanted) / h - rate
        # The tolerance of this step is relative to its speeds, by motion or by forces.
        speed = max(np.abs(v[:n]).max(), h * np.abs(F / self.mass).max(), SMALLEST)
        small = self.tolerance * speed
        for contact in self.contacts:
            contact.write(frames, middle)
            # The last step in which the guide had a contact decides whether the static or the kinetic
            # coefficient applies. Before the first contact, the present speed decides.
            if contact.mode not in self.slips:
                self.slips[contact.mode] = self._direction(contact, v, small)
            contact.law.setMu(contact.mu if self.slips[contact.mode] else contact.mus)
        for relay in self.relays:
            relay.write(frames, self.q, v, h, small)
        # Method of multipliers: M + r J'J in place of M, and the same term in the applied forces.
        held = self.J[:, :n]
        r = STIFF / np.maximum((held * held) @ (1 / self.mass[:n]), SMALLEST)
        self.W[:n, :n] = np.diag(self.mass[:n]) + (held.T * r) @ held
        self.applied[:] = F
        self.applied[:n] -= (r * (self.J @ v)) @ held / h
        # The kernel weights these forces by theta, and those of the previous step, which are set to zero
        # at the end of each step, by 1 - theta.
        self.applied /= self.theta
        # errors of the kernel are absolute in what is held, and relative to 1 + speed in contacts
        self.reals[self.precision] = small * (1 / (1 + speed) + LEAST_FACTOR)
        self._call(self.simulation.updateOutput)
        # For restitution: the kernel's own value is by the matrix of the step before.
        for contact in self.contacts:
            contact.before[:] = contact.rate
        self._call(self.simulation.updateIndexSets)
        closed = [
            contact for contact in self.contacts if contact.y[0] + 0.5 * h * contact.rate[0] <= 0
        ]
        self._call(self.simulation.computeOneStep)
        # The impulses of held rows include the added term. The solution is verified here, because
        # the kernel goes on silently when its iterations are used up.
        impulses = self.L - r * (self.J @ self.v)
        residual = self._residual(closed, impulses, v, F)
        if not residual <= UNSOLVED * small:
            rank, iterations = (
                np.linalg.matrix_rank(held / np.sqrt(self.mass[:n])),
                self.integers[self.done],
            )
            sys.exit(
                f"Siconos does not solve the step at t = {t:.9g} s: residual {residual:.2g} m/s or rad/s after "
                f"{iterations} iterations; expected {UNSOLVED * small:.2g} ({len(held)} constraints, {rank} of "
                "them independent)"
            )
        # Mean accelerations, forces and modes of the step, in the order of the table's columns.
        by_column = dict.fromkeys(self.columns, 0.0) | dict(zip(self.held, impulses.tolist()))
        for contact in closed:
            contact.add(by_column)
        for relay in self.relays:
            by_column[relay.frictions[0]] += float(relay.P[0])
        values = [
            *((self.v - v)[:n] / h).tolist(),
            *(impulse * self.unit / h for impulse in by_column.values()),
            *self._modes(closed, small),
        ]
        self.total[:] = 0.0
        self._call(self.simulation.nextStep)
        return values

    def _call(self, function: Callable[[], None]) -> None:
        """Call a function of the kernel, and add its CPU time to `engine_s`."""
        started = time.process_time()
        function()
        self.engine_s += time.process_time() - started

    def _residual(
        self, closed: list[Contact], impulses: np.ndarray, v: np.ndarray, F: np.ndarray
    ) -> float:
        """Return the largest error (m/s, rad/s) of balance, of what is held, and of the laws of closed contacts."""
        balance = self.mass * (self.v - v) - self.h * F - impulses @ self.J
        errors = [np.abs(self.J @ self.v).max(initial=0.0)]
        for contact in closed:
            C, mu = contact.C, contact.law.mu()
            normal, friction = contact.P.tolist()
            balance -= contact.P @ C
            gap_rate, slip = (C @ self.v).tolist()
            # Impulses become speeds by the inverse masses along the two rows. Then both laws are
            # equations that are zero in a solution: min(gap rate, impulse) = 0 for the normal, and
            # friction = projection of (friction - slip) on the interval of Coulomb's law.
            along_normal, along_tangent = ((C * C) @ (1 / self.mass)).tolist()
            bound = mu * along_tangent * normal
            projected = max(-bound, min(bound, along_tangent * friction - slip))
            errors += [
                abs(min(gap_rate + contact.restitution * (C[0] @ v), along_normal * normal)),
                abs(along_tangent * friction - projected),
            ]
        for relay in self.relays:
            C, impulse = relay.C[0], float(relay.P[0])
            balance -= impulse * C
            # as friction of a contact, with a bound that does not depend on an impulse
            mobility = (C * C) @ (1 / self.mass)
            wanted = mobility * impulse - C @ self.v
            projected = max(-mobility * relay.bound, min(mobility * relay.bound, wanted))
            errors.append(abs(mobility * impulse - projected))
        return max(*errors, np.abs(balance / self.mass).max())

    def _relay_direction(self, relay: Relay, v: np.ndarray, small: float) -> int:
        """Return the direction of slip of a joint with a constant bound, 0 at rest."""
        slip = relay.C[0] @ v
        if abs(slip) <= AT_REST * small:
            return 0
        return 1 if slip > 0 else -1

    def _direction(self, contact: Contact, v: np.ndarray, small: float) -> int:
        """Return the direction of slip at a corner, 0 at rest."""
        slip = contact.C[1] @ v
        if abs(slip) <= AT_REST * small:
            return 0
        return 1 if slip > 0 else -1

    def _modes(self, closed: list[Contact], small: float) -> list[int]:
        """Return directions of slip of guides with friction, each at the corner with the largest normal force."""
        # The contacts are sorted by their normal force, so that the largest one is written last.
        for contact in sorted(closed, key=lambda contact: contact.P[0]):
            self.slips[contact.mode] = self._direction(contact, self.v, small)
        for relay in self.relays:
            self.slips[relay.mode] = self._relay_direction(relay, self.v, small)
        return [self.slips[mode] for mode in self.modes]


def size_of(scene: Scene) -> float:
    """Return the largest extent of points of pins, sliders and positions (m), as `Arrays.length_scale` of the suite."""
    joints = scene["joints"].values()
    lengths = [abs(x) for joint in joints for point in joint.get("points", ()) for x in point]
    lengths += [joint.get(key) or 0.0 for joint in joints for key in ("length", "width")]
    return (
        max(lengths + [abs(x) for body in scene["bodies"].values() for x in body["position"]])
        or 1.0
    )


def main(
    scene_file: str, result_file: str, report_file: str, dt: str, output_step: str, *settings: str
) -> None:
    """Read the scene, simulate it to its end, and write the table and the report."""
    with open(scene_file, encoding="utf-8") as file:
        scene = json.load(file)["scene"]
    pairs = (setting.split("=") for setting in settings)
    chosen = {key: value if key == "block" else float(value) for key, value in pairs}
    steps = max(1, round(scene["t_end"] / float(dt)))
    h = scene["t_end"] / steps
    every = max(1, int(float(output_step) / h + GRID_ROUNDING))
    mechanism = Mechanism(scene, h, chosen)
    labels = [
        f"{name}.{label}"
        for labels in (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
        for name in scene["bodies"]
        for label in labels
    ]
    setup, iterations, n = time.process_time(), 0, mechanism.n
    with open(result_file, "w", encoding="utf-8") as file:
        print("t", *labels, *mechanism.columns, *mechanism.modes, sep=",", file=file)
        for k in range(steps + 1):
            state = [*mechanism.q[:n].tolist(), *mechanism.v[:n].tolist()]
            row = mechanism.step(k * h)
            iterations += int(mechanism.integers[mechanism.done])
            if k % every == 0 or k == steps:
                print(k * h, *state, *row, sep=",", file=file)
    with open(report_file, "w", encoding="utf-8") as file:
        json.dump(
            {
                "setup_s": setup,
                "engine_s": mechanism.engine_s,
                "counters": {"steps": steps + 1, "iterations": iterations},
            },
            file,
        )


if __name__ == "__main__":
    import siconos.kernel  # an installation without the kernel has no version

    if sys.argv[1:] == ["--version"]:
        print(siconos.version)
    else:
        main(*sys.argv[1:])
