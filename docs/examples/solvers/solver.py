"""Time stepping of planar mechanisms with dry friction, with the standard library of Python only.

The method is Moreau's midpoint rule. A step of length h begins with the coordinates q and the velocities v. With
m = q + h v/2 and p = q + h v, the velocities w at its end and the impulses L of joints and drives and P of friction
solve

    M (w - v) = h Q(t + h/2, m, v) + J(m)' L + T(m)' P,    J(p) w = -dPhi/dt - Phi(q) / (10 h),    |P| <= mu load,
    q <- q + h (v + w) / 2,    load of the corners of a slider: max(|R|, 2 |N| / length) of its own impulses L

where R is the normal impulse and N its moment. The term Phi(q) / (10 h) reduces a violation of the constraints Phi by a
tenth in each step.
"""

import bisect
import json
import math
import sys

# laws of time


def law(data, t):
    """Return value and rate of a law at time t."""
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
    if not x[0] <= t < x[-1]:
        # Outside of the knots, the law has its value at the end or, if cubic, continues along its tangent.
        k, bend = (0, -2 * b[0] - b[1]) if t < x[0] else (-1, b[-2] + 2 * b[-1])
        rate = slope + h / 6 * bend if cubic else 0.0
        return y[k] + rate * (t - x[k]), rate
    u, s = t - x[i], x[i + 1] - t
    value = (b[i] * s**3 + b[i + 1] * u**3) / (6 * h)
    value += (y[i] / h - b[i] * h / 6) * s + (y[i + 1] / h - b[i + 1] * h / 6) * u
    return value, (b[i + 1] * u**2 - b[i] * s**2) / (2 * h) + slope - h / 6 * (b[i + 1] - b[i])


def spline(x, y):
    """Return the second derivatives at the knots of the natural cubic spline.

    They solve a tridiagonal system; c and d are the coefficients that elimination leaves in its rows.
    """
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
    """A mechanism in motion: its coordinates q and velocities v (x, y, angle of each body), constraints and guides.

    A constraint is a row of the equations: the angle or a distance between two bodies follows a law of time. A guide
    with friction is a pair: the direction of sliding as a row, and the number of the row of its normal force, which is
    followed by that of its moment.
    """

    def __init__(self, scene):
        self.scene = scene
        bodies = scene["bodies"]
        # number of the first coordinate of each body
        self.place = {name: 3 * i for i, name in enumerate(bodies)}
        self.mass = [
            m for body in bodies.values() for m in (body["mass"], body["mass"], body["inertia"])
        ]
        self.q = [x for body in bodies.values() for x in (*body["position"], body["angle"])]
        self.v = [
            x for body in bodies.values() for x in (*body["velocity"], body["angular_velocity"])
        ]
        self.rows = []
        self.guides = []
        for joint in scene["joints"].values():
            if joint["type"] == "revolute":
                # Two points coincide: both components of their distance are zero.
                self.rows += [
                    {**joint, "type": "distance", "axis": axis, "law": zero}
                    for axis in ([1, 0], [0, 1])
                ]
                continue
            # The slider moves along the direction d of its guide and does not turn in it.
            d = joint["direction"]
            sides = {
                "bodies": (joint["slider"], joint["guide"]),
                "type": "distance",
                "points": (joint["slider_point"], joint["point"]),
            }
            if joint["mu"] is not None:
                self.guides.append(({**joint, **sides, "axis": d}, len(self.rows)))
            self.rows += [
                {**sides, "axis": (-d[1], d[0]), "law": zero},
                {**sides, "type": "angle", "law": {"type": "constant", "value": joint["angle"]}},
            ]
        self.rows += scene["drives"].values()

    def coordinate(self, element, q):
        """Return the angle or distance between two bodies that an element is about, and its derivatives by q.

        A distance is measured along the axis of the element, which is fixed to the second body, or between two points.
        """
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
            # the point of the first body, from the centre of the second one
            there = (x + arm[0] - s, y + arm[1] - t)
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
        """Return the applied forces on all coordinates: weight, springs, loads."""
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
        """Return the velocities after a step of length h from time t, and the friction impulses."""
        v, n, m = self.v, len(self.v), len(self.rows)
        middle, ahead = ([x + share * h * dx for x, dx in zip(self.q, v)] for share in (0.5, 1.0))
        Q = self.forces(t + h / 2, middle, v)
        J = [self.coordinate(row, middle)[1] for row in self.rows]
        T = [self.coordinate(row, middle)[1] for row, _ in self.guides]
        # The unknowns are the velocities and the impulses of joints and drives. The right sides are those without
        # friction and, for each guide, with a friction impulse of 1.
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
        # Friction changes the loads of all guides, on which it depends. The iteration ends when it changes no more.
        for _ in range(200):
            before = list(P)
            for k, (guide, normal) in enumerate(self.guides):
                now, unit = sums(free, P, units), units[k]
                gain, slip = dot(slips[k], unit), dot(slips[k], now)
                held = P[k] - slip / gain  # impulse with which the slider does not slip
                R, N = now[n + normal : n + normal + 2]
                most = guide["mu"] * load(guide, R, N, math.copysign(guide["mu"], held))
                found, more = max(-most, min(most, held)), held - P[k]
                # A slider that was at rest, or would reverse, may stick with the larger coefficient. The load is that
                # with the impulse that holds the slider.
                hold = guide["mus"] * load(
                    guide,
                    R + more * unit[n + normal],
                    N + more * unit[n + normal + 1],
                    math.copysign(guide["mus"], held),
                )
                was, will = dot(T[k], v), gain * (found - held)
                at_rest = abs(was) < 1e-9 or was * will <= 0
                P[k] = held if at_rest and abs(held) <= hold else found
            if all(abs(new - old) <= 1e-12 * abs(new) for new, old in zip(P, before)):
                break
        return sums(free, P, units)[:n], P


zero = {"type": "constant", "value": 0.0}


def load(guide, R, N, kappa):
    """Return the sum of the corner forces of a slider, from its normal impulse R and the moment N of this impulse.

    kappa is the ratio of friction to load, with its sign: friction on the surfaces has a moment about the middle of the
    slider.
    """
    if guide["length"] is None:
        return abs(R)
    return max(abs(R), 2 * abs(N - guide["width"] / 2 * kappa * R) / guide["length"])


def turned(angle, point):
    """Return a point, given in the axes of a body at an angle, in the axes of the ground."""
    c, s = math.cos(angle), math.sin(angle)
    return c * point[0] - s * point[1], s * point[0] + c * point[1]


def dot(a, b):
    """Return the scalar product."""
    return sum(x * y for x, y in zip(a, b))


def sums(free, P, units):
    """Return the solution for friction impulses P: without friction, plus P times those for friction impulses of 1."""
    return [x + sum(p * unit[i] for p, unit in zip(P, units)) for i, x in enumerate(free)]


def solved(rows, n):
    """Return the solutions of n linear equations for several right sides, by Gauss-Jordan elimination."""
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        if abs(rows[k][k]) < 1e-13:
            print("constraints that depend on each other: a singular matrix", file=sys.stderr)
            # With this code a program refuses a scene.
            sys.exit(77)
        for i in range(n):
            if i != k and (factor := rows[i][k] / rows[k][k]):
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k])]
    return [[rows[i][j] / rows[i][i] for i in range(n)] for j in range(n, len(rows[0]))]


def main(scene_file, result_file, dt, output_step):
    """Read a scene, simulate it to its end, and write the table of results."""
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
        # Accelerations and friction forces at an instant are the mean of those in the steps before and after it.
        last = None
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
