"""Checks whether the states of a trajectory fit the mechanism, and whether its columns and events fit each other.

A trajectory that passes need not be accurate, but its columns and events belong to one motion of the mechanism, at the
same instants.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from stiction.engines.examined import (
    MODES,
    POSITIONS,
    RESIDUALS,
    ROUNDING,
    VELOCITIES,
    Examined,
    InEquations,
    Predicate,
    first,
)
from stiction.reference_impl.multibody.initial_state import CONSISTENT
from stiction.reference_impl.multibody.mechanism import TRANSLATIONAL, Arrays, Mechanism
from stiction.reference_impl.multibody.reactions import columns_of_rows, parts_of_null_vectors
from stiction.reference_impl.multibody.trajectory_columns import (
    GUIDE_COLUMNS,
    PIN_SLIP,
    guide_motion,
    residual_norms,
    slip_velocity,
)
from stiction.scenes import Event
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.event_values import Sides
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Joint, Revolute, Translational
from stiction.scenes.trajectory import stacked

START = 1e-6
"""Largest distance of the first state from the scene's start, relative to the mechanism's size; for velocities,
relative to the size per second or the largest speed at the start. Scene files satisfy their constraints to 1e-9
(`CONSISTENT`); engines that compute in single precision (eps = 6e-8) round the start."""
DRIFT = 1e-6
"""Accuracy of the residuals that a trajectory reports for its own states: relative, and absolute in units of the
mechanism's size."""
SAME = 1e-6
"""Accuracy of a column that is a function of others, relative to the largest value of its kind. Engines that compute in
single precision reach it."""
ENGINES_OWN = 1e-2
"""Relative difference between two values that an engine computes for the same quantity: the forces of its contacts and
of its joints, and the states on both sides of an event, which engines with a fixed step take from two steps. With steps
of a hundredth of a second they differ by a thousandth."""
BALANCE = 1e-4
"""Largest residual of the equations of motion, relative to the largest force. Engines that locate events have residuals
of 1e-8, and of 1e-5 in a mechanism whose masses differ by a factor of 1e8. If a column is late by one sample, or has
the wrong sign, the residual is a hundredth or more."""
CAP = 1e-2
"""Amount by which friction may exceed its own bound at fixed step size, relative to the largest bound of the run: the
engine uses the bound of the previous step, and samples that are several steps apart do not show every change of it."""
LASTING = 5
"""Number of consecutive samples with a contradiction that count as a fault of forces at fixed step size. Friction and
acceleration may be those of neighbouring steps, which disagree at one or two samples where a force jumps."""
CONTRADICTED = 0.1
"""Residual at fixed step size by which forces contradict the motion, relative to the largest force on the body or the
largest friction of the guide. A wrong sign leaves twice a force, and a wrong factor most of it. A method of first order
with some hundred steps per motion leaves a hundredth. The gate does not judge accuracy."""
SINGLE = 2.0**-23
"""Relative rounding of velocities from whose differences accelerations are computed: single precision is the worst
case."""
TEN_TOLERANCES = 10.0
"""Error of a state in units of the tolerance of an engine that locates events, since local errors add up."""
WITHIN = (-1.0, -0.618, -0.382, 0.309, 0.691, 1.0)
"""Instants, in steps from a sample, at which an engine may have evaluated the forces of the sample. None is a simple
fraction of another, so that a force that rotates several times in a step differs between them."""
FIRST_STEPS = 20
"""Number of first steps of fixed size in which friction is not judged. The bound of the first step cannot use reactions
of a previous step. In mechanisms with loops, up to 16 steps pass until the reactions settle, and the samples of these
steps contain the friction of a later step."""


def check_start(run: Examined) -> Iterator[str]:
    """Check that the first state is the scene's start.

    If the scene's start does not satisfy the constraints, the engine may have assembled the mechanism, and the start is
    not checked.
    """
    if not len(run.trajectory.t):
        return
    q, v, _ = run.motion
    start_q, start_v = run.start
    [position], [velocity] = _residuals(run, np.zeros(1), start_q[None], start_v[None])
    speed = _speed(run, start_v)
    if position > CONSISTENT * run.size or velocity > CONSISTENT * speed:
        return
    for values, expected, labels, size in (
        (q[0], start_q, POSITIONS, run.size),
        (v[0], start_v, VELOCITIES, speed),
    ):
        if (i := first(~(np.abs(values - expected) <= START * size))) is not None:
            yield (
                f"a start that is not the scene's: {run.columns(labels)[i]} = {values[i]:.9g}; expected "
                f"{expected[i]:.9g} within {START * size:.1g}"
            )


def check_residuals(run: Examined) -> Iterator[str]:
    """Check that states satisfy the constraints at the start, and roughly also later, and that the drift is theirs."""
    t = run.trajectory.t
    if not len(t):
        return
    q, v, _ = run.motion
    norms = _residuals(run, t.astype(float), q, v, run.in_equations)
    if (i := first(~(norms[0] <= run.size))) is not None and run.scene.joints | run.scene.drives:
        yield (
            f"states that have left the mechanism: {norms[0][i]:.3g} m off the constraints at t = {t[i]:.9g} s; "
            f"expected less than its size, {run.size:.3g} m"
        )
    sizes = (run.size, _speed(run, run.start[1]))
    for name, residual, size, unit in zip(RESIDUALS, norms, sizes, ("m", "m/s")):
        if not residual[0] <= START * size:
            yield f"a start that is {residual[0]:.3g} {unit} off the constraints; expected at most {START * size:.1g}"
        if (i := first(~_agrees(run.trajectory[name], residual, size))) is not None:
            yield (
                f"{name} = {run.trajectory[name][i]:.6g} at t = {t[i]:.9g} s; expected {residual[i]:.6g}, the residual "
                "of its states"
            )


def check_residuals_at_events(run: Examined) -> Iterator[str]:
    """Check that the residuals on both sides of events are those of the states there.

    The constraint of a drive depends on time, so that values of a neighbouring sample are noticed.
    """
    position, velocity = run.columns(POSITIONS), run.columns(VELOCITIES)
    sides = run.sides.with_columns({*position, *velocity, *RESIDUALS})
    if not len(sides):
        return
    q, v = (np.stack([sides[name] for name in labels], axis=1) for labels in (position, velocity))
    sizes = (run.size, _speed(run, v))
    for name, residual, size in zip(RESIDUALS, _residuals(run, sides.t, q, v), sizes):
        reported = sides[name]
        if (i := first(~_agrees(reported, residual, size))) is not None:
            yield (
                f"{sides.label(i)}, {name} = {reported[i]:.6g}; expected {residual[i]:.6g}, the residual of its "
                "states then"
            )


def check_velocities(run: Examined) -> Iterator[str]:
    """Check that velocities are the derivatives of positions.

    Along the direction of its velocity, the positions of a body must change by the integral of the velocity; means are
    removed from both. Between two instants a velocity is uncertain by its change there: half of the change is the error
    of the trapezoidal rule, and the other half that of engines that use the velocity at the end of a step. Intervals in
    which velocities change by their own size are not judged. Means are removed because a vibration whose period is one
    interval would bias them. Motions that are small compared with the mechanism and with the longest distance are not
    judged either, because engines correct positions by as much.
    """
    size = run.size
    # Angles are multiplied by the size, so that all coordinates are lengths. Translation and rotation of
    # each body are judged separately.
    h = np.diff(run.trajectory.t.astype(float))
    motions = []
    for body in run.scene.bodies:
        motions.append(_BodyMotion.of(run, body, "vx, vy", slice(0, 2), 1.0))
        motions.append(_BodyMotion.of(run, body, "omega", slice(2, 3), size))
    # Intervals in which the velocities of all bodies together change by less than themselves.
    jump = np.sum([motion.jump for motion in motions], axis=0)
    acceleration = np.sum([motion.acceleration for motion in motions], axis=0)
    speed = np.sqrt(sum(_square(motion.mean) for motion in motions))
    is_judged = _change(h, jump, acceleration) < speed
    if not is_judged.any():
        return
    h_judged = h[is_judged]
    begin = run.trajectory.t[:-1][is_judged]
    centred = [motion.without_means(is_judged, h_judged) for motion in motions]
    speeds = [np.sqrt(_square(mean)) for _, mean in centred]
    small = ENGINES_OWN * (size + max(h_judged @ speed for speed in speeds))
    for motion, (moved, mean), speed in zip(motions, centred, speeds):
        distance = h_judged @ speed
        if distance <= small:
            continue
        along = sum(change * velocity for change, velocity in zip(moved, mean))
        by_position = along / np.where(speed > 0, speed, 1.0)
        unknown = h_judged * _change(h, motion.jump, motion.acceleration)[is_judged]
        allowed = np.sum(unknown) + small
        if abs(np.sum(by_position) - distance) > allowed:
            i = int(np.argmax(np.abs(by_position - h_judged * speed) - unknown))
            scale, unit = (size, "rad") if motion.kind == "omega" else (1.0, "m")
            yield (
                f"velocities of {motion.body} ({motion.kind}) that are not those of its positions: about their mean "
                f"they move it by {distance / scale:.4g} {unit}, its positions by "
                f"{np.sum(by_position) / scale:.4g} {unit}, and differ most from t = {begin[i]:.9g} s on; expected "
                f"the same within {allowed / scale:.2g} {unit}"
            )


class _BodyMotion(NamedTuple):
    """Translation or rotation of a body between neighbouring instants; angles are multiplied by a length.

    Attributes
    ----------
    body, kind : str
        The body, and the columns of its velocity.
    moved, mean : list of ndarray, shape (n - 1,)
        For each coordinate, its change in each interval, and the mean of the velocities at both ends.
    jump : ndarray, shape (n - 1,)
        Square of the change of the velocity.
    acceleration : ndarray, shape (n,)
        Square of the acceleration at the instants.
    """

    body: str
    kind: str
    moved: list[np.ndarray]
    mean: list[np.ndarray]
    jump: np.ndarray
    acceleration: np.ndarray

    @staticmethod
    def of(run: Examined, body: str, kind: str, labels: slice, scale: float) -> _BodyMotion:
        """Read the columns of a body; `labels` selects those of each of `BODY_COLUMNS`."""
        q, v, a = (
            [scale * run.trajectory[f"{body}.{label}"].astype(float) for label in columns[labels]]
            for columns in BODY_COLUMNS
        )
        return _BodyMotion(
            body=body,
            kind=kind,
            moved=[np.diff(values) for values in q],
            mean=[(values[1:] + values[:-1]) / 2 for values in v],
            jump=_square([np.diff(values) for values in v]),
            acceleration=_square(a),
        )

    def without_means(
        self, is_judged: np.ndarray, h: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Return `moved` and `mean` in the judged intervals, of lengths h (s), without their mean velocity there."""
        moved = [values[is_judged] for values in self.moved]
        mean = [values[is_judged] for values in self.mean]
        return (
            [values - h * (values.sum() / h.sum()) for values in moved],
            [values - h @ values / h.sum() for values in mean],
        )


def check_displacements(run: Examined) -> Iterator[str]:
    """Check that displacements and slip velocities of guides, and slip velocities of pins, are those of the states."""
    for part in run.parts:
        # Displacements are compared with the largest coordinate, velocities with the largest of all.
        q, v = (
            stacked(run.trajectory.columns, part.body_names, labels)
            for labels in (POSITIONS, VELOCITIES)
        )
        sizes = [max(part.arrays.length_scale, float(np.max(np.abs(values)))) for values in (q, v)]
        for k, name in enumerate([*part.scene.joints, *part.scene.drives]):
            expected_of: dict[str, tuple[np.ndarray, float]] = {}
            if part.arrays.constraint[k]["kind"] == TRANSLATIONAL:
                motion = guide_motion(part.arrays, k, q, v)
                expected_of = dict(zip(GUIDE_COLUMNS, zip(motion, sizes)))
            elif name in part.guide_names:
                expected_of = {PIN_SLIP: (slip_velocity(part.arrays, k, q, v), sizes[1])}
            for label, (expected, size) in expected_of.items():
                yield from run.differs(
                    f"{name}.{label}", expected, SAME * size, "that of its states"
                )


def check_dissipation(run: Examined) -> Iterator[str]:
    """Check that friction dissipates energy: friction times slip velocity is at most 0.

    Each sample of engines that keep Coulomb's cone is checked by itself, so that nothing is assumed about the motion
    between samples. A sample is not judged if its friction may belong to another direction of slip: if the engine
    reports stick, if slip may begin, end or reverse within a step, or if the largest friction would stop the slip in
    less than a step, as slip that an iteration has left of stick. A fault has to last for `LASTING` consecutive
    samples. Forces that are nan are not judged, nor forces as small as the rounding of the mechanism's largest force or
    as the force of Baumgarte's terms.
    """
    trajectory = run.trajectory
    if not run.keeps(trajectory.settings):
        return
    t, step = trajectory.t.astype(float), _step(run)
    accuracy = max(SAME, TEN_TOLERANCES * float(trajectory.settings.get("rtol") or 0.0))
    for part in run.parts:
        frictional = {
            name: joint
            for name, joint in run.scene.frictional_joints.items()
            if name in part.guide_names
        }
        if not frictional:
            continue
        q, v, a = (stacked(trajectory.columns, part.body_names, labels) for labels in BODY_COLUMNS)
        slow = accuracy * _speed(run, v)
        for name, joint in frictional.items():
            friction, speed = (
                trajectory[f"{name}.{label}"].astype(float)
                for label in ("friction", "slip_velocity")
            )
            k = list(part.scene.joints).index(name)
            sticks = trajectory.columns.get(f"{name}.mode", np.ones(len(t))) == 0
            # Samples at which friction drives the slider; those that may be right are removed below.
            drives = (
                (friction * speed > 0.0) & (np.abs(speed) > slow) & (t >= _settled(run)) & ~sticks
            )
            if not drives.any():
                continue
            lever = part.force_units[part.arrays.rows + part.guide_names.index(name)]
            drives &= np.abs(friction) > lever * (
                accuracy * _largest_force(run, part) + _baumgarte_force(run)
            )
            suspects = np.flatnonzero(drives)
            if step and len(suspects):
                # Slip that may have another direction within a step
                motion = t[suspects], q[suspects], v[suspects], a[suspects]
                for share in WITHIN:
                    _, moved_q, moved_v = _moved(share * step, *motion)
                    slip = slip_velocity(part.arrays, k, moved_q, moved_v)
                    drives[suspects] &= slip * speed[suspects] > 0.0
                # Slip that the largest friction stops within a step; the mobility is the acceleration
                # of the free body along the guide by a force of 1 N.
                columns, _ = columns_of_rows(part.arrays, *motion[:3])
                place = part.arrays.rows + part.guide_names.index(name)
                along = columns[:, :, place] / part.force_units[place]
                mobility = np.sum(along**2 * part.arrays.inverse_mass, axis=1)
                bound = _static_bound(run, name, joint)
                largest = np.maximum(np.abs(friction), bound)[suspects]
                drives[suspects] &= np.abs(speed[suspects]) > step * mobility * largest
            for begin, behind in _lasting(drives):
                work = np.trapezoid((friction * speed)[begin:behind], t[begin:behind])
                i = begin + int(np.argmax(np.abs(friction * speed)[begin:behind]))
                yield (
                    f"{name}.friction = {friction[i]:.9g} at t = {t[i]:.9g} s, where {name}.slip_velocity = "
                    f"{speed[i]:.9g}: from {t[begin]:.9g} to {t[behind - 1]:.9g} s friction drives the slider, and "
                    f"gives it {work:.3g} J; expected the force on the slider, against its slip (the other sign?)"
                )
                break


def check_momentum_of_steps(run: Examined) -> Iterator[str]:
    """Check Newton's and Euler's equations at the samples of a fixed step, and friction by these equations.

    This is for engines at joint fidelity that keep Coulomb's cone, compute accelerations themselves and do not locate
    events. Others are checked by `check_balance`, or not at all. Each sample is judged by itself, independently of the
    motion between samples.

    The values that an engine of fixed step reports for an instant come from states up to a step before and after it.
    Therefore the change of the equations with time, with positions and with velocities between these states (`WITHIN`),
    extrapolated from the sample, is allowed, and the change of the forces to the neighbouring samples. Also allowed are
    `CONTRADICTED` of the largest force on the body, or of the largest friction of the guide, and the effect of rounding
    of the velocities on the accelerations. Faults at fewer than `LASTING` samples in a row are not reported, nor at
    instants at which a guide of the part reverses within a step, nor of forces that are nan or that the motion does not
    determine.
    """
    trajectory = run.trajectory
    t = trajectory.t.astype(float)
    step = _step(run)
    # The setting "accelerations" says that the adapter computes them, from differences of velocities.
    has_own_accelerations = "accelerations" not in trajectory.settings
    has_fixed_step = bool(step) and not run.locates(trajectory.settings)
    keeps_cone = not run.scene.frictional_joints or run.keeps(trajectory.settings)
    is_joint = run.fidelity == Fidelity.JOINT
    if not (has_fixed_step and is_joint and has_own_accelerations and keeps_cone):
        return
    chosen = np.flatnonzero(t >= _settled(run))
    for part in run.parts if len(chosen) >= LASTING else ():
        left = _left_over(run, part, chosen, step)
        for column, given, needed, wrong in left.frictions:
            for begin, _ in _lasting(wrong):
                yield (
                    f"{column} = {given[begin]:.9g} at t = {t[chosen[begin]]:.9g} s; expected {needed[begin]:.9g}, "
                    "the force along the guide that accelerations and other forces need"
                )
                break
        wrong = np.abs(left.force) > left.allowed
        for begin, behind in _lasting(wrong.any(axis=1)):
            # the coordinate that exceeds what is allowed by the largest factor
            excess = wrong[begin] * np.abs(left.force[begin]) / left.allowed[begin]
            k = int(np.argmax(excess))
            yield (
                f"forces and accelerations that do not balance from t = {t[chosen[begin]]:.9g} to "
                f"{t[chosen[behind - 1]]:.9g} s: {left.force[begin, k]:.4g} {'N m' if k % 3 == 2 else 'N'} on "
                f"{part.body_names[k // 3]} are left over; expected less than {left.allowed[begin, k]:.2g}"
            )
            break


class _LeftOver(NamedTuple):
    """Residuals of Newton's and Euler's equations with accelerations and forces of a part.

    Attributes
    ----------
    force, allowed : ndarray, shape (n, 3 * bodies)
        Force (N) or moment (N m) left over at each sample, and the largest one that is no fault.
    frictions : list of tuple
        For each guide with friction: its column, its values, the values that the motion needs, and flags of the samples
        at which these contradict each other.
    """

    force: np.ndarray
    allowed: np.ndarray
    frictions: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]


class _Equations(NamedTuple):
    """Samples of a part, to be put into its equations of motion.

    Attributes
    ----------
    arrays : Arrays
        Of the part's mechanism.
    t : ndarray, shape (n,)
    q, v, a : ndarray, shape (n, 3 * bodies)
    force : ndarray, shape (n, rows + frictional)
        As of `build_columns`.
    """

    arrays: Arrays
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    force: np.ndarray

    @staticmethod
    def of(run: Examined, part: Mechanism, chosen: np.ndarray) -> _Equations:
        """Take the chosen samples of a run."""
        # not stacked: a free body has no rows
        force = np.empty((len(chosen), len(part.force_names)))
        for column, name in enumerate(part.force_names):
            force[:, column] = run.trajectory[name][chosen] / part.force_units[column]
        q, v, a = (
            stacked(run.trajectory.columns, part.body_names, labels)[chosen]
            for labels in BODY_COLUMNS
        )
        return _Equations(part.arrays, run.trajectory.t.astype(float)[chosen], q, v, a, force)

    def remainder(
        self, state: Sequence[np.ndarray], of: np.ndarray | slice
    ) -> tuple[np.ndarray, ...]:
        """Put accelerations and forces `of` samples into the equations at another state (t, q, v).

        Return what is left of M a = Q + J^T force, the columns of J^T, and the applied forces Q.
        """
        mass = 1.0 / self.arrays.inverse_mass
        columns, free = columns_of_rows(self.arrays, *state)
        left = mass * (self.a[of] - free) - np.einsum("nij,nj->ni", columns, self.force[of])
        return left, columns, mass * free

    def within(self, of: np.ndarray, step: float) -> np.ndarray:
        """Return the largest change of the equations `of` samples within a step (s) before and after these, N or N m.

        It is the sum of the changes with time, with positions and with velocities: an engine may take each from another
        instant of its step.
        """
        total = np.zeros((len(of), self.q.shape[1]))
        if not len(of):
            return total
        sampled = self.t[of], self.q[of], self.v[of]
        left, *_ = self.remainder(sampled, of)
        for varied in range(3):  # time, positions or velocities alone
            changed = np.zeros_like(total)
            for share in WITHIN:
                state = list(sampled)
                state[varied] = _moved(share * step, *sampled, self.a[of])[varied]
                changed = np.fmax(changed, np.abs(self.remainder(state, of)[0] - left))
            total += changed
        return total


def _left_over(run: Examined, part: Mechanism, chosen: np.ndarray, step: float) -> _LeftOver:
    """Put accelerations and forces of chosen samples into the equations of motion; `step` in seconds."""
    equations = _Equations.of(run, part, chosen)
    m, t, q, v, a, force = equations
    mass = 1.0 / m.inverse_mass
    left, columns, applied = equations.remainder((t, q, v), slice(None))
    # First, an allowance that is the same at all samples: a part of the largest force and moment on
    # each body, what the largest force of all leaves as rounding, also as a moment, and what
    # rounding of the velocities does to the accelerations.
    terms = (
        np.abs(mass * a),
        np.abs(applied),
        np.nanmax(np.abs(columns * force[:, None, :]), axis=2, initial=0.0),
    )
    largest = np.max(terms, axis=(0, 1), initial=0.0)
    size = largest.copy()
    size[0::3] = size[1::3] = np.maximum(largest[0::3], largest[1::3])
    floor = (
        SAME
        * np.max(size[0::3], initial=0.0)
        * np.where(np.arange(len(size)) % 3 == 2, m.length_scale, 1.0)
    )
    rounding = SINGLE * mass * np.max(np.abs(v), axis=0) / step
    allowed = np.tile(CONTRADICTED * size + floor + rounding, (len(t), 1))
    suspicious = (np.abs(left) > allowed).any(axis=1)

    # Friction: the change of each, together with changes of all other row forces, by which nothing
    # would be left over. It is compared with the larger of the given and the needed friction.
    inverse = np.linalg.pinv(columns)[:, m.rows :]
    missing = np.einsum("nki,ni->nk", inverse, left)
    given = force[:, m.rows :]
    needed = given + missing
    most = np.array(
        [
            CONTRADICTED * max(_largest(given_values), _largest(needed_values))
            for given_values, needed_values in zip(given.T, needed.T)
        ]
    )
    allowed_friction = (
        most
        + SAME * np.max(size[0::3], initial=0.0)
        + np.einsum("nki,i->nk", np.abs(inverse), rounding)
    )
    suspicious |= (np.abs(missing) > allowed_friction).any(axis=1)

    # Only at samples that exceed this allowance, the costly one is computed: the change of the
    # equations within a step, and that of forces to the neighbouring samples.
    change = np.empty_like(force)
    for column in range(force.shape[1]):
        change[:, column] = _nearby_change(force[:, column])
    i = np.flatnonzero(suspicious)
    # A guide that reverses within a step has one friction before and another one after.
    turns = np.zeros(len(i), dtype=bool)
    at_rest = SAME * _speed(run, v)
    for share in WITHIN if len(i) else ():
        _, moved_q, moved_v = _moved(share * step, t[i], q[i], v[i], a[i])
        for name in part.guide_names:
            k = list(part.scene.joints).index(name)
            now = slip_velocity(m, k, q[i], v[i])
            then = slip_velocity(m, k, moved_q, moved_v)
            turns |= (then * now <= 0.0) & (np.abs(then - now) > at_rest)
    unknown = equations.within(i, step) + np.sum(np.abs(columns[i]) * change[i, None, :], axis=2)
    unknown[turns] = np.inf
    allowed[i] += unknown
    allowed_friction[i] += np.where(
        turns[:, None],
        np.inf,
        np.einsum("nki,ni->nk", np.abs(inverse[i]), np.where(turns[:, None], 0.0, unknown)),
    )
    # Frictions that are part of a null vector are not determined by the motion.
    if part.guide_names and len(i):
        missing[i] = np.where(
            parts_of_null_vectors(columns[i], m.rows)[:, m.rows :], np.nan, missing[i]
        )
    wrong = np.abs(missing) > allowed_friction
    return _LeftOver(
        left,
        allowed,
        [
            (f"{name}.friction", force[:, m.rows + k], needed[:, k], wrong[:, k])
            for k, name in enumerate(part.guide_names)
        ],
    )


def _bound(run: Examined, name: str, constant: float, coefficient: float) -> np.ndarray:
    """Return a bound of friction of a joint: a constant (N, or N m of a pin) and a coefficient times its load."""
    if isinstance(run.scene.joints[name], Revolute):
        return np.full(len(run.trajectory.t), constant)
    return constant + coefficient * _load(run, name)


def _static_bound(run: Examined, name: str, joint: Joint) -> np.ndarray:
    """Return the bound of friction of a joint at rest, N or N m."""
    coefficient = 0.0 if isinstance(joint, Revolute) else joint.static_coefficient
    return _bound(run, name, joint.bounds[1], coefficient)


def _load(run: Examined, name: str) -> np.ndarray:
    """Return the load of a guide, by which Coulomb's law bounds friction: the sum of its corner forces, N."""
    corners = (
        ("F1", "F2", "F3", "F4") if run.scene.guides[name].length is not None else ("normal_force",)
    )
    return np.sum([np.abs(run.trajectory[f"{name}.{force}"]) for force in corners], axis=0)


def _load_within(run: Examined, name: str, chosen: np.ndarray) -> np.ndarray:
    """Return the largest change of the load of a guide within a step of chosen samples, N.

    Its reactions R and T change by as much as they have to for the changes of `_Equations.within`. The load is max(|R|,
    2 |N| / length) with N = T - width/2 kappa R, and |kappa| is at most the static coefficient (paper, Sect. 5).
    """
    part = next(part for part in run.parts if name in part.guide_names)
    equations, guide = _Equations.of(run, part, chosen), run.scene.guides[name]
    # The pseudo-inverse turns a change of the equations into the changes of row forces; magnitudes
    # are added, as the signs of the changes are not known.
    places = np.arange(len(chosen))
    _, columns, _ = equations.remainder((equations.t, equations.q, equations.v), places)
    moved = np.einsum(
        "nki,ni->nk", np.abs(np.linalg.pinv(columns)), equations.within(places, _step(run))
    )
    normal, moment = (
        moved[:, part.row_names.index(f"{name}.{label}")] for label in ("normal_force", "moment")
    )
    if guide.length is None:
        return normal
    lever = (guide.width or 0.0) / guide.length * guide.static_coefficient
    return (1.0 + lever) * normal + 2.0 / guide.length * moment


def _largest_force(run: Examined, part: Mechanism) -> float:
    """Return the largest force in a part, N, which is the scale of rounding of forces that are zero.

    Forces are those of joints and drives on each body, the applied ones, masses times accelerations, and m v^2/size. A
    moment is divided by a lever: the mechanism's size, or half the length of the shortest guide.
    """
    trajectory, m = run.trajectory, part.arrays
    q, v, a = (stacked(trajectory.columns, part.body_names, labels) for labels in BODY_COLUMNS)
    columns, free = columns_of_rows(m, trajectory.t.astype(float), q, v)
    # per coordinate, the largest of applied force, mass times acceleration, and row forces on it
    size = np.max(np.abs(np.stack([free, a])), axis=(0, 1)) / m.inverse_mass
    for row, name in enumerate(part.force_names):
        force = _largest(trajectory[name]) / part.force_units[row]
        size = np.maximum(size, np.max(np.abs(columns[:, :, row]), axis=0) * force)
    lever = min(
        [
            m.length_scale,
            *(guide.length / 2 for guide in part.scene.guides.values() if guide.length),
        ]
    )
    speed = max(float(np.max(np.abs(v[:, k::3]))) for k in range(2))
    mass = float(np.max(1.0 / m.inverse_mass[0::3]))
    return float(
        max(
            np.max(size[0::3]),
            np.max(size[1::3]),
            np.max(size[2::3]) / lever,
            mass * speed**2 / m.length_scale,
        )
    )


def _moved(
    time: float, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return times and states that are so many seconds from others, extrapolated by their accelerations."""
    return t + time, q + time * v + time**2 / 2 * a, v + time * a


def _lasting(flags: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield first and end place of stretches of at least `LASTING` true flags; the end is after the last."""
    return ((begin, behind) for begin, behind in _stretches(flags) if behind - begin >= LASTING)


def check_balance(run: Examined) -> Iterator[str]:
    """Check Newton's and Euler's equations at samples and on both sides of events, if the engine locates events."""
    for part, samples in zip(run.parts, run.in_equations):
        if samples is None:
            continue
        sides = run.sides.with_columns(InEquations.needed(part))
        at_events = InEquations.of(part, sides.t, sides.__getitem__)
        size = np.concatenate([samples.size, at_events.size])
        largest = np.max(size[np.isfinite(size)], initial=0.0)
        for left, t, instants in (
            (samples.left, run.trajectory.t, None),
            (at_events.left, sides.t, sides),
        ):
            if (i := first(left > BALANCE * largest)) is not None:
                where = f" ({instants.label(i)})" if instants else ""
                yield (
                    f"forces and accelerations that do not balance at t = {t[i]:.9g} s{where}: "
                    f"{left[i] / largest:.2g} of the largest is left over; expected less than {BALANCE:g}"
                )


def check_corner_forces(run: Examined) -> Iterator[str]:
    """Check that corner forces and surface friction yield the guide's resultant and moment (paper, eq. 21)."""
    trajectory = run.trajectory
    for name, guide in run.scene.guides.items():
        if guide.length is None:
            continue
        length, width = guide.length, guide.width or 0.0
        # All in newtons: a moment is compared with the forces by the lever of half a length.
        F = [trajectory[f"{name}.F{corner}"] for corner in (1, 2, 3, 4)]
        R, T = trajectory[f"{name}.normal_force"], trajectory[f"{name}.moment"]
        size = max(map(_largest, (*F, R, 2 / length * T)))
        friction = (
            trajectory[f"{name}.friction_lower"] - trajectory[f"{name}.friction_upper"]
            if guide.frictional
            else 0.0
        )
        yield from run.differs(
            f"{name}.normal_force",
            F[0] + F[1] - F[2] - F[3],
            ENGINES_OWN * size,
            "the sum of its corner forces",
        )
        yield from run.differs(
            f"{name}.moment",
            length / 2 * (F[1] + F[3] - F[0] - F[2]) + width / 2 * friction,
            ENGINES_OWN * size * length / 2,
            "that of its corner forces and surface friction",
        )


def check_modes(run: Examined) -> Iterator[str]:
    """Check that modes are -1, 0 or 1, and change only at the events of their guide, according to the kinds of these.

    If corner events are located, the surfaces that the corners of a slipping guide touch do not change either.
    """
    trajectory = run.trajectory
    for name in run.scene.frictional_joints:
        mode = f"{name}.mode"
        if mode not in trajectory.columns:
            continue
        column, t = trajectory[mode], trajectory.t
        if (i := first(~np.isin(column, (-1, 0, 1)))) is not None:
            yield f"{mode} = {column[i]} at t = {t[i]:.9g} s; expected -1, 0 or 1"
        own = [event for event in trajectory.events if event.joint == name and mode in event.before]
        if own:
            # a table of a few columns may have the mode of a guide and not all of its corner forces
            has_corners = all(f"{name}.F{corner}" in trajectory.columns for corner in (1, 2, 3, 4))
            locates_corners = any(event.kind == "corner" for event in trajectory.events)
            yield from _chain(run, own, name, has_corners and locates_corners)
            yield from _modes_between(run, own, mode)


def _chain(run: Examined, own: Sequence[Event], name: str, corners: bool) -> Iterator[str]:
    """Check that each event of a guide changes the mode by its kind, from the mode after the previous event."""
    mode = f"{name}.mode"
    sides = Sides(own)
    before, after = sides[mode][::2], sides[mode][1::2]
    for event, old, new in zip(own, before.tolist(), after.tolist()):
        if not MODES[event.kind](old, new):
            yield (
                f"{event.kind} of {name} at t = {event.time:.9g} s: mode {old:g} before and {new:g} after; expected "
                f"those of a {event.kind}"
            )
    # each event ends in the mode, and on the surfaces, in which the next one begins, and is reported once
    is_broken = after[:-1] != before[1:]
    if corners:
        is_broken |= _other_surfaces(run, name, sides)
    is_same_instant = np.diff(sides.t[::2]) == 0.0
    for i in np.flatnonzero(is_broken | is_same_instant).tolist():
        event, following = own[i], own[i + 1]
        if is_broken[i] or event == following:
            yield (
                f"{event.kind} of {name} at t = {event.time:.9g} s, then {following.kind} at "
                f"{following.time:.9g} s: the contact mode after the first is not that before the second; "
                "expected every event once"
            )


def _modes_between(run: Examined, own: Sequence[Event], column: str) -> Iterator[str]:
    """Check that samples between two events of a guide have its mode; at an event, both are accepted."""
    # `mode` between events; at an instant within rounding of one, `earliest` and `latest` are those
    # before and after it.
    t, values = run.trajectory.t, run.trajectory[column]
    times = np.array([event.time for event in own])
    mode = np.concatenate([[own[0].before[column]], Sides(own)[column][1::2]])
    earliest = np.searchsorted(times, t - ROUNDING * t[-1], "left")
    latest = np.searchsorted(times, t + ROUNDING * t[-1], "right")
    for i in np.flatnonzero((values != mode[earliest]) & (values != mode[latest])):
        if values[i] not in mode[earliest[i] : latest[i] + 1]:
            yield f"{column} = {values[i]:g} at t = {t[i]:.9g} s; expected {mode[latest[i]]:g}, that between its events"


def _other_surfaces(run: Examined, name: str, sides: Sides) -> np.ndarray:
    """Return flags of pairs of neighbouring events between which a corner of a slipping guide changes its surface."""
    F = [f"{name}.F{corner}" for corner in (1, 2, 3, 4)]
    size = SAME * max(_largest(run.trajectory[corner]) for corner in F)
    presses = [sides[corner] > size for corner in F]
    slips = sides[f"{name}.mode"][1:-1:2] != 0
    # the corners 1 and 4 are at the rear of a slider, 2 and 3 at its front, on opposite surfaces
    opposite = ((0, 3), (3, 0), (1, 2), (2, 1))
    return slips & np.any([presses[i][1:-1:2] & presses[j][2::2] for i, j in opposite], axis=0)


def check_unreported_events(run: Examined) -> Iterator[str]:
    """Check that each change of a guide's mode has an event, if the engine locates events.

    A change is one between two equal modes and two other ones: at an event, a single sample may have either mode.
    """
    trajectory = run.trajectory
    if not run.locates(trajectory.settings):
        return
    for name, joint in run.scene.frictional_joints.items():
        if not joint.rubs:
            continue
        mode = trajectory.columns.get(f"{name}.mode")
        if mode is None:
            speed = trajectory[f"{name}.slip_velocity"]
            mode = np.where(np.abs(speed) > SAME * np.max(np.abs(speed)), np.sign(speed), 0.0)
        times = np.array([event.time for event in trajectory.events if event.joint == name])
        changed = (mode[:-3] == mode[1:-2]) & (mode[1:-2] != mode[2:-1]) & (mode[2:-1] == mode[3:])
        for i in 1 + np.flatnonzero(changed):
            if not np.any((times >= trajectory.t[i - 1]) & (times <= trajectory.t[i + 2])):
                yield (
                    f"no event of {name} between t = {trajectory.t[i]:.9g} and {trajectory.t[i + 1]:.9g} s, "
                    f"where its mode goes from {mode[i]:g} to {mode[i + 1]:g}; expected one there, as the "
                    "engine says that it locates events"
                )


def check_cone(run: Examined) -> Iterator[str]:
    """Check Coulomb's law with the load of the corner forces and with constant bounds.

    The law is |friction| <= static_friction + mus load at rest, and friction = -mode (friction + mu load) in slip; a
    pin has constant bounds alone. The load is that of the corner forces, see `_load`.

    If events are located, the law must hold to `SAME` of the largest force, or of m v^2/size if that is larger, or to
    ten times the tolerance, which is the error of states. The force of Baumgarte's terms is also allowed. The moment of
    a pin is compared with these by the mechanism's size. At fixed step size, friction has the bound of the previous
    step; the change of the bound within a step, and to the neighbouring samples, is allowed. The bound is then the
    static one, unless the joint slips faster than its speed changes there. Forces that are nan are not judged.
    """
    trajectory, joints = run.trajectory, run.scene.frictional_joints
    if not joints or not run.keeps(trajectory.settings):
        return
    # What rounding and tolerances leave of any force in this run
    static = {name: _static_bound(run, name, joint) for name, joint in joints.items()}
    lever = {
        name: run.size if isinstance(joint, Revolute) else 1.0 for name, joint in joints.items()
    }
    located, settings = bool(run.locates(trajectory.settings)), trajectory.settings
    fastest = max(
        _largest(trajectory[f"{body}.{label}"])
        for body in run.scene.bodies
        for label in ("vx", "vy")
    )
    force = max(
        *(_largest(_load(run, name)) for name in joints if name in run.scene.guides),
        *(bound / lever[name] for name, joint in joints.items() for bound in joint.bounds),
        max(body.mass for body in run.scene.bodies.values()) * fastest**2 / run.size,
    )
    accuracy = max(SAME, TEN_TOLERANCES * float(settings.get("rtol") or 0.0))
    allowed_force = _baumgarte_force(run) + accuracy * force
    begins = 0.0 if located else _settled(run)
    if not located:
        allowed_force += CAP * max(_largest(static[name]) / lever[name] for name in joints)
    for name, joint in joints.items():
        allowed = lever[name] * allowed_force
        friction, speed = (
            trajectory[f"{name}.friction"].astype(float),
            trajectory[f"{name}.slip_velocity"],
        )
        mode = trajectory.columns.get(f"{name}.mode", np.zeros(len(trajectory.t)))
        slips = (mode != 0) & (located or np.abs(speed) > _nearby_change(speed))
        coefficient = 0.0 if isinstance(joint, Revolute) else joint.kinetic_coefficient
        bound = np.where(slips, _bound(run, name, joint.bounds[0], coefficient), static[name])
        if not located:
            bound += _nearby_change(bound)
        excess = np.where(
            located & slips, np.abs(friction + mode * bound), np.abs(friction) - bound
        )
        # The change of the load within a step is costly, and computed only where it may matter.
        if not located and isinstance(joint, Translational):
            beyond = np.flatnonzero((excess > allowed) & (trajectory.t >= begins))
            if len(beyond):
                excess[beyond] -= joint.static_coefficient * _load_within(run, name, beyond)
        if (i := first((excess > allowed) & (trajectory.t >= begins))) is not None:
            expected = (
                f"{-mode[i] * bound[i]:.9g} in slip"
                if located and slips[i]
                else f"at most {bound[i]:.9g}"
            )
            unit = "N" if isinstance(joint, Translational) else "N m"
            yield (
                f"{name}.friction = {friction[i]:.9g} at t = {trajectory.t[i]:.9g} s, outside Coulomb's cone; expected "
                f"{expected}, by the load of its corners, within {allowed[i]:.2g} {unit}"
            )


def _baumgarte_force(run: Examined) -> np.ndarray:
    """Return the force of Baumgarte's terms, all masses times 2 alpha Phi' + beta^2 Phi (paper, eq. 25), N."""
    law = run.trajectory.settings.get("stabilization")
    if not isinstance(law, Mapping) or law.get("method") != "baumgarte":
        return np.zeros(len(run.trajectory.t))
    alpha, beta = (float(law.get(name) or 0.0) for name in ("alpha", "beta"))
    mass = sum(body.mass for body in run.scene.bodies.values())
    return mass * (
        2 * alpha * run.trajectory["drift.velocity"] + beta**2 * run.trajectory["drift.position"]
    )


def check_continuity(run: Examined) -> Iterator[str]:
    """Check that positions and velocities do not jump at an event, beyond rounding and the error of a step."""
    for labels in (POSITIONS, VELOCITIES):
        columns = run.columns(labels)
        allowed = (
            ENGINES_OWN * max(float(np.max(np.abs(run.trajectory[name]))) for name in columns)
            + SAME * run.size
        )
        for name in columns:
            sides = run.sides.with_columns({name})
            before, after = sides[name][::2], sides[name][1::2]
            if (i := first(np.abs(after - before) > allowed)) is not None:
                event = sides.events[i]
                yield (
                    f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {name} = {before[i]:.9g} before and "
                    f"{after[i]:.9g} after; expected no jump of a state"
                )


def _while_moving(predicate: Predicate) -> Predicate:
    """Return a predicate that is skipped if there is no motion."""
    return lambda run: (
        iter(()) if run.stopped_at_once or not len(run.trajectory.t) else predicate(run)
    )


PREDICATES: tuple[Predicate, ...] = (
    check_start,
    check_residuals,
    check_residuals_at_events,
    *map(
        _while_moving,
        (
            check_velocities,
            check_displacements,
            check_dissipation,
            check_momentum_of_steps,
            check_balance,
            check_corner_forces,
            check_modes,
            check_unreported_events,
            check_cone,
            check_continuity,
        ),
    ),
)


def _speed(run: Examined, v: np.ndarray) -> float:
    """Return the scale of velocities: the size per second, or the largest of these."""
    return max(run.size, float(np.max(np.abs(v))))


def _residuals(
    run: Examined,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    evaluated: Sequence[InEquations | None] = (),
) -> np.ndarray:
    """Return the norms of Phi and Phi' over all parts, shape (2, n).

    `evaluated` has the norms of those parts whose equations were evaluated at these states already.
    """
    # A part has its bodies in an order of its own. Norms of parts add up as squares.
    place = {body: 3 * i for i, body in enumerate(run.scene.bodies)}
    total = np.zeros((2, len(t)))
    for part, equations in zip_longest(run.parts, evaluated):
        if equations is not None:
            total += np.square((equations.position, equations.velocity))
            continue
        own = np.concatenate([np.arange(place[body], place[body] + 3) for body in part.body_names])
        norms = residual_norms(
            part.arrays,
            part.workspace,
            t,
            np.ascontiguousarray(q[:, own]),
            np.ascontiguousarray(v[:, own]),
        )
        total += np.square(norms)
    return np.sqrt(total)


def _agrees(reported: np.ndarray, residual: np.ndarray, size: float) -> np.ndarray:
    """Return flags of the instants at which the reported residual is that of the states."""
    # A run that diverges has residuals that overflow here; a nan agrees with nothing.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.abs(reported - residual) <= DRIFT * (size + residual)


def _square(vectors: Sequence[np.ndarray]) -> np.ndarray:
    """Return the squares of the lengths of vectors, which are given by their components."""
    return np.sum([component * component for component in vectors], axis=0)


def _change(h: np.ndarray, jump: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Return the largest change of velocities in intervals of lengths h (s), shape (n - 1,).

    It is the change from end to end, or that by the larger acceleration at both ends.

    Parameters
    ----------
    h : ndarray, shape (n - 1,)
        Lengths of the intervals, s.
    jump : ndarray, shape (n - 1,)
        Squares of the changes from end to end.
    acceleration : ndarray, shape (n,)
        Squares of the accelerations.
    """
    return np.sqrt(np.maximum(jump, h * h * np.maximum(acceleration[1:], acceleration[:-1])))


def _step(run: Examined) -> float:
    """Return the fixed step of the engine, s; 0 if it has none."""
    return float(run.trajectory.settings.get("dt") or 0.0)


def _settled(run: Examined) -> float:
    """Return the time from which on forces are judged, s: that of `FIRST_STEPS` of a fixed step."""
    return FIRST_STEPS * _step(run)


def _stretches(flags: np.ndarray) -> np.ndarray:
    """Return first and end place of each stretch of true flags, shape (stretches, 2); the end is after the last."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).reshape(
        -1, 2
    )


def _nearby_change(values: np.ndarray) -> np.ndarray:
    """Return the larger change of values to the sample before or after; 0 where neither is known."""
    change = np.abs(np.diff(values, prepend=np.nan, append=np.nan))
    return np.fmax(np.fmax(change[1:], change[:-1]), 0.0)


def _largest(values: np.ndarray) -> float:
    """Return the largest magnitude of the finite values; 0 if there are none."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
