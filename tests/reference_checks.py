"""What the tests of the reference hold its trajectories to, written from the scene and the columns alone."""

import numpy as np

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes.laws import evaluate_law, law_kinks
from stiction.scenes.model import Force, LinearSpring, Revolute

MOTION = ("x", "y", "angle", "vx", "vy", "omega", "ax", "ay", "alpha")


def simulate(scene, **arguments):
    trajectory = ReferenceEngine().simulate(scene, **arguments)
    assert trajectory.termination == "end", trajectory.termination
    return trajectory


def guide_scene(slider=None, guide=None, t_end=1, gravity=(0, -10), **sections):
    """A slider of 1 kg on a horizontal guide, as the tables of a scene file."""
    return {"t_end": t_end, "gravity": list(gravity), "bodies": {"slider": {"mass": 1, "inertia": 1, **(slider or {})}},
            "joints": {"guide": {"type": "translational", "slider": "slider", **(guide or {})}}, **sections}


def along(direction, **law):
    """A force on the slider's centre."""
    return {"type": "force", "body": "slider", "direction": direction, "law": law}


def errors(trajectory, truth, columns=None, near=1e-8):
    """Largest difference by column, but for instants within `near` of an event, where two sides may be compared."""
    t = trajectory.t
    times = np.array([event.time for event in truth.events])
    chosen = np.min(np.abs(t[:, None] - times), axis=1) > near if len(times) else np.ones(len(t), dtype=bool)
    expected = truth(t[chosen])
    return {name: np.max(np.abs(trajectory[name][chosen] - expected[name])) for name in columns or expected}


def states(found):
    """The largest errors of positions and velocities among those of `errors`."""
    return max(value for name, value in found.items() if name.rpartition(".")[2] in MOTION[:6])


def same_events(trajectory, truth, tolerance):
    """Same events in the same order, each within tolerance; events of one instant may come in any order."""
    def key(event):
        return round(event.time, 6), event.joint, event.kind

    found, expected = sorted(trajectory.events, key=key), sorted(truth.events, key=key)
    assert [(e.kind, e.joint) for e in found] == [(e.kind, e.joint) for e in expected]
    assert max((abs(a.time - b.time) for a, b in zip(found, expected)), default=0.0) <= tolerance


class Geometry:
    """Points and directions of a trajectory's bodies over time, in ground axes; the columns are those of `columns`."""

    def __init__(self, columns, n):
        self.columns, self.n = columns, n

    def body(self, name, labels):
        return np.array([self.columns[f"{name}.{label}"] for label in labels.split()])

    def turned(self, body, vector):
        if body == "ground":
            return np.repeat(np.array(vector, dtype=float)[:, None], self.n, axis=1)
        c, s = np.cos(self.columns[f"{body}.angle"]), np.sin(self.columns[f"{body}.angle"])
        return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])

    def point(self, body, p):
        arm = self.turned(body, p)
        return arm if body == "ground" else self.body(body, "x y") + arm

    def velocity(self, body, p):
        if body == "ground":
            return np.zeros((2, self.n))
        arm = self.turned(body, p)
        return self.body(body, "vx vy") + self.columns[f"{body}.omega"] * np.array([-arm[1], arm[0]])

    def spin(self, body):
        return np.zeros(self.n) if body == "ground" else self.columns[f"{body}.omega"]

    def angle(self, body):
        return np.zeros(self.n) if body == "ground" else self.columns[f"{body}.angle"]


def law_values(law, t):
    return np.array([evaluate_law(law, float(time))[0] for time in t])


def law_rates(law, t):
    return np.array([evaluate_law(law, float(time))[1] for time in t])


def elongation(geometry, element):
    """Distance of a spring or drive, its rate, and the unit direction from the point on bodies[1] to the other."""
    (a, b), (p, r) = element.bodies, element.points
    d, rate = geometry.point(a, p) - geometry.point(b, r), geometry.velocity(a, p) - geometry.velocity(b, r)
    if element.axis is None:
        length = np.hypot(*d)
        u = d / np.where(length > 0, length, 1.0)
        return length, np.sum(u * rate, axis=0), u
    u = geometry.turned(b, np.array(element.axis) / np.hypot(*element.axis))
    return np.sum(u * d, axis=0), np.sum(u * rate, axis=0) + geometry.spin(b) * (u[0] * d[1] - u[1] * d[0]), u


def balance_residual(scene, t, columns):
    """Largest residual of Newton's and Euler's equations over all bodies and instants, relative to the largest force.

    Every force acts on two bodies, oppositely and along one line: what this sums up is action = reaction too.
    """
    geometry = Geometry(columns, len(t))
    total = {name: np.zeros((3, len(t))) for name in scene.bodies}
    size = {name: np.full(len(t), 1e-9) for name in scene.bodies}

    def push(body, point, force):
        if body == "ground":
            return
        arm = point - geometry.body(body, "x y")
        total[body] += [force[0], force[1], arm[0] * force[1] - arm[1] * force[0]]
        size[body] += np.hypot(*force) * (1 + np.hypot(*arm))

    def pair(first, second, point, force):
        push(first, point, force)
        push(second, point, -force)

    def twist(first, second, torque):
        for body, value in ((first, torque), (second, -torque)):
            if body != "ground":
                total[body][2] += value
                size[body] += np.abs(value)

    for name, body in scene.bodies.items():
        gravity = np.repeat(np.array(scene.gravity or (0, 0))[:, None], len(t), axis=1)
        push(name, geometry.body(name, "x y"), body.mass * gravity)
    for name, joint in scene.joints.items():
        first, second = joint.bodies
        if isinstance(joint, Revolute):
            force = np.array([columns[f"{name}.fx"], columns[f"{name}.fy"]])
            # each at its own point: they differ by the drift
            push(first, geometry.point(first, joint.points[0]), force)
            push(second, geometry.point(second, joint.points[1]), -force)
            continue
        u = geometry.turned(second, np.array(joint.direction) / np.hypot(*joint.direction))
        force = columns[f"{name}.normal_force"] * np.array([-u[1], u[0]])
        if joint.frictional:
            force = force + columns[f"{name}.friction"] * u
        pair(first, second, geometry.point(first, joint.slider_point), force)
        twist(first, second, columns[f"{name}.moment"])
    for name, drive in scene.drives.items():
        effort = columns[f"{name}.effort"]
        if drive.type == "angle":
            twist(*drive.bodies, effort)
        else:
            u = elongation(geometry, drive)[2]
            pair(*drive.bodies, geometry.point(drive.bodies[0], drive.points[0]), effort * u)
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring):
            length, rate, u = elongation(geometry, spring)
            tension = spring.stiffness * (length - spring.rest_length) + spring.damping * rate
            pair(*spring.bodies, geometry.point(spring.bodies[0], spring.points[0]), -tension * u)
        else:
            a, b = spring.bodies
            twist(a, b, -spring.stiffness * (geometry.angle(a) - geometry.angle(b) - spring.rest_angle)
                  - spring.damping * (geometry.spin(a) - geometry.spin(b)))
    for load in scene.forces.values():
        value = law_values(load.law, t)
        if isinstance(load, Force):
            u = np.array(load.direction) / np.hypot(*load.direction)
            push(load.body, geometry.point(load.body, load.point), u[:, None] * value)
        else:
            twist(load.body, "ground", value)
    worst = 0.0
    for name, body in scene.bodies.items():
        rate = geometry.body(name, "ax ay alpha") * np.array([[body.mass], [body.mass], [body.inertia]])
        worst = max(worst, np.max(np.abs(rate - total[name]) / np.max(size[name])))
    return worst


def kinetic_energy(scene, columns, n):
    geometry = Geometry(columns, n)
    return sum(body.mass * np.sum(geometry.body(name, "vx vy") ** 2, axis=0) / 2
               + body.inertia * columns[f"{name}.omega"] ** 2 / 2 for name, body in scene.bodies.items())


def energy(scene, columns, n):
    """T + V: kinetic energy, weight, springs."""
    geometry = Geometry(columns, n)
    total = kinetic_energy(scene, columns, n)
    for name, body in scene.bodies.items():
        total = total - body.mass * np.array(scene.gravity or (0, 0)) @ geometry.body(name, "x y")
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring):
            total += spring.stiffness * (elongation(geometry, spring)[0] - spring.rest_length) ** 2 / 2
        else:
            a, b = spring.bodies
            total += spring.stiffness * (geometry.angle(a) - geometry.angle(b) - spring.rest_angle) ** 2 / 2
    return total


def power(scene, t, columns):
    """Power of friction, drives, dampers and loads."""
    geometry = Geometry(columns, len(t))
    total = np.zeros(len(t))
    for name in scene.frictional_guides:
        total += columns[f"{name}.friction"] * columns[f"{name}.slip_velocity"]
    for name, drive in scene.drives.items():
        total += columns[f"{name}.effort"] * law_rates(drive.law, t)
    for spring in scene.springs.values():
        if isinstance(spring, LinearSpring):
            total -= spring.damping * elongation(geometry, spring)[1] ** 2
        else:
            total -= spring.damping * (geometry.spin(spring.bodies[0]) - geometry.spin(spring.bodies[1])) ** 2
    for load in scene.forces.values():
        value = law_values(load.law, t)
        if isinstance(load, Force):
            u = np.array(load.direction) / np.hypot(*load.direction)
            total += value * (u @ geometry.velocity(load.body, load.point))
        else:
            total += value * geometry.spin(load.body)
    return total


def energy_defect(scene, t_end, rtol, stabilization="projection", panel=0.02, order=12):
    """|T + V at the end - at the start - work done|, relative to kinetic energy and work.

    Work: Gauss-Legendre on panels that end at events and at kinks of laws.
    """
    mechanism = Mechanism(scene, stabilization)
    q, v = consistent_start(mechanism)
    ends = np.array([0.0, t_end])
    first = simulate_event_driven(mechanism, q, v, ends, t_end, rtol)
    assert first.termination == "end", first.termination
    laws = [element.law for element in (*scene.drives.values(), *scene.forces.values())]
    kinks = [kink for law in laws for kink in law_kinks(law, t_end)]
    stops = np.unique([0.0, t_end, *(event.time for event in first.events), *kinks])
    edges = np.concatenate([np.linspace(a, b, int(np.ceil((b - a) / panel)) + 1)[:-1]
                            for a, b in zip(stops, stops[1:])])
    edges = np.append(edges, t_end)
    x, weight = np.polynomial.legendre.leggauss(order)
    half = np.diff(edges)[:, None] / 2
    nodes = ((edges[1:] + edges[:-1])[:, None] / 2 + half * x).ravel()
    run = simulate_event_driven(mechanism, q, v, nodes, t_end, rtol)
    assert len(run.t) == len(nodes)
    work = (half * weight).ravel() * power(scene, nodes, run.columns)
    change = np.diff(energy(scene, first.columns, 2))[0]
    kinetic = np.max(kinetic_energy(scene, run.columns, len(nodes)))
    return abs(change - np.sum(work)) / (kinetic + np.sum(np.abs(work)))
