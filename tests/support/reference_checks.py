"""What the tests of the reference hold its trajectories to, by its columns and the dense equations of motion."""

import numpy as np

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.reference_impl.integration.event_driven import simulate_event_driven
from stiction.reference_impl.multibody.initial_state import consistent_start
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes.laws import evaluate_law, law_kinks

MOTION = ("x", "y", "angle", "vx", "vy", "omega", "ax", "ay", "alpha")
LAWS = [
    {"type": "constant", "value": 0.7},
    {"type": "linear", "offset": 0.3, "rate": -1.7},
    {"type": "sine", "offset": 0.2, "amplitude": 1.1, "frequency": 9.0, "phase": 0.4},
    *(
        {
            "type": "table",
            "times": [0.1, 0.2, 0.45, 0.5, 0.8],
            "values": [0.3, -1, 2, 0.5, 0.25],
            "interpolation": kind,
        }
        for kind in ("linear", "cubic")
    ),
    {"type": "table", "times": [0.1, 0.9], "values": [1, -2], "interpolation": "cubic"},
]
"""One of each kind; the last begins later and ends earlier than the runs."""


def simulate(scene, **arguments):
    trajectory = ReferenceEngine().simulate(scene, **arguments)
    assert trajectory.termination == "end", trajectory.termination
    return trajectory


def guide_scene(slider=None, guide=None, t_end=1, gravity=(0, -10), **sections):
    """A slider of 1 kg on a horizontal guide, as the tables of a scene file."""
    return {
        "t_end": t_end,
        "gravity": list(gravity),
        "bodies": {"slider": {"mass": 1, "inertia": 1, **(slider or {})}},
        "joints": {"guide": {"type": "translational", "slider": "slider", **(guide or {})}},
        **sections,
    }


def along(direction, **law):
    """A force on the slider's centre."""
    return {"type": "force", "body": "slider", "direction": direction, "law": law}


def errors(trajectory, truth, columns=None, near=1e-8):
    """Largest difference by column, but for instants within `near` of an event, where two sides may be compared."""
    t = trajectory.t
    times = np.array([event.time for event in truth.events])
    chosen = (
        np.min(np.abs(t[:, None] - times), axis=1) > near
        if len(times)
        else np.ones(len(t), dtype=bool)
    )
    expected = truth(t[chosen])
    return {
        name: np.max(np.abs(trajectory[name][chosen] - expected[name]))
        for name in columns or expected
    }


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


def law_values(law, t):
    return np.array([evaluate_law(law, float(time))[0] for time in t])


def law_rates(law, t):
    return np.array([evaluate_law(law, float(time))[1] for time in t])


def motion(scene, columns):
    """q, v, a of shape (instants, coordinates)."""
    return (
        np.stack(
            [columns[f"{body}.{label}"] for body in scene.bodies for label in MOTION[k : k + 3]], -1
        )
        for k in (0, 3, 6)
    )


def balance_residual(scene, t, columns):
    """Largest residual of M q'' = QE + J^T lambda + W^T f, relative to the largest of the forces on its body.

    By the dense equations, which are another derivation than the compiled one: each row acts on two bodies, so that this is action = reaction too.
    Forces without a column may have any value.
    """
    equations, (q, v, a) = EquationsOfMotion(scene), motion(scene, columns)
    terms = equations.at(t, q, v)
    names = np.array([*equations.rows, *(f"{guide}.friction" for guide in equations.frictional)])
    known, rows = np.isin(names, list(columns)), np.concatenate([terms.J, terms.W], -2)
    forces = (
        np.array([columns[name] for name in names[known]]).T.reshape(len(t), -1, 1) * rows[:, known]
    )
    residual = equations.mass * a - terms.QE - forces.sum(-2)
    if not known.all():
        others = rows[:, ~known].swapaxes(-1, -2)
        residual -= (others @ (np.linalg.pinv(others) @ residual[..., None]))[..., 0]
    size = np.abs(equations.mass * a) + np.abs(terms.QE) + np.abs(forces).sum(-2)
    largest = size.reshape(len(t), -1, 3).sum(-1).max(0) + 1e-9
    return np.max(np.abs(residual).reshape(len(t), -1, 3).max((0, 2)) / largest)


def power(scene, t, columns):
    """Power of applied forces, friction and drives; other constraints have none."""
    equations, (q, v, _) = EquationsOfMotion(scene), motion(scene, columns)
    total = np.sum(v * equations.at(t, q, v).QE, -1)
    for name in equations.frictional:
        total += columns[f"{name}.friction"] * columns[f"{name}.slip_velocity"]
    for name, drive in scene.drives.items():
        total += columns[f"{name}.effort"] * law_rates(drive.law, t)
    return total


def kinetic_energy(scene, columns):
    _, v, _ = motion(scene, columns)
    return np.sum(EquationsOfMotion(scene).mass * v**2, -1) / 2


REST_SPEED = 1e-12
"""m/s and rad/s; speeds that rounding leaves of a mechanism at rest are far below: some 1e-16 of its size in a second."""


def energy_defect(scene, t_end, rtol, stabilization="projection", panel=0.02, order=12):
    """|T at the end - at the start - work done|, relative to kinetic energy and work.

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
    edges = np.concatenate(
        [
            np.linspace(a, b, int(np.ceil((b - a) / panel)) + 1)[:-1]
            for a, b in zip(stops, stops[1:])
        ]
    )
    edges = np.append(edges, t_end)
    x, weight = np.polynomial.legendre.leggauss(order)
    half = np.diff(edges)[:, None] / 2
    nodes = ((edges[1:] + edges[:-1])[:, None] / 2 + half * x).ravel()
    run = simulate_event_driven(mechanism, q, v, nodes, t_end, rtol)
    assert len(run.t) == len(nodes)
    work = (half * weight).ravel() * power(scene, nodes, run.columns)
    change = np.diff(kinetic_energy(scene, first.columns))[0]
    # what moves no faster than rounding moves it is at rest, and has no energy to balance
    _, v, _ = motion(scene, run.columns)
    if np.max(np.abs(v)) < REST_SPEED:
        return 0.0
    return abs(change - np.sum(work)) / (
        np.max(kinetic_energy(scene, run.columns)) + np.sum(np.abs(work))
    )
