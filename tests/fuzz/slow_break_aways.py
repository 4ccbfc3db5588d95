"""Random mechanisms at rest whose joints, with equal bounds at rest and in slip, break away together under a ramp.

All bounds are constant, so that the second method needs no contact problem. A mechanism of one freedom has one unit
motion u, with J u = 0, and rates W u of its joints. Its loads have the power P(t) = Q(t) u. By the principle of virtual
power it rests while |P| <= sum of bound_i |W_i u|, and moves in the direction of P from then on, with known frictions,
until the rate of a joint changes its sign. That motion is integrated by SciPy, with the equations of `dense_equations`.

The motion begins without an acceleration: as a load grows in proportion to time, displacements are a t^3/6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import null_space
from scipy.optimize import brentq

from fuzz.dense_mechanics import Dice
from stiction.scenes import Scene, Trajectory, scene_from_dict
from stiction.truths.dense_equations import DenseEquations
from stiction.truths.enumerated_motion import Contact, Mode

DURATION = 0.3
"""Seconds of the motion after the break-away."""
TOLERANCE = 1e-12
"""Of a step of SciPy's method, relative and absolute."""
MARGINS = 1e-11
"""Least tolerance of the margin at a break-away, relative to the largest force: rounding of a contact problem."""
RESERVE = 1e3
"""How much larger than the tolerance of a step the error of a motion may be: a hundred steps, amplified by ten."""


@dataclass(frozen=True)
class BreakAway:
    """What the second method knows of a scene.

    Attributes
    ----------
    time : float
        Time of the break-away, s.
    end : float
        End of the motion that is compared, s: before a rate of a joint changes its sign.
    growth : float
        Growth of the power of the loads, relative to the capacity, 1/s. An error e of a force shifts the event by
        e / growth.
    directions : dict of str to int
        Direction of slip of each joint.
    q, v, a : ndarray
        Coordinates, velocities and accelerations at the end.
    """

    time: float
    end: float
    growth: float
    directions: dict[str, int]
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def slider_crank(dice: Dice, raw: dict) -> None:
    """A slider-crank with an offset, in any direction."""
    r, angle = dice.number(0.1, 0.5), dice.number(0.3, 1.3) * dice.one_of([-1, 1])
    length = dice.number(1.5, 4) * r
    phi = np.arcsin(-r * np.sin(angle) / length)
    knee = r * np.array([np.cos(angle), np.sin(angle)])
    foot = knee + length * np.array([np.cos(phi), np.sin(phi)])
    raw["bodies"] |= {
        "crank": dice.body(knee / 2, angle),
        "rod": dice.body((knee + foot) / 2, phi),
        "slider": dice.body(foot, 0.0),
    }
    raw["joints"] |= {
        "pivot": _pin("crank", "ground", [-r / 2, 0.0], [0.0, 0.0]),
        "knee": _pin("rod", "crank", [-length / 2, 0.0], [r / 2, 0.0]),
        "foot": _pin("rod", "slider", [length / 2, 0.0], [0.0, 0.0]),
        "guide": {"type": "translational", "slider": "slider"},
    }


def four_bar(dice: Dice, raw: dict) -> None:
    """A crank-rocker, or a double rocker, in an open position."""
    crank = dice.number(0.1, 0.4) * np.exp(1j * dice.number(0.5, 1.5))
    rocker = dice.number(0.2, 0.5) * np.exp(1j * dice.number(1.2, 2.2))
    base = complex(dice.number(0.5, 0.9))
    coupler = base + rocker - crank
    places = {
        "crank": (0j, crank),
        "coupler": (crank, coupler),
        "rocker": (base, rocker),
    }
    for name, (start, along) in places.items():
        centre = start + along / 2
        raw["bodies"][name] = dice.body(
            np.array([centre.real, centre.imag]), float(np.angle(along))
        )
    half = {name: abs(along) / 2 for name, (_, along) in places.items()}
    raw["joints"] |= {
        "A": _pin("crank", "ground", [-half["crank"], 0.0], [0.0, 0.0]),
        "B": _pin("coupler", "crank", [-half["coupler"], 0.0], [half["crank"], 0.0]),
        "C": _pin("coupler", "rocker", [half["coupler"], 0.0], [half["rocker"], 0.0]),
        "D": _pin("rocker", "ground", [-half["rocker"], 0.0], [base.real, 0.0]),
    }


def rods_between_sliders(dice: Dice, raw: dict) -> None:
    """Sliders on one line, each joined to the next by a rod."""
    slope = dice.number(-3, 3)
    along = np.array([np.cos(slope), np.sin(slope)])
    for k in range(dice.one_of([2, 3])):
        raw["bodies"][f"s{k}"] = dice.body(0.5 * k * along, slope)
        raw["joints"][f"guide-{k}"] = {
            "type": "translational",
            "slider": f"s{k}",
            "direction": along.tolist(),
            "angle": slope,
        }
        if k:
            raw["bodies"][f"rod{k}"] = dice.body((0.5 * k - 0.25) * along, slope)
            raw["joints"][f"left-{k}"] = _pin(f"rod{k}", f"s{k - 1}", [-0.25, 0.0], [0.0, 0.0])
            raw["joints"][f"right-{k}"] = _pin(f"rod{k}", f"s{k}", [0.25, 0.0], [0.0, 0.0])


def _pin(first: str, second: str, own: list[float], other: list[float]) -> dict:
    return {"type": "revolute", "bodies": [first, second], "points": [own, other]}


def draw(seed: int, index: int) -> Scene:
    """Return the scene of a seed and an index."""
    dice = Dice(48, seed, index)
    raw: dict = {"bodies": {}, "joints": {}, "forces": {}, "t_end": 100.0}
    dice.one_of([slider_crank, four_bar, rods_between_sliders])(dice, raw)
    if dice.chance():
        raw["gravity"] = [0.0, -dice.number(0.1, 1.0)]
    # two joints or more have friction, each its bound; pins on a line that does not bend never turn
    joints = [name for name in raw["joints"] if not name.startswith(("left", "right"))]
    rubbing = [name for name in joints if dice.chance(0.7)]
    for name in rubbing if len(rubbing) > 1 else joints:
        raw["joints"][name]["friction"] = dice.number(0.5, 5)
    law = {"type": "linear", "rate": dice.one_of([-1, 1]) * dice.number(0.5, 10)}
    body = dice.one_of(["crank", "rocker", "slider", "s0", "s1"])
    body = body if body in raw["bodies"] else next(iter(raw["bodies"]))
    push = {"type": "force", "body": body, "direction": dice.unit(), "law": law}
    turn = {"type": "torque", "body": body, "law": law}
    turns = raw["joints"].keys() & {"pivot", "A"} and body != "slider"
    raw["forces"]["ramp"] = turn if turns else push
    return scene_from_dict(raw, f"slow break-away {index} of seed {seed}")


def second_method(scene: Scene) -> BreakAway | None:
    """Return the break-away of a scene and its motion afterwards; None if it does not rest at first, or never moves."""
    contact = Contact(scene)
    equations: DenseEquations = contact.equations
    q, v = equations.start()
    terms = equations.at(0.0, q, v)
    unit = null_space(terms.J, rcond=1e-9)[:, 0]
    rates = terms.W @ unit
    capacity = float(np.sum(contact.static_bound * np.abs(rates)))

    # the power of the loads, of the unit motion, grows in proportion to time
    start = float(terms.Q @ unit)
    growth = float(equations.at(1.0, q, v).Q @ unit) - start
    if abs(start) >= capacity or abs(growth) < 1e-3:
        return None
    direction = np.sign(growth)
    time = (direction * capacity - start) / growth

    # the motion from then on; a joint that does not turn has no friction that counts
    slip = (direction * np.sign(np.where(np.abs(rates) > 1e-9, rates, 0.0))).astype(int)
    corner = np.ones((len(slip), 2), dtype=int)
    moves = slip != 0
    # a joint that never turns slips by name only, without friction
    bound = contact.bound * moves
    mode = Mode(np.where(moves, slip, 1), corner)

    def derivative(t: float, state: np.ndarray) -> np.ndarray:
        q, v = np.split(state, 2)
        coefficients = (contact.mu, bound, contact.radius)
        forces = contact.forces(equations.at(t, q, v), mode, coefficients)
        return np.concatenate([v, forces.acceleration])

    def least_speed(t: float, state: np.ndarray) -> float:
        q, v = np.split(state, 2)
        return float(np.min((slip * equations.at(t, q, v).slip_speed)[moves]))

    solution = solve_ivp(
        derivative,
        (time, time + DURATION),
        np.concatenate([q, v]),
        method="DOP853",
        rtol=TOLERANCE,
        atol=TOLERANCE,
        dense_output=True,
        max_step=DURATION / 20,
    )
    # compared until shortly before a joint turns back
    instants = np.linspace(time + 0.01 * DURATION, time + DURATION, 200)
    speeds = [least_speed(t, solution.sol(t)) for t in instants]
    back = np.flatnonzero(np.array(speeds) <= 0.0)
    end = time + DURATION
    if len(back):
        if back[0] == 0:
            return None
        low, high = instants[back[0] - 1], instants[back[0]]
        end = time + 0.9 * (brentq(lambda t: least_speed(t, solution.sol(t)), low, high) - time)
    q, v = np.split(solution.sol(end), 2)
    _, a = np.split(derivative(end, solution.sol(end)), 2)
    names = dict(zip(contact.names, slip.tolist()))
    relative = abs(growth) / max(1.0, capacity)
    return BreakAway(time, end, relative, {name: d for name, d in names.items() if d}, q, v, a)


def differences(scene: Scene, expected: BreakAway, run: Trajectory, rtol: float) -> list[str]:
    """Return in words what differs between a run up to `expected.end` and the second method."""
    if run.breakdown is not None:
        return [f"ended: {run.breakdown}"]
    tolerance = RESERVE * max(rtol, TOLERANCE)
    found = []
    window = RESERVE * max(rtol, MARGINS) / expected.growth
    slips = {event.joint: event for event in run.events}
    if len(slips) != len(run.events) or {event.kind for event in run.events} != {"slip"}:
        found.append(f"events {[(e.kind, e.joint, e.time) for e in run.events]}")
    # a joint that never turns has no event
    if slips.keys() != expected.directions.keys():
        found.append(f"{sorted(slips)} slip, expected {sorted(expected.directions)}")
    for name, event in slips.items():
        if abs(event.time - expected.time) > window:
            found.append(f"{name} slips {event.time - expected.time:.2g} s late")
        if run[f"{name}.mode"][-1] != expected.directions.get(name):
            found.append(f"{name} slips in the other direction")
    # a break-away shifted within its window shifts the motion after it
    size = max(1.0, float(np.max(np.abs(expected.q))), float(np.max(np.abs(expected.v))))
    rate = float(max(np.max(np.abs(expected.v)), np.max(np.abs(expected.a))))
    allowed = tolerance * size + window * rate
    for body, q, v in zip(scene.bodies, expected.q.reshape(-1, 3), expected.v.reshape(-1, 3)):
        for label, value in zip(("x", "y", "angle", "vx", "vy", "omega"), (*q, *v)):
            error = abs(run[f"{body}.{label}"][-1] - value)
            if not error <= allowed:
                found.append(f"{body}.{label} at the end differs by {error:.2g}")
    return found
