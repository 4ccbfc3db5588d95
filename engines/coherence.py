"""Coherence of a trajectory: its states fit the mechanism, and its columns and events fit each other.

None of it says that a motion is right, only that the parts of a trajectory belong to one motion at the same instants.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from stiction.engines.examined import ACCELERATIONS, MODES, POSITIONS, ROUNDING, VELOCITIES, Examined, Predicate, first
from stiction.reference_impl.multibody.initial_state import CONSISTENT
from stiction.reference_impl.multibody.kinematics import workspace
from stiction.reference_impl.multibody.mechanism import TRANSLATIONAL
from stiction.reference_impl.multibody.reactions import recover_columns
from stiction.reference_impl.multibody.trajectory_columns import GUIDE_COLUMNS, guide_motion, imbalance, residual_norms
from stiction.scenes import Event
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.trajectory import stacked

START = 1e-6
"""Distance of the first state from the scene's start at most, relative to the mechanism's size (velocities: to size per
second or the largest speed at the start). Scene files meet their constraints to 1e-9 (`CONSISTENT`); engines that
compute in single precision (eps = 6e-8) round what they are given."""
DRIFT = 1e-6
"""Relative accuracy to which an engine must know the residuals of its own states, and, times the mechanism's size,
absolute."""
SAME = 1e-6
"""Relative accuracy of a column that others define, to the largest of its kind: engines of single precision have it."""
ENGINES_OWN = 1e-2
"""Relative accuracy of what an engine measures in two ways: the forces of its contacts and of its joints, and the state
on both sides of an event, which one of fixed step has from two steps. Steps of a hundredth of a second leave a
thousandth."""
BALANCE = 1e-4
"""Part of the largest force that the forces of an instant may leave unbalanced. Engines that locate events leave 1e-8,
one with masses unlike by 1e8 leaves 1e-5; a column that is a sample late, or has the wrong sign, leaves a hundredth and
more."""
CAP = 1e-2
"""Part of the largest friction bound of a run by which a friction may exceed its own bound at fixed step size: the
engine holds the bound of the step before, and samples some steps from each other do not show every change of it."""
STEPS_BALANCE = 1e-2
"""Part of the largest force that the forces of a sample may leave unbalanced at fixed step size, beyond what the
accelerations change to the sample before or behind."""
LASTING = 5
"""Samples in a row whose forces must be unbalanced for a fault at fixed step size. Friction and acceleration are those
of neighbouring steps, which disagree where a force jumps: the engines of the suite, with steps of 1 and 10 ms on all
scenes of the catalogue, have 2 such samples in a row at most."""
DRIVEN = 1e-2
"""Work that friction may do on a guide without a break, as a part of its largest size times that of the mechanism. At a
reversal the friction of a step meets the velocity of another: the joints of the suite's engines do up to 0.0012 so."""
NEEDED = 5e-2
"""Part of the largest friction of a guide by which, with a fixed step, a friction may differ from that which the motion
needs, beyond what either changes to the sample before or behind, at `LASTING` samples in a row."""
MOST = 0.5
"""Part of a whole that contradicts the rest, from which on no error of a step explains it: of the work of a friction
that may leave Coulomb's cone (contacts: 0.14 at most, MuJoCo's at 10 ms), of a change of velocity that is not that by
the accelerations (joints: 0.06 at most)."""
FIRST_STEPS = 20
"""Steps of fixed size in which friction is not judged. The first has no step before whose reactions its bound could
have, and up to 16 (Drake's, of mechanisms with loops) settle, whose samples have the friction of the one behind
them."""


def start(run: Examined) -> Iterator[str]:
    """The first state is the scene's start where that meets the constraints; else the engine may assemble."""
    if not len(run.found.t):
        return
    (q, v, _), (start_q, start_v) = run.motion, run.start
    [position], [velocity] = _residuals(run, np.zeros(1), start_q[None], start_v[None])
    speed = _speed(run, start_v)
    if position > CONSISTENT * run.size or velocity > CONSISTENT * speed:
        return
    for values, expected, labels, size in ((q[0], start_q, POSITIONS, run.size), (v[0], start_v, VELOCITIES, speed)):
        if (i := first(~(np.abs(values - expected) <= START * size))) is not None:
            yield (f"a start that is not the scene's: {run.columns(labels)[i]} = {values[i]:.9g}; expected "
                   f"{expected[i]:.9g} within {START * size:.1g}")


def residuals(run: Examined) -> Iterator[str]:
    """States on the constraints at the start, near them later, with the residuals that the drift columns report."""
    if not len(t := run.found.t):
        return
    q, v, _ = run.motion
    found = _residuals(run, t.astype(float), q, v)
    if (i := first(~(found[0] <= run.size))) is not None and run.scene.joints | run.scene.drives:
        yield (f"states that have left the mechanism: {found[0][i]:.3g} m off the constraints at t = {t[i]:.9g} s; "
               f"expected less than its size, {run.size:.3g} m")
    sizes = (run.size, _speed(run, run.start[1]))
    for name, residual, size, unit in zip(("drift.position", "drift.velocity"), found, sizes, ("m", "m/s")):
        if not residual[0] <= START * size:
            yield f"a start that is {residual[0]:.3g} {unit} off the constraints; expected at most {START * size:.1g}"
        if (i := first(~_agrees(run.found[name], residual, size))) is not None:
            yield (f"{name} = {run.found[name][i]:.6g} at t = {t[i]:.9g} s; expected {residual[i]:.6g}, the residual "
                   "of its states")


def residuals_at_events(run: Examined) -> Iterator[str]:
    """Residuals on both sides of events are those of the states there.

    A drive's constraint has time in it, so that values of a neighbouring sample are noticed.
    """
    position, velocity = run.columns(POSITIONS), run.columns(VELOCITIES)
    if not (sides := run.sides({*position, *velocity, "drift.position", "drift.velocity"})):
        return
    t = np.array([time for _, time, _ in sides], dtype=float)
    q, v = (np.array([[side[name] for name in labels] for *_, side in sides], dtype=float)
            for labels in (position, velocity))
    sizes = (run.size, _speed(run, v))
    for name, residual, size in zip(("drift.position", "drift.velocity"), _residuals(run, t, q, v), sizes):
        reported = np.array([side[name] for *_, side in sides], dtype=float)
        if (i := first(~_agrees(reported, residual, size))) is not None:
            yield (f"{sides[i][0]}, {name} = {reported[i]:.6g}; expected {residual[i]:.6g}, the residual of its states "
                   "then")


def velocities(run: Examined) -> Iterator[str]:
    """Velocities are the derivatives of positions.

    Both move each body along its velocity by the same, with their means removed. Between two instants a velocity is
    known to the change that it shows there: half of it for the trapezoidal rule, half for engines that move with the
    velocity at the end of a step. Where all of it changes, nothing is known, nor is a mean: what vibrates once between
    two instants stays. Motions that are small against the mechanism and the longest way are not judged: engines correct
    positions by as much.
    """
    found, size = run.found, run.size
    q, v, a = (values * np.tile([1.0, 1.0, size], len(run.scene.bodies)) for values in run.motion)
    steps = np.diff(found.t.astype(float))
    seen = _changes(steps, v, a) < np.linalg.norm(v[1:] + v[:-1], axis=1) / 2
    if not seen.any():
        return
    h, begin, moved, mean = steps[seen], found.t[:-1][seen], np.diff(q, axis=0)[seen], (v[1:] + v[:-1])[seen] / 2
    moved, mean = moved - np.outer(h, moved.sum(axis=0) / h.sum()), mean - h @ mean / h.sum()
    bodies = [(body, kind, slice(3 * i + low, 3 * i + high)) for i, body in enumerate(run.scene.bodies)
              for kind, low, high in (("vx, vy", 0, 2), ("omega", 2, 3))]
    speeds = [np.linalg.norm(mean[:, own], axis=1) for *_, own in bodies]
    small = ENGINES_OWN * (size + max(h @ speed for speed in speeds))
    for (body, kind, own), speed in zip(bodies, speeds):
        by_position = np.sum(moved[:, own] * mean[:, own], axis=1) / np.where(speed > 0, speed, 1.0)
        unknown = h * _changes(steps, v[:, own], a[:, own])[seen]
        allowed = np.sum(unknown) + small
        if h @ speed > small and abs(np.sum(by_position) - h @ speed) > allowed:
            i = int(np.argmax(np.abs(by_position - h * speed) - unknown))
            scale, unit = (size, "rad") if kind == "omega" else (1.0, "m")
            yield (f"velocities of {body} ({kind}) that are not those of its positions: about their mean they move it "
                   f"by {h @ speed / scale:.4g} {unit}, its positions by {np.sum(by_position) / scale:.4g} {unit}, and "
                   f"differ most from t = {begin[i]:.9g} s on; expected the same within {allowed / scale:.2g} {unit}")


def displacements(run: Examined) -> Iterator[str]:
    """Displacements and slip velocities of guides are those of the states."""
    for part in run.parts:
        q, v = (stacked(run.found.columns, part.body_names, labels) for labels in (POSITIONS, VELOCITIES))
        sizes = [max(part.arrays.length_scale, float(np.max(np.abs(values)))) for values in (q, v)]
        for k, name in enumerate([*part.scene.joints, *part.scene.drives]):
            if part.arrays.constraint[k]["kind"] != TRANSLATIONAL:
                continue
            for label, expected, size in zip(GUIDE_COLUMNS, guide_motion(part.arrays, k, q, v), sizes):
                yield from run.differs(f"{name}.{label}", expected, SAME * size, "that of its states")


def accelerations(run: Examined) -> Iterator[str]:
    """Accelerations are the derivatives of velocities, of joints: contacts bounce between samples.

    The change of a velocity and that by the accelerations, by the trapezoidal rule, both with their means removed, may
    differ by what the acceleration changes to the next sample on either side. What is left may make up `MOST` of all
    changes. Nothing is known of means: a motion that repeats itself from sample to sample has one acceleration at all
    of them, and one velocity. Nor is anything known where velocities change by much of their size
    from sample to sample.
    """
    if run.fidelity != "joint":
        return
    t = run.found.t.astype(float)
    step, settled = np.diff(t), t[:-1] >= _settled(run)
    _, v, a = (values * np.tile([1.0, 1.0, run.size], len(run.scene.bodies)) for values in run.motion)
    small = ENGINES_OWN * float(np.max(np.abs(v))) + SAME * run.size  # of a mechanism at rest: rounding
    for name, speed, rate in zip(run.columns(ACCELERATIONS), v.T, a.T):
        if not max(np.max(step) * _largest(rate), _largest(np.diff(speed))) <= MOST * _largest(speed):
            continue
        change = _nearby_change(rate)
        both = np.diff(speed), step * (rate[1:] + rate[:-1]) / 2
        whole = max(np.nansum(np.abs(changes[settled])) for changes in both)
        own, by_rate = (moved - step * moved.sum() / step.sum() for moved in both)
        left = np.abs(own - by_rate) - step * np.maximum(change[1:], change[:-1])
        contradicted = np.sum(np.maximum(left, 0.0), where=settled & np.isfinite(left))
        if contradicted > MOST * whole + small:
            i = int(np.nanargmax(np.where(settled, left, -np.inf)))
            yield (f"{name} that is not the rate of its velocity: from t = {t[i]:.9g} to {t[i + 1]:.9g} s about their "
                   f"means the one changes by {own[i]:.4g}, by the other it would by {by_rate[i]:.4g}")


def dissipation(run: Examined) -> Iterator[str]:
    """Friction takes energy from a guide that slips: friction times slip velocity is at most 0.

    What it gives without a break may be `DRIVEN`, the lag of a step at a reversal or the creep of a guide at rest.
    Friction of contacts and of regularized laws, which may leave Coulomb's cone, also does `MOST` of its work against
    the slip. Forces that are nan are not judged, nor what Baumgarte's terms accelerate.
    """
    found, t = run.found, run.found.t.astype(float)
    settled = t >= _settled(run)
    for name, guide in run.scene.frictional_guides.items():
        friction, speed = found[f"{name}.friction"].astype(float), found[f"{name}.slip_velocity"].astype(float)
        load = max(guide.static_coefficient, SAME) * _largest(found[f"{name}.normal_force"])  # rounding, without mu
        allowed = DRIVEN * run.size * max(_largest(friction), load)
        power = np.where(settled & np.isfinite(friction), np.nan_to_num(friction) * speed, 0.0)
        given = np.maximum(power - _baumgarte_force(run) * np.abs(speed), 0.0)
        if not run.keeps(found.settings) and np.trapezoid(given, t) <= MOST * np.trapezoid(np.abs(power), t):
            continue
        for begin, behind in _stretches(given > 0.0):
            near = slice(max(0, begin - 1), behind + 1)
            if (work := np.trapezoid(given[near], t[near])) > allowed:
                i = begin + int(np.argmax(given[begin:behind]))
                yield (f"{name}.friction = {friction[i]:.9g} at t = {t[i]:.9g} s, where {name}.slip_velocity = "
                       f"{speed[i]:.9g}: from {t[begin]:.9g} to {t[behind - 1]:.9g} s friction drives the slider, and "
                       f"gives it {work:.3g} J; expected the force on the slider, against its slip (the other sign?)")
                break


def balance(run: Examined) -> Iterator[str]:
    """Newton's and Euler's equations hold at samples and on both sides of events, where an engine reports these.

    Of joints of an engine that does not they hold to `STEPS_BALANCE`, but at a few samples in a row, see `LASTING`.
    Instants with forces that are nan are not judged.
    """
    found = run.found
    for part in run.parts:
        rows = [*part.row_names, *(f"{name}.friction" for name in part.guide_names)]
        needed = {*rows, *(f"{body}.{label}" for body in part.body_names for labels in BODY_COLUMNS
                           for label in labels)}
        if not (sides := run.sides(needed)) and run.fidelity != "joint":
            continue
        joined = {name: np.concatenate([found[name].astype(float), [side[name] for *_, side in sides]])
                  for name in needed}
        t = np.concatenate([found.t.astype(float), [time for _, time, _ in sides]])
        q, v, a = (np.ascontiguousarray(stacked(joined, part.body_names, labels)) for labels in BODY_COLUMNS)
        force = np.empty((len(t), len(rows)))  # a free body has no rows
        for column, name in enumerate(rows):
            force[:, column] = joined[name]
        left, size = imbalance(part.arrays, workspace(part.arrays), t, q, v, a, force)
        largest = np.max(size[np.isfinite(size)], initial=0.0)
        part_of_it = BALANCE if sides else STEPS_BALANCE
        wrong = left > part_of_it * largest
        if not sides:
            rates = a / np.sqrt(part.arrays.inverse_mass)  # in the units of `imbalance`
            change = np.max([_nearby_change(rate) for rate in rates.T], axis=0)
            wrong = (left > part_of_it * largest + change) & (t >= _settled(run))
            for begin, behind in _stretches(wrong):
                wrong[begin:behind] = behind - begin >= min(LASTING, len(t) - 1)
        if (i := first(wrong)) is not None:
            where = f" ({sides[i - len(found.t)][0]})" if i >= len(found.t) else ""
            yield (f"forces and accelerations that do not balance at t = {t[i]:.9g} s{where}: {left[i] / largest:.2g} "
                   f"of the largest is left over; expected less than {part_of_it:g}")


def needed_friction(run: Examined) -> Iterator[str]:
    """Friction is the force along the guide that the motion needs, where that alone determines it (`recover_columns`).

    In the balance of all forces a heavy body hides the friction of a light one. Contacts share their impulses out over
    a step and are not judged. Where events have values on both sides `balance` is strict enough.
    """
    if run.fidelity != "joint":
        return
    found, t = run.found, run.found.t.astype(float)
    for part in run.parts:
        guides = [name for name in part.guide_names if name in run.scene.frictional_guides]
        if not guides or run.sides(set(run.columns(POSITIONS))):
            continue
        q, v, a = (stacked(found.columns, part.body_names, labels) for labels in BODY_COLUMNS)
        needed = recover_columns(part.scene, t, q, v, a)
        for column in (f"{name}.friction" for name in guides):
            given, expected = found[column].astype(float), needed[column]
            rounding = SAME * _largest(found[column.replace(".friction", ".normal_force")])
            allowed = (NEEDED * max(_largest(given), _largest(expected)) + rounding
                       + _nearby_change(given) + _nearby_change(expected))
            wrong = (np.abs(given - expected) > allowed) & (t >= _settled(run))
            for begin, behind in _stretches(wrong):
                if behind - begin >= min(LASTING, len(t) - 1):
                    yield (f"{column} = {given[begin]:.9g} at t = {t[begin]:.9g} s; expected {expected[begin]:.9g} "
                           f"within {allowed[begin]:.2g} N, the force along the guide that accelerations and other "
                           "forces need")
                    break


def corner_forces(run: Examined) -> Iterator[str]:
    """Corner forces and surface friction have the resultant and the moment of the guide, S F+ + K F- (paper, (21))."""
    found = run.found
    for name, guide in run.scene.guides.items():
        if guide.length is None:
            continue
        length, width = guide.length, guide.width or 0.0
        F = [found[f"{name}.F{corner}"] for corner in (1, 2, 3, 4)]
        R, T = found[f"{name}.normal_force"], found[f"{name}.moment"]
        size = max(map(_largest, (*F, R, 2 / length * T)))
        friction = found[f"{name}.friction_lower"] - found[f"{name}.friction_upper"] if guide.frictional else 0.0
        yield from run.differs(f"{name}.normal_force", F[0] + F[1] - F[2] - F[3], ENGINES_OWN * size,
                               "the sum of its corner forces")
        yield from run.differs(f"{name}.moment", length / 2 * (F[1] + F[3] - F[0] - F[2]) + width / 2 * friction,
                               ENGINES_OWN * size * length / 2, "that of its corner forces and surface friction")


def modes(run: Examined) -> Iterator[str]:
    """Modes are -1, 0 or 1, change at events as their kinds say, and do not change between a guide's events.

    Nor, where corner events are located, do the surfaces that the corners of a slipping guide touch.
    """
    found = run.found
    for name, guide in run.scene.frictional_guides.items():
        mode = f"{name}.mode"
        if mode not in found.columns:
            continue
        column, t = found[mode], found.t
        if (i := first(~np.isin(column, (-1, 0, 1)))) is not None:
            yield f"{mode} = {column[i]} at t = {t[i]:.9g} s; expected -1, 0 or 1"
        own = [event for event in found.events if event.joint == name and mode in event.before]
        if own:
            corners = guide.length is not None and any(event.kind == "corner" for event in found.events)
            yield from _chain(run, own, name, corners)
            yield from _modes_between(run, own, mode)


def _chain(run: Examined, own: Sequence[Event], name: str, corners: bool) -> Iterator[str]:
    """Each event of a guide changes its mode by its kind, and begins in the mode in which the one before ended."""
    mode = f"{name}.mode"
    for event in own:
        old, new = event.before[mode], event.after[mode]
        if not MODES[event.kind](old, new):
            yield (f"{event.kind} of {name} at t = {event.time:.9g} s: mode {old:g} before and {new:g} after; expected "
                   f"those of a {event.kind}")
    for one, two in zip(own, own[1:]):
        if one == two or one.after[mode] != two.before[mode] or corners and _other_surfaces(run, name, one, two):
            yield (f"{one.kind} of {name} at t = {one.time:.9g} s, then {two.kind} at {two.time:.9g} s: the contact "
                   "mode behind the one is not that in front of the other; expected every event once")


def _modes_between(run: Examined, own: Sequence[Event], column: str) -> Iterator[str]:
    """Between two events of a guide the samples have its mode; one at the instant of an event may be of either side."""
    t, values = run.found.t, run.found[column]
    times = np.array([event.time for event in own])
    mode = np.array([own[0].before[column], *(event.after[column] for event in own)])
    earliest = np.searchsorted(times, t - ROUNDING * t[-1], "left")
    latest = np.searchsorted(times, t + ROUNDING * t[-1], "right")
    for i in np.flatnonzero((values != mode[earliest]) & (values != mode[latest])):
        if values[i] not in mode[earliest[i]:latest[i] + 1]:
            yield f"{column} = {values[i]:g} at t = {t[i]:.9g} s; expected {mode[latest[i]]:g}, that between its events"


def _other_surfaces(run: Examined, name: str, one: Event, two: Event) -> bool:
    """Return True where a corner of a slipping guide has changed its surface between two events."""
    if not one.after[f"{name}.mode"]:
        return False
    F = [f"{name}.F{corner}" for corner in (1, 2, 3, 4)]
    size = SAME * max(_largest(run.found[corner]) for corner in F)
    opposite = ((0, 3), (3, 0), (1, 2), (2, 1))
    return any(one.after[F[i]] > size < two.before[F[j]] for i, j in opposite)


def unreported_events(run: Examined) -> Iterator[str]:
    """Each change of a guide's mode that lasts two instants on either side has an event, where events are located."""
    found = run.found
    if not run.locates(found.settings):
        return
    for name, guide in run.scene.frictional_guides.items():
        if guide.static_coefficient <= 0.0:
            continue
        if (mode := found.columns.get(f"{name}.mode")) is None:
            speed = found[f"{name}.slip_velocity"]
            mode = np.where(np.abs(speed) > SAME * np.max(np.abs(speed)), np.sign(speed), 0.0)
        times = np.array([event.time for event in found.events if event.joint == name])
        changed = (mode[:-3] == mode[1:-2]) & (mode[1:-2] != mode[2:-1]) & (mode[2:-1] == mode[3:])
        for i in 1 + np.flatnonzero(changed):
            if not np.any((times >= found.t[i - 1]) & (times <= found.t[i + 2])):
                yield (f"no event of {name} between t = {found.t[i]:.9g} and {found.t[i + 1]:.9g} s, where its mode "
                       f"goes from {mode[i]:g} to {mode[i + 1]:g}; expected one there, as the engine says that it "
                       "locates events")


def cone(run: Examined) -> Iterator[str]:
    """Coulomb's law with the load of the corner forces.

    |friction| <= mus load at rest, friction = -mode mu load in slip.

    Where events are located, both hold to `SAME` of the largest force, or of m v^2/size where there is none, or to ten
    times the tolerance, by which states are wrong; what Baumgarte's terms accelerate is allowed. At fixed step size
    friction has the bound of a step before: it must lie within the coefficient times the load, and the change of that
    to the sample before or behind; with the larger coefficient, unless the guide slips faster than its speed changes
    there. Forces that are nan are not judged.
    """
    found, guides = run.found, run.scene.frictional_guides
    if not guides or not run.keeps(found.settings):
        return
    loads = {name: np.sum([np.abs(found[f"{name}.{force}"]) for force in
                           (("F1", "F2", "F3", "F4") if guide.length is not None else ("normal_force",))], axis=0)
             for name, guide in guides.items()}
    located, settings = bool(run.locates(found.settings)), found.settings
    fastest = max(_largest(found[f"{body}.{label}"]) for body in run.scene.bodies for label in ("vx", "vy"))
    force = max(*map(_largest, loads.values()),
                max(body.mass for body in run.scene.bodies.values()) * fastest ** 2 / run.size)
    allowed = _baumgarte_force(run) + max(SAME, 10.0 * float(settings.get("rtol") or 0.0)) * force
    begins = 0.0 if located else _settled(run)
    if not located:
        allowed += CAP * max(guide.static_coefficient * _largest(loads[name]) for name, guide in guides.items())
    for name, guide in guides.items():
        friction, speed = found[f"{name}.friction"].astype(float), found[f"{name}.slip_velocity"]
        mode = found.columns.get(f"{name}.mode", np.zeros(len(found.t)))
        slips = (mode != 0) & (located or np.abs(speed) > _nearby_change(speed))
        bound = np.where(slips, guide.kinetic_coefficient, guide.static_coefficient) * loads[name]
        if not located:
            bound += _nearby_change(bound)
        excess = np.where(located & slips, np.abs(friction + mode * bound), np.abs(friction) - bound)
        if (i := first((excess > allowed) & (found.t >= begins))) is not None:
            expected = f"{-mode[i] * bound[i]:.9g} in slip" if located and slips[i] else f"at most {bound[i]:.9g}"
            yield (f"{name}.friction = {friction[i]:.9g} at t = {found.t[i]:.9g} s, outside Coulomb's cone; expected "
                   f"{expected}, by the load of its corners, within {allowed[i]:.2g} N")


def _baumgarte_force(run: Examined) -> np.ndarray:
    """Force of Baumgarte's terms, all masses times 2 alpha Phi' + beta^2 Phi (paper, eq. 25), N."""
    law = run.found.settings.get("stabilization")
    if not isinstance(law, Mapping) or law.get("method") != "baumgarte":
        return np.zeros(len(run.found.t))
    alpha, beta = (float(law.get(name) or 0.0) for name in ("alpha", "beta"))
    mass = sum(body.mass for body in run.scene.bodies.values())
    return mass * (2 * alpha * run.found["drift.velocity"] + beta ** 2 * run.found["drift.position"])


def continuity(run: Examined) -> Iterator[str]:
    """Positions and velocities do not jump at an event, beyond rounding and the error of a step."""
    for labels in (POSITIONS, VELOCITIES):
        columns = run.columns(labels)
        allowed = ENGINES_OWN * max(float(np.max(np.abs(run.found[name]))) for name in columns) + SAME * run.size
        for event in run.found.events:
            for name in columns:
                if name in event.before and abs(event.after[name] - event.before[name]) > allowed:
                    yield (f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {name} = "
                           f"{event.before[name]:.9g} before and {event.after[name]:.9g} after; expected no jump of a "
                           "state")


def _while_moving(predicate: Predicate) -> Predicate:
    """Skip a predicate where there is no motion."""
    return lambda run: iter(()) if run.stopped_at_once or not len(run.found.t) else predicate(run)


PREDICATES: tuple[Predicate, ...] = (start, residuals, residuals_at_events, *map(_while_moving, (
    velocities, accelerations, displacements, dissipation, needed_friction, balance, corner_forces, modes,
    unreported_events, cone, continuity)))


def _speed(run: Examined, v: np.ndarray) -> float:
    """Scale of velocities: the size per second, or the largest of these."""
    return max(run.size, float(np.max(np.abs(v))))


def _residuals(run: Examined, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Norms of Phi and Phi' over all parts, shape (2, n)."""
    place = {body: 3 * i for i, body in enumerate(run.scene.bodies)}
    total = np.zeros((2, len(t)))
    for part in run.parts:
        own = np.concatenate([np.arange(place[body], place[body] + 3) for body in part.body_names])
        norms = residual_norms(part.arrays, workspace(part.arrays), t, np.ascontiguousarray(q[:, own]),
                               np.ascontiguousarray(v[:, own]))
        total += np.square(norms)
    return np.sqrt(total)


def _agrees(reported: np.ndarray, residual: np.ndarray, size: float) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.abs(reported - residual) <= DRIFT * (size + residual)


def _changes(h: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Change of velocities between instants, by themselves or by the accelerations at either, shape (n - 1,)."""
    second = np.linalg.norm(a, axis=1)
    return np.maximum(np.linalg.norm(np.diff(v, axis=0), axis=1), h * np.maximum(second[1:], second[:-1]))


def _settled(run: Examined) -> float:
    """Time from which on forces are judged, s: that of `FIRST_STEPS` of a fixed step."""
    return FIRST_STEPS * float(run.found.settings.get("dt") or 0.0)


def _stretches(flags: np.ndarray) -> np.ndarray:
    """First place and place behind the last of each stretch of true flags, shape (stretches, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).reshape(-1, 2)


def _nearby_change(values: np.ndarray) -> np.ndarray:
    """Change of values to the sample before or behind, the larger one; 0 where neither is known."""
    change = np.abs(np.diff(values, prepend=np.nan, append=np.nan))
    return np.fmax(np.fmax(change[1:], change[:-1]), 0.0)


def _largest(values: np.ndarray) -> float:
    """Return the largest magnitude that is known."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
