"""What the columns and events of a trajectory say of each other: definitions, the balance of forces, and the order of events.

None of it says that a motion is right, only that a trajectory is one: that its parts belong to the same motion at the same instants.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from stiction.scenes import Event, Scene, Trajectory

if TYPE_CHECKING:
    from stiction.reference_impl.multibody.mechanism import Mechanism

SAME = 1e-6
"""Relative accuracy of what is defined by other columns, to the largest of its kind in the run: engines that compute in single precision
(eps = 6e-8) have it."""
SAME_TIME = 1e-9
"""Of times, relative to the end of the run."""
ENGINES_OWN = 1e-2
"""The same of what an engine measures in two ways: the forces of its contacts and of its joints, and the state on both sides of an event,
which one of fixed step has from two steps. Steps of a hundredth of a second leave a thousandth."""
BALANCE = 1e-4
"""Part of the largest force that the forces of an instant may leave unbalanced. Engines that locate events leave 1e-8, with masses unlike by 1e8 one of them 1e-5; a
column that is a sample late, or has the wrong sign, leaves a hundredth and more."""
CAP = 1e-2
"""Part of the largest friction bound of a run by which a friction may exceed its own bound where an engine has steps of fixed size: it holds the bound of the
step before, and samples some steps apart do not show every change of it."""
FIRST_STEPS = 20
"""Of fixed size, in which friction is not judged: the first has no step before whose reactions its bound could have, and up to 16 (Drake's, of mechanisms with
loops) settle, whose samples have the friction of the one behind them."""
BEFORE_AND_AFTER = {"slip": lambda old, new: old == 0 != new, "stick": lambda old, new: old != 0 == new,
                    "reversal": lambda old, new: old == -new != 0, "corner": lambda old, new: old == new != 0}
"""What an event does to the mode of its guide."""


def contradictions(found: Trajectory, scene: Scene, parts: Collection[Mechanism], locates_events: bool, keeps_cone: bool) -> Iterator[str]:
    """What of a trajectory contradicts the rest of it, in words that go on from "the engine returned"; nothing if all belongs together.

    - Velocities are the derivatives of positions, as far as the output shows them.
    - Displacements and slip velocities of guides are those of the states.
    - The sum of the corner forces, and their moment with that of the surface friction, are those on the guide.
    - Modes are -1, 0 or 1. Where events have values on both sides, positions and velocities are the same on both, an event changes the
      mode of its guide as its kind says, and between a guide's events its mode does not change; nor, where corner events are located, do the
      surfaces that the corners of a slipping guide touch.
    - A guide that sticks, slips and turns around has events where the engine locates them.
    - Friction lies in Coulomb's cone where the engine keeps it; see `_cone`.
    - Where events have values on both sides the engine knows what an instant is: there forces and accelerations balance.

    Parameters
    ----------
    found
        A trajectory with all columns, and events, as the scene calls for them.
    parts
        The mechanisms that the scene consists of.
    locates_events, keeps_cone
        What `Engine` says of the run.
    """
    size = max(part.arrays.length_scale for part in parts)
    yield from _ways(found, scene, size)
    for part in parts:
        yield from _guide_motion(found, part)
        yield from _balance(found, part)
    for name, guide in scene.guides.items():
        if guide.length is not None:
            yield from _corner_forces(found, name, guide.length, guide.width or 0.0, guide.frictional)
        if guide.frictional and f"{name}.mode" in found.columns:
            yield from _modes(found, name, guide.length is not None)
        if guide.frictional and guide.static_coefficient > 0.0 and locates_events:
            yield from _unreported(found, name)
    if keeps_cone and scene.frictional_guides:
        yield from _cone(found, scene, locates_events, size)
    yield from _continuity(found, scene, size)


def _ways(found: Trajectory, scene: Scene, size: float) -> Iterator[str]:
    """Whether velocities are the derivatives of positions: what both say of the way of each body along its velocity, their means apart.

    Between two instants a velocity is known to the change that it shows there: half of it is the error of the trapezoidal rule on a velocity that only rises or
    only falls, the other half that of an engine that moves with the velocity at the end of its step. Where the mechanism as a whole changes all of its
    velocity, nothing is known. Nor is a mean: what vibrates once between two instants has the same velocity at both and stays. Velocities of motions that
    are small against the mechanism and the longest way, as of a box that rattles in its guide, are not judged: engines correct positions by as much.
    """
    q, v, a = (np.stack([factor * found[f"{body}.{label}"].astype(float) for body in scene.bodies for label, factor in zip(labels, (1.0, 1.0, size))], axis=1)
               for labels in (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha")))
    h = np.diff(found.t.astype(float))
    seen = _changes(h, v, a) < np.linalg.norm(v[1:] + v[:-1], axis=1) / 2
    if not seen.any():
        return
    h, start, moved, mean = h[seen], found.t[:-1][seen], np.diff(q, axis=0)[seen], (v[1:] + v[:-1])[seen] / 2
    moved, mean = moved - np.outer(h, moved.sum(axis=0) / h.sum()), mean - h @ mean / h.sum()
    bodies = [(body, kind, slice(3 * i + first, 3 * i + last)) for i, body in enumerate(scene.bodies) for kind, first, last in (("vx, vy", 0, 2), ("omega", 2, 3))]
    speeds = [np.linalg.norm(mean[:, own], axis=1) for *_, own in bodies]
    longest = max(h @ speed for speed in speeds)
    for (body, kind, own), speed in zip(bodies, speeds):
        by_position = np.sum(moved[:, own] * mean[:, own], axis=1) / np.where(speed > 0, speed, 1.0)
        unknown = h * _changes(np.diff(found.t.astype(float)), v[:, own], a[:, own])[seen]
        small = ENGINES_OWN * (size + longest)
        allowed = np.sum(unknown) + small
        if h @ speed > small and abs(np.sum(by_position) - h @ speed) > allowed:
            i = int(np.argmax(np.abs(by_position - h * speed) - unknown))
            scale, unit = (size, "rad") if kind == "omega" else (1.0, "m")
            yield f"velocities of {body} ({kind}) that are not those of its positions: about their mean they move it by {h @ speed / scale:.4g} {unit}, its positions by " \
                  f"{np.sum(by_position) / scale:.4g} {unit}, and differ most from t = {start[i]:.9g} s on; expected the same within {allowed / scale:.2g} {unit}"


def _changes(h: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """By how much velocities change from one instant to the next, by themselves or by the accelerations at either, shape (n - 1,)."""
    second = np.linalg.norm(a, axis=1)
    return np.maximum(np.linalg.norm(np.diff(v, axis=0), axis=1), h * np.maximum(second[1:], second[:-1]))


def _of_bodies(values: Mapping[str, np.ndarray], part: Mechanism) -> list[np.ndarray]:
    """q, v and a of a part, each (n, 3 * bodies)."""
    from stiction.reference_impl.multibody.trajectory_columns import BODY_COLUMNS  # imported here, as in the gate

    return [np.stack([np.asarray(values[f"{body}.{label}"], dtype=float) for body in part.body_names for label in labels], axis=1)
            for labels in BODY_COLUMNS]


def _guide_motion(found: Trajectory, part: Mechanism) -> Iterator[str]:
    from stiction.reference_impl.multibody.mechanism import TRANSLATIONAL
    from stiction.reference_impl.multibody.trajectory_columns import GUIDE_COLUMNS, guide_motion

    q, v, _ = _of_bodies(found.columns, part)
    for k, name in enumerate([*part.scene.joints, *part.scene.drives]):
        if part.arrays.constraint[k]["kind"] != TRANSLATIONAL:
            continue
        sizes = (max(part.arrays.length_scale, float(np.max(np.abs(q)))), max(part.arrays.length_scale, float(np.max(np.abs(v)))))
        for label, expected, size in zip(GUIDE_COLUMNS, guide_motion(part.arrays, k, q, v), sizes):
            yield from _differs(found, f"{name}.{label}", expected, SAME * size, "that of its states")


def _corner_forces(found: Trajectory, name: str, length: float, width: float, frictional: bool) -> Iterator[str]:
    F = [found[f"{name}.F{corner}"] for corner in (1, 2, 3, 4)]
    R, T = found[f"{name}.normal_force"], found[f"{name}.moment"]
    size = max(map(_largest, (*F, R, 2 / length * T)))
    friction = found[f"{name}.friction_lower"] - found[f"{name}.friction_upper"] if frictional else 0.0
    yield from _differs(found, f"{name}.normal_force", F[0] + F[1] - F[2] - F[3], ENGINES_OWN * size, "the sum of its corner forces")
    yield from _differs(found, f"{name}.moment", length / 2 * (F[1] + F[3] - F[0] - F[2]) + width / 2 * friction,
                        ENGINES_OWN * size * length / 2,
                        "that of its corner forces and surface friction")


def _cone(found: Trajectory, scene: Scene, located: bool, size: float) -> Iterator[str]:
    """Coulomb's law, with the load of a guide the sum of its corner forces: |friction| <= mus load at rest, friction = -mode mu load in slip.

    An engine that locates events finds friction and reactions at one instant, and both hold to `SAME` of the largest force, or of m v^2/`size` where there is
    none; or to ten times its tolerance, as its states are wrong by that and a corner force near zero has either sign. Baumgarte's terms answer the drift
    with forces, between the instants at which a step looks at them too: what they accelerate is allowed. With steps of fixed size friction has the bound of a step before: there it is to lie within the coefficient times the load, and the change of that to
    the sample before or behind; with the larger coefficient, unless the guide slips faster than its speed changes there. Forces that are nan are not judged.
    """
    guides, loads = scene.frictional_guides, {}
    for name, guide in guides.items():
        parts = (f"F{corner}" for corner in (1, 2, 3, 4)) if guide.length is not None else ("normal_force",)
        loads[name] = np.sum([np.abs(found[f"{name}.{part}"]) for part in parts], axis=0)
    fastest = max(_largest(found[f"{body}.{label}"]) for body in scene.bodies for label in ("vx", "vy"))
    force = max(*map(_largest, loads.values()), max(body.mass for body in scene.bodies.values()) * fastest ** 2 / size)
    law = found.settings.get("stabilization")
    alpha, beta = (float(law.get(name) or 0.0) if isinstance(law, Mapping) and law.get("method") == "baumgarte" else 0.0 for name in ("alpha", "beta"))
    shaken = sum(body.mass for body in scene.bodies.values()) * (2 * alpha * found["drift.velocity"] + beta ** 2 * found["drift.position"])
    allowed, begins = shaken + max(SAME, 10.0 * float(found.settings.get("rtol") or 0.0)) * force, 0.0
    if not located:
        allowed += CAP * max(max(guide.mu, guide.static_coefficient) * _largest(loads[name]) for name, guide in guides.items())
        begins = FIRST_STEPS * float(found.settings.get("dt", 0.0))
    for name, guide in guides.items():
        friction, mode = found[f"{name}.friction"].astype(float), found.columns.get(f"{name}.mode", np.zeros(len(found.t)))
        slips, static = mode != 0, guide.static_coefficient
        if not located:
            speed = found[f"{name}.slip_velocity"]
            slips, static = slips & (np.abs(speed) > _nearby_change(speed)), max(guide.mu, static)
        bound = np.where(slips, guide.mu, static) * loads[name]
        if located:
            excess = np.where(slips, np.abs(friction + mode * bound), np.abs(friction) - bound)
        else:
            bound += _nearby_change(bound)
            excess = np.abs(friction) - bound
        if (wrong := np.flatnonzero((excess > allowed) & (found.t >= begins))).size:
            i = int(wrong[0])
            expected = f"{-mode[i] * bound[i]:.9g} in slip" if located and slips[i] else f"at most {bound[i]:.9g}"
            yield f"{name}.friction = {friction[i]:.9g} at t = {found.t[i]:.9g} s, outside Coulomb's cone; expected {expected}, by the load of its corners, " \
                  f"within {allowed[i]:.2g} N"


def _nearby_change(values: np.ndarray) -> np.ndarray:
    """By how much values change to the sample before or behind, whichever is more; 0 where neither is known."""
    change = np.abs(np.diff(values, prepend=np.nan, append=np.nan))
    return np.fmax(np.fmax(change[1:], change[:-1]), 0.0)


def _largest(values: np.ndarray) -> float:
    """The largest magnitude that is known."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


def _differs(found: Trajectory, column: str, expected: np.ndarray, allowed: float, what: str) -> Iterator[str]:
    if (wrong := np.flatnonzero(np.abs(found[column] - expected) > allowed)).size:
        i = int(wrong[0])
        yield f"{column} = {found[column][i]:.9g} at t = {found.t[i]:.9g} s; expected {expected[i]:.9g}, {what}"


def _balance(found: Trajectory, part: Mechanism) -> Iterator[str]:
    """Newton's and Euler's equations of a part, at samples and on both sides of events."""
    from stiction.reference_impl.multibody.kinematics import workspace
    from stiction.reference_impl.multibody.trajectory_columns import BODY_COLUMNS, imbalance

    rows = [*part.row_names, *(f"{name}.friction" for name in part.guide_names)]
    needed = {*rows, *(f"{body}.{label}" for body in part.body_names for labels in BODY_COLUMNS for label in labels)}
    own = [(event, which, side) for event in found.events for which, side in (("before", event.before), ("after", event.after)) if needed <= side.keys()]
    if not own:
        return
    joined = {name: np.concatenate([found[name].astype(float), [side[name] for *_, side in own]]) for name in needed}
    t = np.concatenate([found.t.astype(float), [event.time for event, *_ in own]])
    q, v, a = map(np.ascontiguousarray, _of_bodies(joined, part))
    force = np.ascontiguousarray(np.stack([joined[name] for name in rows], axis=1))
    left, size = imbalance(part.arrays, workspace(part.arrays), t, q, v, a, force)
    size = size[np.isfinite(size)]
    if (wrong := np.flatnonzero(left > BALANCE * np.max(size, initial=0.0))).size:
        i = int(wrong[0])
        event = own[i - len(found.t)][:2] if i >= len(found.t) else None
        where = f", {event[1]} the {event[0].kind} of {event[0].joint}" if event else ""
        yield f"forces and accelerations that do not balance at t = {t[i]:.9g} s{where}: {left[i] / np.max(size):.2g} of the largest is left over; " \
              f"expected less than {BALANCE:g}"


def _modes(found: Trajectory, name: str, has_corners: bool) -> Iterator[str]:
    """The modes of a guide over time, and those on both sides of its events."""
    column, t = found[f"{name}.mode"], found.t
    if (odd := np.flatnonzero(~np.isin(column, (-1, 0, 1)))).size:
        yield f"{name}.mode = {column[odd[0]]} at t = {t[odd[0]]:.9g} s; expected -1, 0 or 1"
    own = [event for event in found.events if event.joint == name and f"{name}.mode" in event.before]
    located = has_corners and any(event.kind == "corner" for event in found.events)
    for event in own:
        old, new = event.before[f"{name}.mode"], event.after[f"{name}.mode"]
        if not BEFORE_AND_AFTER[event.kind](old, new):
            yield f"{event.kind} of {name} at t = {event.time:.9g} s: mode {old:g} before and {new:g} after; expected those of a {event.kind}"
    if not own:
        return
    times, mode = np.array([event.time for event in own]), np.array([own[0].before[f"{name}.mode"], *(event.after[f"{name}.mode"] for event in own)])
    for first, second in zip(own, own[1:]):
        if first == second or first.after[f"{name}.mode"] != second.before[f"{name}.mode"] or located and _other_surfaces(found, name, first, second):
            yield f"{first.kind} of {name} at t = {first.time:.9g} s, then {second.kind} at {second.time:.9g} s: the contact mode behind the one is " \
                  "not that in front of the other; expected every event once"
    # a sample at the instant of an event, give or take the rounding of sums of steps, may be of either side
    earliest, latest = (np.searchsorted(times, t + sign * SAME_TIME * t[-1], which) for sign, which in ((-1, "left"), (1, "right")))
    for i in np.flatnonzero((column != mode[earliest]) & (column != mode[latest])):
        if column[i] not in mode[earliest[i]:latest[i] + 1]:
            yield f"{name}.mode = {column[i]:g} at t = {t[i]:.9g} s; expected {mode[latest[i]]:g}, that between its events"


def _unreported(found: Trajectory, name: str) -> Iterator[str]:
    """Changes of a guide between stick, slip and slip the other way that have no event; those that last for two instants on either side."""
    if (mode := found.columns.get(f"{name}.mode")) is None:
        speed = found[f"{name}.slip_velocity"]
        mode = np.where(np.abs(speed) > SAME * np.max(np.abs(speed)), np.sign(speed), 0.0)
    times = np.array([event.time for event in found.events if event.joint == name])
    for i in 1 + np.flatnonzero((mode[:-3] == mode[1:-2]) & (mode[1:-2] != mode[2:-1]) & (mode[2:-1] == mode[3:])):
        if not np.any((times >= found.t[i - 1]) & (times <= found.t[i + 2])):
            yield f"no event of {name} between t = {found.t[i]:.9g} and {found.t[i + 1]:.9g} s, where its mode goes from {mode[i]:g} to {mode[i + 1]:g}; " \
                  "expected one there, as the engine says that it locates events"


def _other_surfaces(found: Trajectory, name: str, first: Event, second: Event) -> bool:
    """Whether a corner of a slipping guide has changed its surface between two events of it."""
    if not first.after[f"{name}.mode"]:
        return False
    size = SAME * max(_largest(found[f"{name}.F{corner}"]) for corner in (1, 2, 3, 4))
    return any(first.after[f"{name}.F{one}"] > size < second.before[f"{name}.F{other}"] for one, other in ((1, 4), (4, 1), (2, 3), (3, 2)))


def _continuity(found: Trajectory, scene: Scene, length: float) -> Iterator[str]:
    """Positions and velocities do not jump at an event, beyond the rounding of a mechanism of this length."""
    for labels in (("x", "y", "angle"), ("vx", "vy", "omega")):
        names = [f"{body}.{label}" for body in scene.bodies for label in labels]
        size = max(float(np.max(np.abs(found[name]))) for name in names)
        for event in found.events:
            for name in names:
                if name in event.before and abs(event.after[name] - event.before[name]) > ENGINES_OWN * size + SAME * length:
                    yield f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {name} = {event.before[name]:.9g} before and " \
                          f"{event.after[name]:.9g} after; expected no jump of a state"
