"""Random scenes with all that the format allows at joint fidelity, and how an adapter's runs of
them converge.

A scene has one to four bodies. Each is pinned to the ground or to an earlier body, or slides on a
guide of one, or now and then is free; points are off the centres of mass in none, one or both
directions. Half of the scenes of three or four bodies also have a joint that closes a loop, if a
freedom is left. Positions are made joint by joint. Velocities are drawn and then projected onto
the constraints, in the metric of the masses; a law of a drive begins with the value and the rate
that its coordinate has then.

Friction is weak (mu <= 0.25, in a guide with a length at most a quarter of it wide), so that
nearly all have one motion, and short runs (0.2 s) of moderate speeds keep errors of the start from
growing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from random_mechanisms import Assembly, SeededDice, turn

from stiction.engines import EngineFailure, Refused, load_engine
from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import Scene, Trajectory, scene_from_dict
from stiction.scenes.laws import Table, evaluate_law

DURATION = 0.2
"""Seconds of a run: at 2 rad/s and under loads of some tens of m/s^2 the neighbouring motions of
the few bodies part by a factor of order one."""
OUTPUT_STEP = 0.02
"""Seconds between the instants that are compared; a multiple of all steps."""
STEPS = (4e-3, 1e-3, 2.5e-4, 6.25e-5, 1.5625e-5)
"""Seconds; each a quarter of the one before. The last two are for runs that the first three leave
undecided: where the samples of a step happen to straddle an event, errors of one step may be small
by chance."""
DECISIVE = 3
"""Steps that are taken in any case."""
ORDER = 0.8
"""The order that errors show at least, by a method of order 1: two steps are not yet the limit."""
CHANCE = 2.0
"""By this factor an error may be above the power law through the largest: events fall somewhere
within a step."""
ROUNDING = 1e-7
"""m, rad: errors below it may be rounding, which grows with the number of steps and with guides of
10 km in pymunk."""
TRUTH_TOLERANCE = 1e-10
"""Relative tolerance of the reference: four powers of ten below the errors that decide."""
LEAST_SINGULAR_VALUE = 0.03
"""Of the constraint rows, each scaled to unit length, where a joint closes a loop or a drive is
added: near a singular position forces are large and all errors grow."""


def joint_scene(dice: SeededDice, loops: bool = True) -> dict[str, Any]:
    """The tables of a random scene with a consistent start; with a closed loop at times, if
    `loops`."""
    weight, down = dice.one_of([0.0, 9.81, 9.81, 3.0]), dice.number(0, 2 * np.pi)
    a = Assembly(weight * np.array([np.cos(down), np.sin(down)]))
    if not weight:
        del a.raw["gravity"]
    count = dice.integer(1, 4)
    for i in range(count):
        _attach(a, dice, f"b{i}", dice.one_of(["ground", *a.raw["bodies"], *a.raw["bodies"]]))
    if loops and count > 2 and dice.chance():
        _close(a, dice)
    _project(a)
    for i in range(dice.integer(0, 2)):
        _drive(a, dice, f"d{i}")
    for i in range(dice.integer(0, 3)):
        _spring(a, dice, f"k{i}")
    for i in range(dice.integer(0, 3)):
        _load(a, dice, f"f{i}")
    a.raw["t_end"] = DURATION
    return a.raw


def _point(dice: SeededDice, reach: float) -> list[float]:
    """A point of a body: its centre of mass, off it along one axis, or (as often as all these) in
    both directions."""
    x, y = dice.number(-reach, reach), dice.number(-reach, reach)
    return dice.one_of([[0.0, 0.0], [x, 0.0], [0.0, y], [x, y], [x, y], [x, y]])


def _friction(dice: SeededDice) -> dict[str, float]:
    """Keys of a guide's friction: none, mu, or mus = mu as well; without and with length, and with
    width."""
    found: dict[str, float] = {}
    if dice.integer(0, 3):
        found["mu"] = dice.number(0.02, 0.25)
        if dice.chance():
            found["mus"] = found["mu"]
    if dice.chance():
        found["length"] = dice.number(0.3, 0.8)
        if dice.chance():
            found["width"] = round(dice.number(0, 0.25) * found["length"], 6)
    return found


def _attach(a: Assembly, dice: SeededDice, name: str, base: str) -> None:
    mass = dice.number(0.5, 3)
    inertia = round(mass * dice.number(0.02, 0.15), 6)
    angle, omega = dice.number(-3, 3), dice.number(-2, 2)
    kind = dice.integer(0, 9)
    if kind == 0:
        position, velocity = [[dice.number(-1, 1), dice.number(-1, 1)] for _ in range(2)]
        a.place(name, mass, inertia, position, angle, velocity, omega)
    elif kind < 4:
        a.pin(name, base, _point(dice, 0.4), _point(dice, 0.4), angle, omega, mass, inertia)
    else:
        speed = dice.one_of([0.0, 1.0, 1.0]) * dice.number(-1, 1)
        a.slide(
            name,
            base,
            dice.number(-3.1, 3.1),
            _point(dice, 0.4),
            angle,
            dice.number(-0.4, 0.4),
            speed,
            mass,
            inertia,
            **_friction(dice),
        )
        # the slider's point is moved off its centre of mass: the centre moves the other way, so
        # that the guide stays
        joint, body = a.raw["joints"][f"guide-{name}"], a.raw["bodies"][name]
        own = joint["slider_point"] = _point(dice, 0.4)
        body["position"] = list(np.array(body["position"]) - turn(body["angle"], own))


def _close(a: Assembly, dice: SeededDice) -> None:
    """Join two bodies, or the last one and the ground, once more where they are, if that leaves a
    freedom."""
    bodies = list(a.raw["bodies"])
    first, second = bodies[-1], dice.one_of(["ground", *bodies[:-2]])
    point = _point(dice, 0.4)
    place, _ = a.at(first, point)
    x, angle, *_ = a.state(second)
    own = list(turn(-angle, place - x))
    if dice.integer(0, 2):
        joint: dict[str, Any] = {
            "type": "revolute",
            "bodies": [first, second],
            "points": [point, own],
        }
    else:
        heading = dice.number(-3.1, 3.1)
        joint = {
            "type": "translational",
            "slider": first,
            "guide": second,
            "slider_point": point,
            "point": own,
            "direction": [np.cos(heading), np.sin(heading)],
            "angle": a.state(first)[1] - angle,
            **_friction(dice),
        }
    a.raw["joints"]["closing"] = joint
    if not _is_regular(a.raw, freedoms=1):
        del a.raw["joints"]["closing"]


def _is_regular(raw: dict[str, Any], freedoms: int) -> bool:
    """Whether all constraint rows are independent, by a margin, and leave so many freedoms at
    least."""
    J = _terms(raw).J
    if not len(J):
        return True
    if len(J) > J.shape[1] - freedoms:
        return False
    return np.linalg.svd(J / np.linalg.norm(J, axis=1)[:, None])[1].min() > LEAST_SINGULAR_VALUE


def _terms(raw: dict[str, Any]) -> Any:
    equations = EquationsOfMotion(scene_from_dict(raw))
    return equations.at(0.0, *equations.start())


def _project(a: Assembly) -> None:
    """Change velocities least, in the metric of the masses, so that they meet the constraints."""
    equations = EquationsOfMotion(scene_from_dict(a.raw))
    q, v = equations.start()
    J = equations.at(0.0, q, v).J
    if not len(J):
        return
    weighted = J / equations.mass
    for _ in range(2):  # the second removes the rounding of the first
        v = v - weighted.T @ np.linalg.solve(weighted @ J.T, J @ v)
    for body, rates in zip(a.raw["bodies"].values(), v.reshape(-1, 3)):
        body["velocity"], body["angular_velocity"] = rates[:2].tolist(), float(rates[2])


def _law(dice: SeededDice, value: float, rate: float, size: float) -> dict[str, Any]:
    """A law that begins with this value and rate and has changes of about `size`."""
    kind = dice.one_of(["linear", "sine", "cubic"])
    if kind == "linear":
        if rate:
            return {"type": "linear", "offset": value, "rate": rate}
        return {"type": "constant", "value": value}
    if kind == "sine":
        frequency, phase = dice.number(2, 9), dice.number(-1, 1)
        amplitude = rate / (frequency * np.cos(phase))
        if not rate:
            phase, amplitude = np.pi / 2, size * dice.number(-0.1, 0.1)
        return {
            "type": "sine",
            "offset": value - amplitude * np.sin(phase),
            "amplitude": amplitude,
            "frequency": frequency,
            "phase": phase,
        }
    # the slope of a natural spline at its first knot is affine in the second value
    times = [0.0, 0.11, 0.23, 0.37]
    later = [value + time * rate + size * dice.number(-0.02, 0.02) for time in times[2:]]

    def slope(second: float) -> float:
        law = Table(
            type="table", times=times, values=[value, second, *later], interpolation="cubic"
        )
        return float(evaluate_law(law, 0.0)[1])

    at_nothing, at_one = slope(0.0), slope(1.0)
    second = (rate - at_nothing) / (at_one - at_nothing)
    return {
        "type": "table",
        "times": times,
        "values": [value, second, *later],
        "interpolation": "cubic",
    }


def _two(a: Assembly, dice: SeededDice) -> list[str]:
    """A body, and another one or the ground; more often the one that it is joined to."""
    first = dice.one_of(list(a.raw["bodies"]))
    pairs = [
        joint.get("bodies") or [joint["slider"], joint["guide"]]
        for joint in a.raw["joints"].values()
    ]
    joined = [other for own, other in pairs if own == first]
    others = ["ground", *(name for name in a.raw["bodies"] if name != first)]
    return [first, dice.one_of(joined) if joined and dice.integer(0, 2) else dice.one_of(others)]


def _drive(a: Assembly, dice: SeededDice, name: str) -> None:
    """Drive an angle or a distance from the value and rate that it has, if no other constraint
    gives it."""
    first, second = bodies = _two(a, dice)
    (_, angle, _, omega), (_, base_angle, _, base_omega) = a.state(first), a.state(second)
    kind = dice.integer(0, 3)
    drive: dict[str, Any]
    if kind < 2:
        drive = {"type": "angle", "bodies": bodies}
        value, rate, size = angle - base_angle, omega - base_omega, 1.0
    else:
        points = [_point(dice, 0.3), _point(dice, 0.3)]
        drive, size = {"type": "distance", "bodies": bodies, "points": points}, 0.5
        guides = [joint for joint in a.raw["joints"].values() if joint["type"] == "translational"]
        guide = next(
            (joint for joint in guides if [joint["slider"], joint["guide"]] == bodies), None
        )
        if kind == 3:
            heading = dice.number(-3, 3)
            axis = [np.cos(heading), np.sin(heading)]
            drive["axis"] = list(guide["direction"]) if guide and dice.integer(0, 2) else axis
        (p, u), (r, w) = a.at(first, points[0]), a.at(second, points[1])
        if kind == 3:
            d = turn(base_angle, drive["axis"])
            d = d / np.hypot(*d)
            turned = base_omega * np.array([-d[1], d[0]])
            value, rate = d @ (p - r), d @ (u - w) + turned @ (p - r)
        else:
            value = float(np.hypot(*(p - r)))
            if value < 0.1:  # a distance has no direction where the points meet
                return
            rate = (p - r) @ (u - w) / value
    drive["law"] = _law(dice, float(value), float(rate) if abs(rate) > 1e-12 else 0.0, size)
    a.raw["drives"][name] = drive
    if not _is_regular(a.raw, freedoms=0):
        del a.raw["drives"][name]


def _spring(a: Assembly, dice: SeededDice, name: str) -> None:
    bodies, kind = _two(a, dice), dice.integer(0, 3)
    damping = dice.one_of([0.0, dice.number(0, 2)])
    if kind == 0:
        a.raw["springs"][name] = {
            "type": "torsional",
            "bodies": bodies,
            "stiffness": dice.number(0, 10),
            "damping": round(0.1 * damping, 6),
            "rest_angle": dice.number(-3, 3),
        }
        return
    points = [_point(dice, 0.3), _point(dice, 0.3)]
    spring = {
        "type": "linear",
        "bodies": bodies,
        "points": points,
        "stiffness": dice.number(0, 60),
        "damping": damping,
        "rest_length": dice.number(0.1, 0.6),
    }
    (p, _), (r, _) = a.at(bodies[0], points[0]), a.at(bodies[1], points[1])
    if kind == 1:
        spring["axis"] = [dice.number(-1, 1), 1.0]
    elif kind == 2 or np.hypot(*(p - r)) < 0.2:
        # where the ends meet, a spring with a length has no direction
        spring |= {"rest_length": 0.0, "damping": 0.0}
    a.raw["springs"][name] = spring


def _load(a: Assembly, dice: SeededDice, name: str) -> None:
    body, torque = dice.one_of(list(a.raw["bodies"])), dice.integer(0, 2) == 0
    size = 2.0 if torque else 15.0
    kind = dice.one_of(["constant", "linear", "sine", "linear table", "cubic table"])
    law: dict[str, Any]
    if kind == "constant":
        law = {"type": "constant", "value": dice.number(-size, size)}
    elif kind == "linear":
        law = {
            "type": "linear",
            "offset": dice.number(-size, size),
            "rate": dice.number(-5 * size, 5 * size),
        }
    elif kind == "sine":
        law = {
            "type": "sine",
            "offset": dice.number(-size, size),
            "amplitude": dice.number(-size, size),
            "frequency": dice.number(1, 20),
            "phase": dice.number(-3, 3),
        }
    else:
        law = {
            "type": "table",
            "times": [-0.02, 0.061, 0.083, 0.14],
            "values": [dice.number(-size, size) for _ in range(4)],
            "interpolation": kind.split()[0],
        }
    load: dict[str, Any] = {"type": "torque" if torque else "force", "body": body, "law": law}
    if not torque:
        load |= {"point": _point(dice, 0.3), "direction": [dice.number(-1, 1), 1.0]}
    a.raw["forces"][name] = load


@dataclass(frozen=True)
class Convergence:
    """How runs of an adapter with ever shorter steps approach the reference.

    Attributes
    ----------
    verdict : str
        ``"converged"``, ``"refused"`` (in words, before any step), ``"ended"`` (a typed failure,
        or an end before that of the run), ``"wrong"``.
    errors : tuple of float
        By step: the largest error of a coordinate at the instants that are compared (m, rad).
    forces : tuple of float
        By step: the mean error of reactions and frictions over these instants, relative to the
        largest force or moment.
    words : str
        What was said where a run was refused or ended.
    """

    verdict: str
    errors: tuple[float, ...] = ()
    forces: tuple[float, ...] = ()
    words: str = ""


def truth_of(scene: Scene) -> Trajectory | None:
    """The reference's motion; None where it ends before, as it has no motion or several."""
    try:
        found = load_engine("reference").simulate(
            scene, rtol=TRUTH_TOLERANCE, output_step=OUTPUT_STEP
        )
    except EngineFailure:
        return None
    return found if found.termination == "end" else None


def compare(
    engine: str, scene: Scene, truth: Trajectory, steps: tuple[float, ...] = STEPS, **settings: Any
) -> Convergence:
    """Run an engine with each of the steps and hold it to the truth."""
    errors: list[float] = []
    forces: list[float] = []
    for dt in steps:
        try:
            run = load_engine(engine).simulate(scene, dt=dt, output_step=OUTPUT_STEP, **settings)
        except Refused as reason:
            return Convergence("refused", words=str(reason))
        except EngineFailure as failure:
            return Convergence("ended", tuple(errors), tuple(forces), f"dt = {dt:g} s: {failure}")
        if run.termination != "end":
            return Convergence(
                "ended", tuple(errors), tuple(forces), f"dt = {dt:g} s: {run.breakdown}"
            )
        np.testing.assert_allclose(run.t, truth.t, atol=1e-12)
        errors.append(
            max(
                float(np.abs(run[f"{name}.{key}"] - truth[f"{name}.{key}"]).max())
                for name in scene.bodies
                for key in ("x", "y", "angle")
            )
        )
        forces.append(_force_error(scene, run, truth))
        if len(errors) >= DECISIVE and converges(errors):
            return Convergence("converged", tuple(errors), tuple(forces))
    return Convergence("wrong", tuple(errors), tuple(forces))


def _force_error(scene: Scene, run: Trajectory, truth: Trajectory) -> float:
    rows = [
        *EquationsOfMotion(scene).rows,
        *(f"{name}.friction" for name in scene.frictional_guides),
    ]
    # where the motion leaves a force open it is nan in either, or some share in one
    known = [row for row in rows if np.isfinite(truth[row]).all() and np.isfinite(run[row]).all()]
    if not known:
        return 0.0
    largest = max(np.abs(truth[row]).max() for row in known)
    mean = max(np.abs(run[row] - truth[row])[1:].mean() for row in known)
    return float(mean / max(largest, 1e-9))


def converges(errors: list[float]) -> bool:
    """Whether errors at steps each a quarter of the one before fall as those of a method of first
    order.

    From the largest one on, over two steps at least.
    """
    largest = int(np.argmax(errors))
    refinements = len(errors) - 1 - largest
    law = CHANCE * errors[largest] * 4.0 ** (-ORDER * refinements)
    return refinements >= 2 and errors[-1] <= law or errors[-1] <= ROUNDING


def random_joint_scene(seed: int, loops: bool = True) -> Scene:
    """The scene of a seed."""
    return scene_from_dict(joint_scene(SeededDice([2014, seed]), loops))
