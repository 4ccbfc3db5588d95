"""Time stepping of planar mechanisms with dry friction: Python's standard library and nothing else.

Moreau's midpoint rule. In a step of length h from (q, v), with m = q + h v/2 and p = q + h v, the next velocity w and
the impulses L of joints and drives and P of friction solve

    M (w - v) = h Q(t + h/2, m, v) + J(m)' L + T(m)' P,    J(p) w = -dPhi/dt - Phi(q) / (10 h),    |P| <= mu load,
    q <- q + h (v + w) / 2,    load of the corners of a slider: max(|R|, 2 |N| / length) of its own impulses L
"""

import bisect
import json
import math
import sys

# laws of time


def law(data, t):
    """Value and rate of a law at time t."""
    kind = data["type"]
    if kind == "constant":
        return data["value"], 0.0
    if kind == "linear":
        return data["offset"] + data["rate"] * t, data["rate"]
    if kind == "sine":
        a, w, phase = data["amplitude"], data["frequency"], data["frequency"] * t + data["phase"]
        return data["offset"] + a * math.sin(phase), a * w * math.cos(phase)
    x, y, cubic = data["times"], data["values"], data["interpolation"] == "cubic"
    if "bend" not in data:
        data["bend"] = spline(x, y) if cubic else [0.0] * len(x)
    b = data["bend"]
    i = min(max(bisect.bisect_right(x, t) - 1, 0), len(x) - 2)
    h, slope = x[i + 1] - x[i], (y[i + 1] - y[i]) / (x[i + 1] - x[i])
    if not x[0] <= t < x[-1]:  # outside: the end value, or the end's tangent
        k, bend = (0, -2 * b[0] - b[1]) if t < x[0] else (-1, b[-2] + 2 * b[-1])
        rate = slope + h / 6 * bend if cubic else 0.0
        return y[k] + rate * (t - x[k]), rate
    u, s = t - x[i], x[i + 1] - t
    value = (b[i] * s**3 + b[i + 1] * u**3) / (6 * h)
    value += (y[i] / h - b[i] * h / 6) * s + (y[i + 1] / h - b[i + 1] * h / 6) * u
    return value, (b[i + 1] * u**2 - b[i] * s**2) / (2 * h) + slope - h / 6 * (b[i + 1] - b[i])


def spline(x, y):
    """Second derivatives at the knots of the natural cubic spline: a tridiagonal system, first down, then up."""
    n, c, d = len(x), [0.0] * len(x), [0.0] * len(x)
    for i in range(1, n - 1):
        left, right = x[i] - x[i - 1], x[i + 1] - x[i]
        pivot = 2 * (left + right) - left * c[i - 1]
        c[i] = right / pivot
        d[i] = (
            6 * ((y[i + 1] - y[i]) / right - (y[i] - y[i - 1]) / left) - left * d[i - 1]
        ) / pivot
    for i in range(n - 2, 0, -1):
        d[i] -= c[i] * d[i + 1]
    return d


# mechanics


class Mechanism:
    """Coordinates q, velocities v (x, y, angle of each body), and what acts between bodies."""

    def __init__(self, scene):
        self.scene, bodies = scene, scene["bodies"]
        self.place = {name: 3 * i for i, name in enumerate(bodies)}
        self.mass = [
            m for body in bodies.values() for m in (body["mass"], body["mass"], body["inertia"])
        ]
        self.q = [x for body in bodies.values() for x in (*body["position"], body["angle"])]
        self.v = [
            x for body in bodies.values() for x in (*body["velocity"], body["angular_velocity"])
        ]
        self.rows, self.guides = (
            [],
            [],
        )  # constraints; guides with friction: tangential row, number of the normal row
        for joint in scene["joints"].values():
            if joint["type"] == "revolute":
                self.rows += [
                    {**joint, "type": "distance", "axis": axis, "law": zero}
                    for axis in ([1, 0], [0, 1])
                ]
                continue
            d, sides = (
                joint["direction"],
                {"bodies": (joint["slider"], joint["guide"]), "type": "distance"},
            )
            sides |= {"points": (joint["slider_point"], joint["point"])}
            if joint["mu"] is not None:
                self.guides.append(({**joint, **sides, "axis": d}, len(self.rows)))
            self.rows += [
                {**sides, "axis": (-d[1], d[0]), "law": zero},
                {**sides, "type": "angle", "law": {"type": "constant", "value": joint["angle"]}},
            ]
        self.rows += scene["drives"].values()

    def coordinate(self, element, q):
        """A coordinate between two bodies, angle or distance, and its derivatives with respect to q."""
        row = [0.0] * len(q)
        (x, y, a), (s, t, b) = (
            [q[i : i + 3] for i in [self.place[name]]][0] if name in self.place else (0.0, 0.0, 0.0)
            for name in element["bodies"]
        )
        if element["type"] in ("angle", "torsional"):
            value, parts = a - b, ((0, 0, 1), (0, 0, -1))
        else:
            arm, own = turned(a, element["points"][0]), turned(b, element["points"][1])
            between = x + arm[0] - s - own[0], y + arm[1] - t - own[1]
            e = turned(b, element["axis"]) if element["axis"] else between
            e = [part / (math.hypot(*e) or 1.0) for part in e]
            there = (
                x + arm[0] - s,
                y + arm[1] - t,
            )  # the same place, seen from the second body's centre
            value = e[0] * between[0] + e[1] * between[1]
            parts = (
                (*e, arm[0] * e[1] - arm[1] * e[0]),
                (-e[0], -e[1], there[1] * e[0] - there[0] * e[1]),
            )
        for name, part in zip(element["bodies"], parts):
            if name in self.place:
                row[self.place[name] : self.place[name] + 3] = part
        return value, row

    def forces(self, t, q, v):
        """Applied forces on all coordinates: weight, springs, loads."""
        gx, gy = self.scene["gravity"]
        Q = [m * g for m, g in zip(self.mass, (gx, gy, 0.0) * len(self.place))]
        for spring in self.scene["springs"].values():
            value, row = self.coordinate(spring, q)
            rest = spring["rest_angle" if spring["type"] == "torsional" else "rest_length"]
            pull = spring["stiffness"] * (value - rest) + spring["damping"] * dot(row, v)
            Q = [force - pull * part for force, part in zip(Q, row)]
        for load in self.scene["forces"].values():
            i, size = self.place[load["body"]], law(load["law"], t)[0]
            if load["type"] == "torque":
                Q[i + 2] += size
                continue
            (x, y), arm = load["direction"], turned(q[i + 2], load["point"])
            size /= math.hypot(x, y)
            for k, part in enumerate((x, y, arm[0] * y - arm[1] * x)):
                Q[i + k] += size * part
        return Q

    def step(self, t, h):
        """Velocity after a step from time t, and its friction impulses."""
        v, n, m = self.v, len(self.v), len(self.rows)
        middle, ahead = ([x + share * h * dx for x, dx in zip(self.q, v)] for share in (0.5, 1.0))
        Q = self.forces(t + h / 2, middle, v)
        J = [self.coordinate(row, middle)[1] for row in self.rows]
        T = [self.coordinate(row, middle)[1] for row, _ in self.guides]
        system = [
            [
                *(mass * (i == j) for j in range(n)),
                *(-row[i] for row in J),
                mass * v[i] + h * Q[i],
                *(row[i] for row in T),
            ]
            for i, mass in enumerate(self.mass)
        ]
        for row in self.rows:
            error = self.coordinate(row, self.q)[0] - law(row["law"], t)[0]
            wanted = law(row["law"], t + h)[1] - error / (10 * h)
            system.append([*self.coordinate(row, ahead)[1], *[0.0] * m, wanted, *[0.0] * len(T)])
        free, *units = solved(system, n + m)
        slips = [self.coordinate(row, ahead)[1] for row, _ in self.guides]
        P = [0.0] * len(T)
        for _ in range(200):  # a friction changes the loads, also of other guides
            before = list(P)
            for k, (guide, normal) in enumerate(self.guides):
                now, unit = sums(free, P, units), units[k]
                gain, slip = dot(slips[k], unit), dot(slips[k], now)
                held = P[k] - slip / gain  # the impulse that ends the slip
                R, N = now[n + normal : n + normal + 2]
                most = guide["mu"] * load(guide, R, N, math.copysign(guide["mu"], held))
                found, more = max(-most, min(most, held)), held - P[k]
                hold = guide["mus"] * load(
                    guide,
                    R + more * unit[n + normal],
                    N + more * unit[n + normal + 1],
                    math.copysign(guide["mus"], held),
                )
                was, will = dot(T[k], v), gain * (found - held)
                at_rest = abs(was) < 1e-9 or was * will <= 0  # or on its way through rest
                P[k] = held if at_rest and abs(held) <= hold else found
            if all(abs(new - old) <= 1e-12 * abs(new) for new, old in zip(P, before)):
                break
        return sums(free, P, units)[:n], P


zero = {"type": "constant", "value": 0.0}


def load(guide, R, N, kappa):
    """Sum of the corner forces, from the normal impulse R, its moment N, and friction over load on the surfaces."""
    if guide["length"] is None:
        return abs(R)
    return max(abs(R), 2 * abs(N - guide["width"] / 2 * kappa * R) / guide["length"])


def turned(angle, point):
    """A point of a body's axes in those of the ground."""
    c, s = math.cos(angle), math.sin(angle)
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


def dot(a, b):
    """Scalar product."""
    return sum(x * y for x, y in zip(a, b))


def sums(free, P, units):
    """Velocities and impulses without friction, and those of friction added."""
    return [x + sum(p * unit[i] for p, unit in zip(P, units)) for i, x in enumerate(free)]


def solved(rows, n):
    """Gauss-Jordan elimination of n rows with several right sides; one solution for each."""
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        if abs(rows[k][k]) < 1e-13:
            print("constraints that depend on each other: a singular matrix", file=sys.stderr)
            sys.exit(77)
        for i in range(n):
            if i != k and (factor := rows[i][k] / rows[k][k]):
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k])]
    return [[rows[i][j] / rows[i][i] for i in range(n)] for j in range(n, len(rows[0]))]


def main(scene_file, result_file, dt, output_step):
    """Read the scene, step to its end, write the table."""
    with open(scene_file, encoding="utf-8") as file:
        scene = json.load(file)["scene"]
    mechanism = Mechanism(scene)
    steps = max(1, round(scene["t_end"] / float(dt)))
    h = scene["t_end"] / steps
    every = max(1, int(float(output_step) / h + 1e-9))
    labels = [
        f"{name}.{label}"
        for labels in (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
        for name in scene["bodies"]
        for label in labels
    ]
    frictions = [
        f"{name}.friction" for name, joint in scene["joints"].items() if joint.get("mu") is not None
    ]
    with open(result_file, "w", encoding="utf-8") as file:
        print("t", *labels, *frictions, sep=",", file=file)
        last = None  # acceleration and frictions of the step before: at an instant they are the mean of both sides'
        for k in range(steps + 1):
            w, P = mechanism.step(k * h, h)
            step = [(new - old) / h for new, old in zip(w, mechanism.v)] + [p / h for p in P]
            if k % every == 0 or k == steps:
                mean = [(a + b) / 2 for a, b in zip(step, last or step)]
                print(k * h, *mechanism.q, *mechanism.v, *mean, sep=",", file=file)
            mechanism.q = [
                x + h / 2 * (old + new) for x, old, new in zip(mechanism.q, mechanism.v, w)
            ]
            mechanism.v, last = w, step


if __name__ == "__main__":
    print("python-example 1.0") if sys.argv[1:] == ["--version"] else main(*sys.argv[1:])
