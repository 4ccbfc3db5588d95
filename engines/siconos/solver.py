"""Moreau-Jean time stepping of a resolved scene by the kernel of Siconos: a program for the Python that has it.

All bodies are one LagrangianLinearTIDS with q = (x, y, angle of each body, time); time is a coordinate of infinite
inertia and rate 1, so that a row of a relation may hold what the clock adds to it. Its relations are LagrangianLinearTIR
whose matrices are those of the mechanism at q_M = q + h/2 v, written before each step: a row J, -rate + Phi/h for each
pin, drive and angle that is held, all of them one EqualityConditionNSL, and for each corner that may touch a surface
its normal and its tangent with a NewtonImpactFrictionNSL. MoreauJeanOSI steps with theta, GenericMechanical solves:

    M (v+ - v) = h F(t_M, q_M, v) + J' L + sum of C' P,    q+ = q + h (theta v+ + (1 - theta) v)
    J v+ = rate - Phi/h,    0 <= P_N _|_ u_N + e u_N(v) >= 0,    |P_T| <= mu P_N, against the slip    (u = C v+)

A corner is closed where its gap at q_M is not positive: Siconos asks for y + h/2 y' <= 0.
"""

import bisect
import json
import math
import sys
import time

import numpy as np
import siconos
import siconos.kernel as kernel
import siconos.numerics as numerics

STIFF = 1e4
HEAVY = 1e30
"""Inertia of the clock: what a constraint does to its rate is below rounding."""
AT_REST = 1e-10
"""Slip speed of a closed contact, relative to the largest speed, that counts as none: the solver's tolerance."""
SLACK = 1e3
""""""
BLOCKS = {"nsgs": numerics.SICONOS_FRICTION_2D_NSGS, "lemke": numerics.SICONOS_FRICTION_2D_LEMKE,
          "enum": numerics.SICONOS_FRICTION_2D_ENUM, "cpg": numerics.SICONOS_FRICTION_2D_CPG}


def refuse(reason):
    """End with the exit code of a scene that cannot be represented."""
    print(reason, file=sys.stderr)
    sys.exit(77)


class Law:
    """Value and rate of a law of time."""

    def __init__(self, data):
        self.data, self.kind = data, data["type"]
        if self.kind == "table":
            x, y = np.array(data["times"]), np.array(data["values"])
            self.x, self.y, self.bend, h = x.tolist(), y.tolist(), np.zeros(len(x)), np.diff(x)
            if data["interpolation"] == "cubic" and len(x) > 2:  # natural spline: continuous slopes
                slopes = np.diff(np.diff(y) / h)
                matrix = np.diag(2 * (h[:-1] + h[1:])) + np.diag(h[1:-1], 1) + np.diag(h[1:-1], -1)
                self.bend[1:-1] = np.linalg.solve(matrix, 6 * slopes)

    def __call__(self, t):
        data = self.data
        if self.kind == "constant":
            return data["value"], 0.0
        if self.kind == "linear":
            return data["offset"] + data["rate"] * t, data["rate"]
        if self.kind == "sine":
            size, rate, phase = data["amplitude"], data["frequency"], data["frequency"] * t + data["phase"]
            return data["offset"] + size * math.sin(phase), size * rate * math.cos(phase)
        x, y, cubic = self.x, self.y, data["interpolation"] == "cubic"
        at = min(max(t, x[0]), x[-1])  # outside: the end's tangent, or the end value
        i = min(bisect.bisect_right(x, at), len(x) - 1)
        h, u, s, a, b = x[i] - x[i - 1], at - x[i - 1], x[i] - at, *self.bend[i - 1:i + 1]
        value = (a * s ** 3 + b * u ** 3) / (6 * h) + (y[i - 1] / h - a * h / 6) * s + (y[i] / h - b * h / 6) * u
        rate = (b * u ** 2 - a * s ** 2) / (2 * h) + (y[i] - y[i - 1]) / h - h / 6 * (b - a)
        return value + (rate * (t - at) if cubic else 0.0), rate if cubic or at == t else 0.0


class Coordinate:
    """Angle or distance of two bodies, along an axis of the second one where there is one; of a pin, of the ground."""

    def __init__(self, place, kind, bodies, points=((0, 0), (0, 0)), axis=None):
        self.places, self.turns = [place.get(name) for name in bodies], kind in ("angle", "torsional")
        self.points, self.axis, self.fixed = points, axis, kind == "pin"

    def at(self, q, row):
        """Return its value at q and write its derivatives to the row."""
        (x, y, a), (s, t, b) = (q[i:i + 3] if i is not None else (0.0, 0.0, 0.0) for i in self.places)
        if self.turns:
            value, parts = a - b, ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
        else:
            (px, py), (ox, oy) = turned(a, self.points[0]), turned(b, self.points[1])
            dx, dy = x + px - s, y + py - t  # from the centre of the second body
            ex, ey = self.axis if self.fixed else turned(b, self.axis) if self.axis else (dx - ox, dy - oy)
            size = math.hypot(ex, ey) or 1.0
            ex, ey = ex / size, ey / size
            value = ex * (dx - ox) + ey * (dy - oy)
            lx, ly = (ox, oy) if self.fixed else (dx, dy)
            parts = (ex, ey, px * ey - py * ex), (-ex, -ey, ly * ex - lx * ey)
        for i, part in zip(self.places, parts):
            if i is not None:
                row[i:i + 3] = part
        return value


class Contact:
    """A corner of a slider beside a surface of its guide: side 1 pushes along the normal, -1 against it."""

    def __init__(self, name, guide, corner, clearance, restitution, place):
        (x, y), length, half = guide["direction"], guide["length"] or 0.0, (guide["width"] or 0.0) / 2
        size = math.hypot(x, y)
        self.side, self.along = ((1, -1), (1, 1), (-1, 1), (-1, -1))[corner]
        self.along *= length / 2
        self.across, self.room = -self.side * half, half + clearance
        lever = turned(math.atan2(y, x) - guide["angle"], (self.along, self.across))
        points = [p + d for p, d in zip(guide["slider_point"], lever)], guide["point"]
        bodies = guide["slider"], guide["guide"]
        self.normal = Coordinate(place, "distance", bodies, points, (-y / size, x / size))
        self.tangent = Coordinate(place, "distance", bodies, points, (x / size, y / size))
        self.mu, self.mus = guide["mu"] or 0.0, guide["mus"] or 0.0
        self.law = kernel.NewtonImpactFrictionNSL(restitution, 0.0, self.mu, 2)
        self.relation = kernel.LagrangianLinearTIR(np.zeros((2, 3 * len(place) + 1)), np.zeros(2))
        self.interaction = kernel.Interaction(self.law, self.relation)
        self.C, self.e = self.relation.C(), self.relation.e()
        frictions = ["friction", f"friction_{'lower' if self.side > 0 else 'upper'}"][:2 if length else 1]
        self.normals = [f"{name}.F{corner + 1}"] if length else []
        self.frictions = [f"{name}.{label}" for label in frictions if guide["mu"] is not None]
        self.resultant, self.moment = f"{name}.normal_force", f"{name}.moment"

    def write(self, at, q):
        """Write the relation at q, a list and an array; its output there is the gap."""
        C = self.C
        value = self.normal.at(at, C[0])
        C[0] *= self.side
        self.tangent.at(at, C[1])
        self.e[0] = self.side * value + self.room - C[0] @ q

    def closed(self, h):
        """Return True where Siconos makes it active: its own expression."""
        return self.interaction.y(0)[0] + 0.5 * h * self.interaction.y(1)[0] <= 0

    def add(self, P, found):
        """Add its impulses to those of the guide's columns."""
        found[self.resultant] += self.side * P[0]
        found[self.moment] += self.along * self.side * P[0] - self.across * P[1]
        for column in self.normals:
            found[column] += P[0]
        for column in self.frictions:
            found[column] += P[1]


class Mechanism:
    """The scene as a system of Siconos, which has the largest mass as its unit of mass."""

    def __init__(self, scene, h, chosen):
        bodies, self.h, self.tolerance = scene["bodies"], h, chosen["tolerance"]
        self.theta = chosen["theta"]
        place = {name: 3 * i for i, name in enumerate(bodies)}
        self.mass = np.array([m for body in bodies.values() for m in (body["mass"], body["mass"], body["inertia"])])
        self.weight = self.mass * np.tile((*scene["gravity"], 0.0), len(bodies))
        self.n, self.unit = len(self.mass), max(body["mass"] for body in bodies.values())
        self.inertia = np.array([*self.mass / self.unit, HEAVY])
        self.rows, self.names, self.contacts = [], [], []  # coordinates that are held, and the columns of their forces
        clearance = chosen["clearance"] * size_of(scene)
        for name, joint in scene["joints"].items():
            if joint["type"] == "revolute":
                for label, axis in (("fx", (1.0, 0.0)), ("fy", (0.0, 1.0))):
                    self._hold(f"{name}.{label}", Coordinate(place, "pin", joint["bodies"], joint["points"], axis), 0.0)
                continue
            corners = range(4) if joint["length"] else (0, 2)
            self.contacts += [Contact(name, joint, corner, clearance, chosen["restitution"], place)
                              for corner in corners]
            if not joint["length"]:
                self._hold(f"{name}.moment", Coordinate(place, "angle", (joint["slider"], joint["guide"])),
                           joint["angle"])
        for name, drive in scene["drives"].items():
            self._hold(f"{name}.effort", Coordinate(place, drive["type"], drive["bodies"], drive["points"],
                                                    drive["axis"]), drive["law"])
        self.springs = [(spring, Coordinate(place, spring["type"], spring["bodies"], spring.get("points"),
                                            spring.get("axis"))) for spring in scene["springs"].values()]
        self.loads = [(load, place[load["body"]], Law(load["law"])) for load in scene["forces"].values()]
        guides = [column for contact in self.contacts
                  for column in (contact.resultant, contact.moment, *contact.normals, *contact.frictions)]
        self.columns = list(dict.fromkeys([*self.names, *guides]))
        q = [x for body in bodies.values() for x in (*body["position"], body["angle"])]
        v = [x for body in bodies.values() for x in (*body["velocity"], body["angular_velocity"])]
        self.system = kernel.LagrangianDS(np.array([*q, 0.0]), np.array([*v, 1.0]), np.diag(self.inertia))
        self._build(chosen)

    def _hold(self, column, coordinate, law):
        self.names.append(column)
        self.rows.append((coordinate, Law(law if isinstance(law, dict) else {"type": "constant", "value": law})))

    def _build(self, chosen):
        self.system.setFExtPtr(np.zeros(self.n + 1))  # a copy: `fExt` is what the system has
        model = kernel.NonSmoothDynamicalSystem(0.0, 1e12)
        model.insertDynamicalSystem(self.system)
        self.J = []
        if self.rows:
            relation = kernel.LagrangianLinearTIR(np.zeros((len(self.rows), self.n + 1)), np.zeros(len(self.rows)))
            self.bilateral = kernel.Interaction(kernel.EqualityConditionNSL(len(self.rows)), relation)
            self.J = relation.C()
            model.link(self.bilateral, self.system)
        for contact in self.contacts:
            model.link(contact.interaction, self.system)
        self.problem = kernel.GenericMechanical()
        self.options = self.problem.numericsSolverOptions()
        self.options.iparam[numerics.SICONOS_IPARAM_MAX_ITER] = int(chosen["iterations"])
        kernel.solver_options_update_internal(self.options, 3, BLOCKS[chosen["block"]])
        self.simulation = kernel.TimeStepping(model, kernel.TimeDiscretisation(0.0, self.h),
                                              kernel.MoreauJeanOSI(chosen["theta"]), self.problem)
        self.simulation.setNewtonOptions(kernel.SICONOS_TS_LINEAR)
        self.simulation.initialize()

    def forces(self, t, q, v):
        """Applied forces on all coordinates: weight, springs, loads."""
        total = self.weight.copy()
        for spring, coordinate in self.springs:
            row = np.zeros(self.n)
            value = coordinate.at(q, row)
            rest = spring["rest_angle" if spring["type"] == "torsional" else "rest_length"]
            total -= (spring["stiffness"] * (value - rest) + spring["damping"] * (row @ v)) * row
        for load, i, law in self.loads:
            size = law(t)[0]
            if load["type"] == "torque":
                total[i + 2] += size
                continue
            (x, y), (ax, ay) = load["direction"], turned(q[i + 2], load["point"])
            total[i:i + 3] += size / math.hypot(x, y) * np.array((x, y, ax * y - ay * x))
        return total

    def step(self, t):
        """Let Siconos make the step from time t; return the change of velocity and the reactions by column."""
        h, n, q, v = self.h, self.n, self.system.q().copy(), self.system.velocity().copy()
        middle = q + h / 2 * v
        at = middle.tolist()
        F = np.zeros(n + 1)
        F[:n] = self.forces(t + h / 2, at, v[:n]) / self.unit
        for row, (coordinate, law) in zip(self.J, self.rows):
            wanted, rate = law(t + h / 2)
            row[n] = (coordinate.at(at, row) - wanted) / h - rate
        for contact in self.contacts:
            contact.write(at, middle)
        self._stiffen(F, v)
        scale = max(np.abs(v[:n]).max(), h * np.abs(F[:n] / self.mass).max(), 1e-300)
        for contact in self.contacts:
            contact.law.setMu(contact.mus if abs(contact.C[1] @ v) <= AT_REST * scale else contact.mu)
        self.options.dparam[numerics.SICONOS_DPARAM_TOL] = self.tolerance * scale
        self.simulation.updateOutput()
        self.simulation.updateIndexSets()
        closed = [contact for contact in self.contacts if contact.closed(h)]
        self.simulation.computeOneStep()
        reactions = self._reactions(closed, v, F, self.tolerance * scale, t)
        change = (self.system.velocity() - v)[:n] / h
        self.system.forces()[:] = 0.0
        self.simulation.nextStep()
        return change, reactions

    def _stiffen(self, F, v):
        n, M, f = self.n, self.system.mass(), F.copy()
        if self.rows:
            J, rest = self.J[:, :n], self.J[:, n]
            self.r = STIFF / ((J * J) @ (1 / self.inertia[:n]))
            M[:n, :n] = np.diag(self.inertia[:n]) + (J.T * self.r) @ J
            f[:n] -= (self.r * (self.J @ v)) @ J / self.h
        self.system.fExt()[:] = f / self.theta

    def _reactions(self, closed, v, F, tolerance, t):
        """Impulses of the step over its length, by column; end the program if they do not solve it."""
        new, h = self.system.velocity(), self.h
        balance, off = self.inertia * (new - v) - h * F, [0.0]
        found = dict.fromkeys(self.columns, 0.0)
        if self.rows:
            impulses = self.bilateral.lambda_(1) - self.r * (self.J @ new)
            balance -= impulses @ self.J
            off.append(np.abs(self.J @ new).max())
            found.update(zip(self.names, impulses))
        for contact in closed:
            P, C = contact.interaction.lambda_(1), contact.C
            normal, slip = C @ new
            gain = (C * C) @ (1 / self.inertia)
            balance -= P @ C
            normal += contact.law.en() * (C[0] @ v)
            bound, pull = contact.law.mu() * gain[1] * P[0], gain[1] * P[1]
            off += [abs(min(normal, gain[0] * P[0])), abs(pull - max(-bound, min(bound, pull - slip)))]
            contact.add(P, found)
        off.append(np.abs(balance / self.inertia).max())
        if not max(off) <= SLACK * tolerance:
            sys.exit(f"Siconos does not solve the step at t = {t:.9g} s: residual {max(off):.2g} m/s or rad/s after "
                     f"{self.options.iparam[numerics.SICONOS_IPARAM_ITER_DONE]} iterations; expected "
                     f"{SLACK * tolerance:.2g}")
        return [impulse * self.unit / h for impulse in found.values()]


def turned(angle, point):
    """A point of a body's axes in those of the ground."""
    c, s = math.cos(angle), math.sin(angle)
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


def size_of(scene):
    """The largest extent of points of pins, sliders and positions (m)."""
    joints = scene["joints"].values()
    lengths = [abs(x) for joint in joints for point in joint.get("points", ()) for x in point]
    lengths += [joint.get(key) or 0.0 for joint in joints for key in ("length", "width")]
    return max(lengths + [abs(x) for body in scene["bodies"].values() for x in body["position"]]) or 1.0


def setting(text):
    """Name and value of a setting."""
    key, _, value = text.partition("=")
    return key, value if key == "block" else float(value)


def main(scene_file, result_file, report_file, dt, output_step, *settings):
    """Read the scene, step to its end, write the table."""
    with open(scene_file, encoding="utf-8") as file:
        scene = json.load(file)["scene"]
    steps = max(1, round(scene["t_end"] / float(dt)))
    h = scene["t_end"] / steps
    mechanism = Mechanism(scene, h, dict(map(setting, settings)))
    every = max(1, int(float(output_step) / h + 1e-9))
    labels = [f"{name}.{label}" for labels in (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
              for name in scene["bodies"] for label in labels]
    setup, iterations, n = time.process_time(), 0, mechanism.n
    with open(result_file, "w", encoding="utf-8") as file:
        print("t", *labels, *mechanism.columns, sep=",", file=file)
        for k in range(steps + 1):
            q, v = mechanism.system.q()[:n].tolist(), mechanism.system.velocity()[:n].tolist()
            change, reactions = mechanism.step(k * h)
            iterations += int(mechanism.options.iparam[numerics.SICONOS_IPARAM_ITER_DONE])
            if k % every == 0 or k == steps:
                print(k * h, *q, *v, *change.tolist(), *reactions, sep=",", file=file)
    with open(report_file, "w", encoding="utf-8") as file:
        json.dump({"setup_s": setup, "counters": {"steps": steps + 1, "iterations": iterations}}, file)


if __name__ == "__main__":
    print(f"siconos {siconos.__version__}") if sys.argv[1:] == ["--version"] else main(*sys.argv[1:])
