"""Checks whether the forces of a trajectory fit its motion: equations of motion, friction, corner forces.

`coherence` contains the checks of states and events, and the list of all checks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stiction.engines.examined import Examined, InEquations, first
from stiction.reference_impl.multibody.mechanism import Arrays, Mechanism
from stiction.reference_impl.multibody.reactions import columns_of_rows, parts_of_null_vectors
from stiction.reference_impl.multibody.trajectory_columns import limited_motion, slip_velocity
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.event_values import Sides
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.model import Drive, Joint, Revolute, Translational
from stiction.scenes.stribeck import bound_in_slip, coefficient_in_slip, friction_radius_in_slip
from stiction.scenes.trajectory import stacked

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


class _Motion(NamedTuple):
    """Samples of the motion of a part of a mechanism.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Times, s.
    q, v, a : ndarray, shape (n, 3 * bodies)
        Coordinates, velocities and accelerations of the bodies (m, rad, s).
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray

    @staticmethod
    def of(run: Examined, part: Mechanism) -> _Motion:
        """Read all samples of a run."""
        q, v, a = (
            stacked(run.trajectory.columns, part.body_names, labels) for labels in BODY_COLUMNS
        )
        return _Motion(run.trajectory.t.astype(float), q, v, a)

    def at(self, chosen: np.ndarray) -> _Motion:
        """Return the chosen samples."""
        return _Motion(self.t[chosen], self.q[chosen], self.v[chosen], self.a[chosen])

    def extrapolated(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return t, q and v at instants `time` seconds after the samples, by their accelerations."""
        q = self.q + time * self.v + time**2 / 2 * self.a
        return self.t + time, q, self.v + time * self.a


def check_dissipation(run: Examined) -> Iterator[str]:
    """Check that friction dissipates energy: friction times slip velocity is at most 0.

    Each sample of engines that keep Coulomb's cone is checked by itself, so that nothing is assumed about the motion
    between samples. A sample is not judged if its friction may belong to another direction of slip: if the engine
    reports stick, if slip may begin, end or reverse within a step, or if the largest friction would stop the slip in
    less than a step, as in stick that an iteration has solved only approximately. A fault has to last for `LASTING`
    consecutive samples. Forces that are nan are not judged, nor forces as small as the rounding of the mechanism's
    largest force or as the force of Baumgarte's terms.
    """
    if not run.keeps(run.trajectory.settings):
        return
    for part in run.parts:
        frictional = [name for name in run.scene.frictional_joints if name in part.guide_names]
        if not frictional:
            continue
        motion = _Motion.of(run, part)
        for name in frictional:
            yield from _check_dissipation_in(run, part, name, motion)


def _check_dissipation_in(
    run: Examined, part: Mechanism, name: str, motion: _Motion
) -> Iterator[str]:
    """Yield the first fault of `check_dissipation` in one joint of a part."""
    t = motion.t
    friction = run.trajectory[f"{name}.friction"].astype(float)
    speed = run.trajectory[f"{name}.slip_velocity"].astype(float)
    drives = _drives_slider(run, part, name, motion, friction, speed)
    for begin, end in _lasting(drives):
        work = np.trapezoid((friction * speed)[begin:end], t[begin:end])
        i = begin + int(np.argmax(np.abs(friction * speed)[begin:end]))
        yield (
            f"{name}.friction = {friction[i]:.9g} at t = {t[i]:.9g} s, where {name}.slip_velocity = "
            f"{speed[i]:.9g}: from {t[begin]:.9g} to {t[end - 1]:.9g} s friction drives the slider, and "
            f"gives it {work:.3g} J; expected the force on the slider, against its slip (the other sign?)"
        )
        return


def _drives_slider(
    run: Examined,
    part: Mechanism,
    name: str,
    motion: _Motion,
    friction: np.ndarray,
    speed: np.ndarray,
) -> np.ndarray:
    """Return flags (n,) of the samples at which friction acts along the slip, beyond doubt.

    Friction is in N and the slip velocity in m/s; in N m and rad/s for a pin.
    """
    accuracy = _state_accuracy(run)
    mode = run.trajectory.columns.get(f"{name}.mode", np.ones(len(motion.t)))
    is_fast = np.abs(speed) > accuracy * velocity_scale(run, motion.v)
    is_settled = motion.t >= _settling_time(run)
    drives = (friction * speed > 0.0) & is_fast & is_settled & (mode != 0)
    # Each of the following conditions is costlier than the one before it, and is evaluated only if
    # samples are left.
    if not drives.any():
        return drives
    rounding = accuracy * _largest_force(run, part) + _baumgarte_force(run)
    # The moment of a pin is compared with forces by its lever.
    drives &= np.abs(friction) > _lever(part, name) * rounding
    suspects = np.flatnonzero(drives)
    if _step(run) and len(suspects):
        drives[suspects] &= _keeps_direction(run, part, name, motion.at(suspects), speed[suspects])
        largest_friction = np.maximum(np.abs(friction), _static_bound(run, name))[suspects]
        stopped = _speed_stopped_in_step(run, part, name, motion.at(suspects), largest_friction)
        drives[suspects] &= np.abs(speed[suspects]) > stopped
    return drives


def _keeps_direction(
    run: Examined, part: Mechanism, name: str, motion: _Motion, speed: np.ndarray
) -> np.ndarray:
    """Return flags of the samples around which the slip of a joint keeps its direction for a step."""
    joint = list(part.scene.joints).index(name)
    keeps = np.ones(len(speed), dtype=bool)
    for share in WITHIN:
        _, q, v = motion.extrapolated(share * _step(run))
        slip = slip_velocity(part.arrays, joint, q, v)
        keeps &= slip * speed > 0.0
    return keeps


def _speed_stopped_in_step(
    run: Examined, part: Mechanism, name: str, motion: _Motion, friction: np.ndarray
) -> np.ndarray:
    """Return the slip speed that friction of this magnitude stops within a step.

    The free bodies are accelerated by e^T M^-1 e per newton along the guide, whose direction in the coordinates is e.
    Friction is in N and the speed in m/s; in N m and rad/s for a pin.
    """
    columns, _ = columns_of_rows(part.arrays, motion.t, motion.q, motion.v)
    row = part.arrays.rows + part.guide_names.index(name)
    along = columns[:, :, row] / _lever(part, name)
    mobility = np.sum(along**2 * part.arrays.inverse_mass, axis=1)
    return _step(run) * mobility * friction


def check_momentum_of_steps(run: Examined) -> Iterator[str]:
    """Check Newton's and Euler's equations at the samples of a fixed step, and friction by these equations.

    This is for engines at joint fidelity that keep Coulomb's cone, compute accelerations themselves and do not locate
    events. Others are checked by `check_balance`, or not at all. Each sample is judged by itself, independently of the
    motion between samples.

    The values that an engine of fixed step reports for an instant come from states up to a step before and after it.
    Therefore the change of the equations with time, with positions and with velocities between these states (`WITHIN`),
    extrapolated from the sample, is allowed, and the change of the forces to the neighbouring samples. Also allowed are
    `CONTRADICTED` of the largest force on the body, or of the largest friction of the joint, and the effect of rounding
    of the velocities on the accelerations. Faults at fewer than `LASTING` samples in a row are not reported, nor at
    instants at which a joint of the part reverses within a step, nor of forces that are nan or that the motion does not
    determine.
    """
    settings = run.trajectory.settings
    # The setting "accelerations" says that the adapter computes them, from differences of velocities.
    has_own_accelerations = "accelerations" not in settings
    has_fixed_step = bool(_step(run)) and not run.locates(settings)
    keeps_cone = not run.scene.frictional_joints or run.keeps(settings)
    is_joint = run.fidelity == Fidelity.JOINT
    if not (has_fixed_step and is_joint and has_own_accelerations and keeps_cone):
        return
    chosen = np.flatnonzero(run.trajectory.t >= _settling_time(run))
    if len(chosen) < LASTING:
        return
    for part in run.parts:
        yield from _check_momentum_in(run, part, chosen)


def _check_momentum_in(run: Examined, part: Mechanism, chosen: np.ndarray) -> Iterator[str]:
    """Yield the first fault of each friction, and of the equations of motion, at chosen samples of a part."""
    t = run.trajectory.t.astype(float)[chosen]
    residuals = _step_residuals(run, part, chosen)
    for friction in residuals.frictions:
        for begin, _ in _lasting(friction.is_wrong):
            yield (
                f"{friction.column} = {friction.reported[begin]:.9g} at t = {t[begin]:.9g} s; expected "
                f"{friction.needed[begin]:.9g}, the force along the guide that accelerations and other forces need"
            )
            break
    is_wrong = np.abs(residuals.force) > residuals.allowed
    for begin, end in _lasting(is_wrong.any(axis=1)):
        # the coordinate that exceeds what is allowed by the largest factor
        ratio = is_wrong[begin] * np.abs(residuals.force[begin]) / residuals.allowed[begin]
        k = int(np.argmax(ratio))
        unit = "N m" if k % 3 == 2 else "N"
        yield (
            f"forces and accelerations that do not balance from t = {t[begin]:.9g} to "
            f"{t[end - 1]:.9g} s: {residuals.force[begin, k]:.4g} {unit} on "
            f"{part.body_names[k // 3]} are left over; expected less than {residuals.allowed[begin, k]:.2g}"
        )
        break


class _FrictionResidual(NamedTuple):
    """Friction of a joint that an engine reports, and the one that the equations of motion need.

    Attributes
    ----------
    column : str
        Column of the friction.
    reported, needed : ndarray, shape (n,)
        The two frictions, N; N m for a pin.
    is_wrong : ndarray, shape (n,)
        Flags of the samples at which they contradict each other.
    """

    column: str
    reported: np.ndarray
    needed: np.ndarray
    is_wrong: np.ndarray


class _StepResiduals(NamedTuple):
    """Residuals of Newton's and Euler's equations at samples of a part.

    Attributes
    ----------
    force, allowed : ndarray, shape (n, 3 * bodies)
        Force (N) or moment (N m) that is left over, and the largest one that is no fault.
    frictions : list of _FrictionResidual
        For each joint with friction.
    """

    force: np.ndarray
    allowed: np.ndarray
    frictions: list[_FrictionResidual]


class _Equations(NamedTuple):
    """Samples of a part, to be put into its equations of motion.

    Attributes
    ----------
    arrays : Arrays
        Arrays of the part's mechanism.
    motion : _Motion
        The motion at n samples.
    force : ndarray, shape (n, rows + frictional)
        Forces of the constraint rows, then frictions (N, N m), as in `build_columns`. The friction of a pin is divided
        by its lever (`Mechanism.force_units`).
    """

    arrays: Arrays
    motion: _Motion
    force: np.ndarray

    @staticmethod
    def of(run: Examined, part: Mechanism, chosen: np.ndarray) -> _Equations:
        """Take the chosen samples of a run."""
        # not stacked: a free body has no rows
        force = np.empty((len(chosen), len(part.force_names)))
        for column, name in enumerate(part.force_names):
            force[:, column] = run.trajectory[name][chosen] / part.force_units[column]
        return _Equations(part.arrays, _Motion.of(run, part).at(chosen), force)

    def at(self, chosen: np.ndarray) -> _Equations:
        """Return the equations of the chosen samples."""
        return _Equations(self.arrays, self.motion.at(chosen), self.force[chosen])

    def residual(self, state: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Put accelerations and forces of the samples into the equations at states (t, q, v).

        Returns
        -------
        residual : ndarray, shape (n, 3 * bodies)
            M a - Q - J^T force, in N and N m.
        columns : ndarray, shape (n, 3 * bodies, rows + frictional)
            J^T.
        applied : ndarray, shape (n, 3 * bodies)
            The applied forces Q.
        """
        mass = 1.0 / self.arrays.inverse_mass
        columns, free = columns_of_rows(self.arrays, *state)
        residual = mass * (self.motion.a - free) - np.einsum("nij,nj->ni", columns, self.force)
        return residual, columns, mass * free

    def change_within(self, step: float) -> np.ndarray:
        """Return the largest change of the residual within a step (s) before and after the samples, N or N m.

        It is the sum of the changes with time, with positions and with velocities: an engine may take each from another
        instant of its step.
        """
        total = np.zeros_like(self.motion.q)
        if not len(total):
            return total
        sampled = self.motion.t, self.motion.q, self.motion.v
        residual, *_ = self.residual(sampled)
        for varied in range(3):  # time, positions or velocities alone
            change = np.zeros_like(total)
            for share in WITHIN:
                state = list(sampled)
                state[varied] = self.motion.extrapolated(share * step)[varied]
                change = np.fmax(change, np.abs(self.residual(state)[0] - residual))
            total += change
        return total


def _step_residuals(run: Examined, part: Mechanism, chosen: np.ndarray) -> _StepResiduals:
    """Put accelerations and forces of chosen samples into the equations of motion of a part.

    What is allowed is first the same at all samples. Only at samples that exceed this, what a step can change is added,
    which is costly to compute.
    """
    step = _step(run)
    equations = _Equations.of(run, part, chosen)
    motion, force, rows = equations.motion, equations.force, part.arrays.rows
    residual, columns, applied = equations.residual((motion.t, motion.q, motion.v))

    # Allowed at all samples: a part of the largest force and moment on each body, the rounding of
    # the largest force of all, and the effect on accelerations of the rounding of velocities. A
    # moment counts as the force that has it at the lever of the mechanism's size: in a mechanism
    # that is loaded by moments alone, all forces may be rounding.
    size = _force_sizes(equations, columns, applied)
    lever = part.arrays.length_scale
    largest = max(
        np.max(size[0::3], initial=0.0),
        np.max(size[2::3], initial=0.0) / lever,
    )
    is_angle = np.arange(len(size)) % 3 == 2
    floor = SAME * largest * np.where(is_angle, lever, 1.0)
    mass = 1.0 / part.arrays.inverse_mass
    rounding = SINGLE * mass * np.max(np.abs(motion.v), axis=0) / step
    allowed = np.tile(CONTRADICTED * size + floor + rounding, (len(chosen), 1))

    # The pseudo-inverse turns the residual into the changes of row forces and frictions by which it
    # would vanish. The change of a friction is compared with the larger of the reported and the
    # needed one.
    inverse = np.linalg.pinv(columns)[:, rows:]
    missing = np.einsum("nki,ni->nk", inverse, residual)
    needed = force[:, rows:] + missing
    tolerated = np.array(
        [
            CONTRADICTED * max(largest_magnitude(reported), largest_magnitude(required))
            for reported, required in zip(force[:, rows:].T, needed.T)
        ]
    )
    by_rounding = np.einsum("nki,i->nk", np.abs(inverse), rounding)
    allowed_friction = tolerated + SAME * largest + by_rounding

    # At suspicious samples add what a step can change. A joint that reverses within a step has one
    # friction before and another one after, so that nothing is judged there.
    is_suspicious = (np.abs(residual) > allowed).any(axis=1)
    is_suspicious |= (np.abs(missing) > allowed_friction).any(axis=1)
    i = np.flatnonzero(is_suspicious)
    if len(i):
        reverses = _reverses_within(part, motion.at(i), step, SAME * velocity_scale(run, motion.v))
        nearby = np.empty_like(force)
        for column, values in enumerate(force.T):
            nearby[:, column] = _nearby_change(values)
        by_step = equations.at(i).change_within(step)
        by_step += np.sum(np.abs(columns[i]) * nearby[i, None, :], axis=2)
        allowed[i] += np.where(reverses[:, None], np.inf, by_step)
        finite = np.where(reverses[:, None], 0.0, by_step)
        friction_by_step = np.einsum("nki,ni->nk", np.abs(inverse[i]), finite)
        allowed_friction[i] += np.where(reverses[:, None], np.inf, friction_by_step)
    # Frictions that are part of a null vector are not determined by the motion.
    if part.guide_names and len(i):
        is_open = parts_of_null_vectors(columns[i], rows)[:, rows:]
        missing[i] = np.where(is_open, np.nan, missing[i])

    is_wrong = np.abs(missing) > allowed_friction
    frictions = [
        _FrictionResidual(
            column=part.force_names[rows + k],
            reported=_lever(part, name) * force[:, rows + k],
            needed=_lever(part, name) * needed[:, k],
            is_wrong=is_wrong[:, k],
        )
        for k, name in enumerate(part.guide_names)
    ]
    return _StepResiduals(residual, allowed, frictions)


def _force_sizes(equations: _Equations, columns: np.ndarray, applied: np.ndarray) -> np.ndarray:
    """Return the largest force (N) and moment (N m) on each body over all samples, shape (3 * bodies,).

    They are those of the terms M a, Q and J^T force; both directions of a force have the same size.
    """
    mass = 1.0 / equations.arrays.inverse_mass
    inertia = np.abs(mass * equations.motion.a)
    by_rows = np.nanmax(np.abs(columns * equations.force[:, None, :]), axis=2, initial=0.0)
    largest = np.max((inertia, np.abs(applied), by_rows), axis=(0, 1), initial=0.0)
    size = largest.copy()
    size[0::3] = np.maximum(largest[0::3], largest[1::3])
    size[1::3] = size[0::3]
    return size


def _reverses_within(part: Mechanism, motion: _Motion, step: float, at_rest: float) -> np.ndarray:
    """Return flags (n,) of the samples around which a joint of the part reverses within a step (s).

    Changes of the slip speed up to `at_rest` (m/s, rad/s) are rounding.
    """
    reverses = np.zeros(len(motion.t), dtype=bool)
    for share in WITHIN:
        t, q, v = motion.extrapolated(share * step)
        for name in part.guide_names:
            speed = _slip_velocity(part, name, motion.t, motion.q, motion.v)
            other_speed = _slip_velocity(part, name, t, q, v)
            reverses |= (other_speed * speed <= 0.0) & (np.abs(other_speed - speed) > at_rest)
    return reverses


def _slip_velocity(
    part: Mechanism, name: str, t: np.ndarray, q: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """Return the slip velocity (n,) of a joint, or of a drive with a limit relative to its law, m/s or rad/s."""
    if name in part.scene.drives:
        return limited_motion(part.scene.drives[name], part.body_names, t, q, v)[0]
    return slip_velocity(part.arrays, list(part.scene.joints).index(name), q, v)


def check_balance(run: Examined) -> Iterator[str]:
    """Check Newton's and Euler's equations at samples and on both sides of events, if the engine locates events."""
    for part, samples in zip(run.parts, run.in_equations):
        if samples is None:
            continue
        sides = run.sides.with_columns(InEquations.needed(part))
        at_events = InEquations.of(part, sides.t, sides.__getitem__)
        sizes = np.concatenate([samples.size, at_events.size])
        largest = np.max(sizes[np.isfinite(sizes)], initial=0.0)
        yield from _check_balance_at(samples.left, largest, run.trajectory.t, None)
        yield from _check_balance_at(at_events.left, largest, sides.t, sides)


def _check_balance_at(
    residual: np.ndarray, largest: float, t: np.ndarray, sides: Sides | None
) -> Iterator[str]:
    """Yield the first of the residuals (n,) at times t (s) that is too large compared with the largest force (N).

    `sides` are those of the events, if the residuals belong to events.
    """
    i = first(residual > BALANCE * largest)
    if i is None:
        return
    label = f" ({sides.label(i)})" if sides else ""
    yield (
        f"forces and accelerations that do not balance at t = {t[i]:.9g} s{label}: "
        f"{residual[i] / largest:.2g} of the largest is left over; expected less than {BALANCE:g}"
    )


def check_corner_forces(run: Examined) -> Iterator[str]:
    """Check that corner forces and surface friction yield the guide's resultant and moment (paper, eq. 21)."""
    trajectory = run.trajectory
    for name, guide in run.scene.guides.items():
        if guide.length is None:
            continue
        length = guide.length
        width = guide.width or 0.0
        F1, F2, F3, F4 = (trajectory[f"{name}.F{corner}"] for corner in (1, 2, 3, 4))
        R = trajectory[f"{name}.normal_force"]
        T = trajectory[f"{name}.moment"]
        surface_friction: np.ndarray | float = 0.0
        if guide.frictional:
            lower = trajectory[f"{name}.friction_lower"]
            surface_friction = lower - trajectory[f"{name}.friction_upper"]
        # All in newtons: a moment is compared with the forces by the lever of half a length.
        size = max(map(largest_magnitude, (F1, F2, F3, F4, R, 2 / length * T)))
        yield from run.differs(
            f"{name}.normal_force",
            F1 + F2 - F3 - F4,
            ENGINES_OWN * size,
            "the sum of its corner forces",
        )
        yield from run.differs(
            f"{name}.moment",
            length / 2 * (F2 + F4 - F1 - F3) + width / 2 * surface_friction,
            ENGINES_OWN * size * length / 2,
            "that of its corner forces and surface friction",
        )


def check_cone(run: Examined) -> Iterator[str]:
    """Check Coulomb's law with the load of the corner forces and with constant bounds.

    The law is |friction| <= static_friction + mus load at rest, and friction = -mode (friction + mu load) in slip, with
    `friction` and mu at the speed of slip. The load is that of the corner forces, see `_load`; of a pin it is the force
    in it times its radius. A drive with a limit has a constant bound only, and its friction is its effort.

    If events are located, the law must hold to `SAME` of the largest force, or of m v^2/size if that is larger, or to
    ten times the tolerance, which is the error of states. The force of Baumgarte's terms is also allowed. The moment of
    a pin is compared with these forces by the mechanism's size. At fixed step size, friction has the bound of the
    previous step; the change of the bound within a step, and to the neighbouring samples, is allowed. The bound is then
    the static one, unless the joint slips faster than its speed changes there. Forces that are nan are not judged.
    """
    joints = run.scene.bounded_elements
    settings = run.trajectory.settings
    if not joints or not run.keeps(settings):
        return
    tolerance = _cone_tolerance(run)
    for name, joint in joints.items():
        allowed = _cone_lever(run, joint) * tolerance
        if run.locates(settings):
            yield from _check_cone_with_events(run, name, allowed)
        else:
            yield from _check_cone_of_steps(run, name, allowed)


def _is_torque(element: Joint | Drive) -> bool:
    """Return True if the friction of a joint, or the effort of a drive, is a torque."""
    return isinstance(element, Revolute) or element.type == "angle"


def _friction_column(run: Examined, name: str) -> str:
    """Return the column of the friction of a joint, or of the effort of a drive with a limit."""
    return f"{name}.effort" if name in run.scene.drives else f"{name}.friction"


def _cone_lever(run: Examined, element: Joint | Drive) -> float:
    """Return the factor from forces to the friction of an element: 1, or the mechanism's size (m) for torques."""
    return run.size if _is_torque(element) else 1.0


def _cone_tolerance(run: Examined) -> np.ndarray:
    """Return the force (n,), in newtons, by which friction may be off Coulomb's law."""
    joints = run.scene.bounded_elements
    # The largest of the loads, of the constant bounds and of m v^2/size.
    fastest = 0.0
    for body in run.scene.bodies:
        for label in ("vx", "vy"):
            fastest = max(fastest, largest_magnitude(run.trajectory[f"{body}.{label}"]))
    heaviest = max(body.mass for body in run.scene.bodies.values())
    force = heaviest * fastest**2 / run.size
    for name, joint in joints.items():
        force = max(force, max(joint.bounds) / _cone_lever(run, joint))
        if isinstance(joint, Translational):
            force = max(force, largest_magnitude(_load(run, name)))
    tolerance = _baumgarte_force(run) + _state_accuracy(run) * force
    if not run.locates(run.trajectory.settings):
        tolerance += CAP * max(
            largest_magnitude(_static_bound(run, name)) / _cone_lever(run, joint)
            for name, joint in joints.items()
        )
    return tolerance


def _check_cone_with_events(run: Examined, name: str, allowed: np.ndarray) -> Iterator[str]:
    """Yield the first fault of `check_cone` in a joint of an engine that locates events.

    `allowed` (N, or N m for a pin) has the shape (n,).
    """
    trajectory = run.trajectory
    friction = trajectory[_friction_column(run, name)].astype(float)
    mode = trajectory.columns.get(f"{name}.mode", np.zeros(len(trajectory.t)))
    slips = mode != 0
    bound = np.where(slips, _kinetic_bound(run, name), _static_bound(run, name))
    excess = np.where(slips, np.abs(friction + mode * bound), np.abs(friction) - bound)
    i = first(excess > allowed)
    if i is not None:
        expected = f"{-mode[i] * bound[i]:.9g} in slip" if slips[i] else f"at most {bound[i]:.9g}"
        yield _outside_cone(run, name, i, expected, allowed[i])


def _check_cone_of_steps(run: Examined, name: str, allowed: np.ndarray) -> Iterator[str]:
    """Yield the first fault of `check_cone` in a joint of an engine that does not locate events.

    `allowed` (N, or N m for a pin) has the shape (n,).
    """
    trajectory = run.trajectory
    joint = run.scene.bounded_elements[name]
    friction = trajectory[_friction_column(run, name)].astype(float)
    speed = trajectory[f"{name}.slip_velocity"]
    mode = trajectory.columns.get(f"{name}.mode", np.zeros(len(trajectory.t)))
    slips = (mode != 0) & (np.abs(speed) > _nearby_change(speed))
    bound = np.where(slips, _kinetic_bound(run, name), _static_bound(run, name))
    bound += _nearby_change(bound)
    excess = np.abs(friction) - bound
    # The change of the load within a step is costly, and computed only where it may matter. A pin has
    # no load.
    is_settled = trajectory.t >= _settling_time(run)
    suspects = np.flatnonzero((excess > allowed) & is_settled)
    if len(suspects) and isinstance(joint, Translational):
        excess[suspects] -= joint.static_coefficient * _load_change_within(run, name, suspects)
    i = first((excess > allowed) & is_settled)
    if i is not None:
        yield _outside_cone(run, name, i, f"at most {bound[i]:.9g}", allowed[i])


def _outside_cone(run: Examined, name: str, i: int, expected: str, allowed: float) -> str:
    """Return the message for a friction outside Coulomb's cone at sample i."""
    trajectory = run.trajectory
    unit = "N m" if _is_torque(run.scene.bounded_elements[name]) else "N"
    column = _friction_column(run, name)
    return (
        f"{column} = {trajectory[column].astype(float)[i]:.9g} at t = {trajectory.t[i]:.9g} s, "
        f"outside Coulomb's cone; expected {expected}, by the load of its corners, within {allowed:.2g} {unit}"
    )


def _kinetic_bound(run: Examined, name: str) -> np.ndarray:
    """Return the magnitude (n,) of the friction of a joint in slip, N, or N m for a pin."""
    joint = run.scene.bounded_elements[name]
    speed = run.trajectory[f"{name}.slip_velocity"]
    if isinstance(joint, Drive):
        return np.full(len(speed), joint.bounds[0])
    constant = bound_in_slip(joint, speed)
    if isinstance(joint, Revolute):
        return constant + friction_radius_in_slip(joint, speed) * _force_in_pin(run, name)
    return constant + coefficient_in_slip(joint, speed) * _load(run, name)


def _static_bound(run: Examined, name: str) -> np.ndarray:
    """Return the largest friction (n,) of a joint at rest, N, or N m for a pin."""
    joint = run.scene.bounded_elements[name]
    _, constant = joint.bounds
    if isinstance(joint, Drive):
        return np.full(len(run.trajectory.t), constant)
    if isinstance(joint, Revolute):
        return constant + joint.friction_radii[1] * _force_in_pin(run, name)
    return constant + joint.static_coefficient * _load(run, name)


def _force_in_pin(run: Examined, name: str) -> np.ndarray:
    """Return the size of the force in a pin, N."""
    return np.hypot(run.trajectory[f"{name}.fx"], run.trajectory[f"{name}.fy"])


def _load(run: Examined, name: str) -> np.ndarray:
    """Return the load of a guide, by which Coulomb's law bounds friction: the sum of its corner forces, N."""
    labels: tuple[str, ...] = ("F1", "F2", "F3", "F4")
    if run.scene.guides[name].length is None:
        labels = ("normal_force",)
    return np.sum([np.abs(run.trajectory[f"{name}.{label}"]) for label in labels], axis=0)


def _load_change_within(run: Examined, name: str, chosen: np.ndarray) -> np.ndarray:
    """Return the largest change of the load of a guide within a step of chosen samples, N.

    Its reactions R and T change by as much as they have to for the changes of `_Equations.change_within`. The load is
    max(|R|, 2 |N| / length) with N = T - width/2 kappa R, and |kappa| is at most the static coefficient (paper, Sect.
    5).
    """
    [part] = [part for part in run.parts if name in part.guide_names]
    guide = run.scene.guides[name]
    equations = _Equations.of(run, part, chosen)
    motion = equations.motion
    _, columns, _ = equations.residual((motion.t, motion.q, motion.v))
    # The pseudo-inverse turns a change of the equations into the changes of row forces; magnitudes
    # are added, as the signs of the changes are not known.
    change = equations.change_within(_step(run))
    row_change = np.einsum("nki,ni->nk", np.abs(np.linalg.pinv(columns)), change)
    normal = row_change[:, part.row_names.index(f"{name}.normal_force")]
    moment = row_change[:, part.row_names.index(f"{name}.moment")]
    if guide.length is None:
        return normal
    lever = (guide.width or 0.0) / guide.length * guide.static_coefficient
    return (1.0 + lever) * normal + 2.0 / guide.length * moment


def _baumgarte_force(run: Examined) -> np.ndarray:
    """Return the force of Baumgarte's terms, all masses times 2 alpha Phi' + beta^2 Phi (paper, eq. 25), N."""
    stabilization = run.trajectory.settings.get("stabilization")
    if not isinstance(stabilization, Mapping) or stabilization.get("method") != "baumgarte":
        return np.zeros(len(run.trajectory.t))
    alpha = float(stabilization.get("alpha") or 0.0)
    beta = float(stabilization.get("beta") or 0.0)
    mass = sum(body.mass for body in run.scene.bodies.values())
    return mass * (
        2 * alpha * run.trajectory["drift.velocity"] + beta**2 * run.trajectory["drift.position"]
    )


def _largest_force(run: Examined, part: Mechanism) -> float:
    """Return the largest force in a part, N, which is the scale of rounding of forces that are zero.

    Forces are those of joints and drives on each body, the applied ones, masses times accelerations, and m v^2/size. A
    moment is divided by a lever: the mechanism's size, or half the length of the shortest guide.
    """
    m = part.arrays
    motion = _Motion.of(run, part)
    columns, free = columns_of_rows(m, motion.t, motion.q, motion.v)
    # per coordinate, the largest of applied force, mass times acceleration, and row forces on it
    size = np.max(np.abs(np.stack([free, motion.a])), axis=(0, 1)) / m.inverse_mass
    for row, name in enumerate(part.force_names):
        force = largest_magnitude(run.trajectory[name]) / part.force_units[row]
        size = np.maximum(size, np.max(np.abs(columns[:, :, row]), axis=0) * force)
    lever = m.length_scale
    for guide in part.scene.guides.values():
        if guide.length:
            lever = min(lever, guide.length / 2)
    speed = max(float(np.max(np.abs(motion.v[:, 0::3]))), float(np.max(np.abs(motion.v[:, 1::3]))))
    mass = float(np.max(1.0 / m.inverse_mass[0::3]))
    return float(
        max(
            np.max(size[0::3]),
            np.max(size[1::3]),
            np.max(size[2::3]) / lever,
            mass * speed**2 / m.length_scale,
        )
    )


def _lever(part: Mechanism, name: str) -> float:
    """Return the value of the friction of a joint per unit of its row force: 1, or the lever of a pin (m)."""
    return float(part.force_units[part.arrays.rows + part.guide_names.index(name)])


def velocity_scale(run: Examined, v: np.ndarray) -> float:
    """Return the scale of velocities: the size per second, or the largest of these."""
    return max(run.size, float(np.max(np.abs(v))))


def _state_accuracy(run: Examined) -> float:
    """Return the relative accuracy of states: `SAME`, or ten times the tolerance of the run if that is more."""
    return max(SAME, TEN_TOLERANCES * float(run.trajectory.settings.get("rtol") or 0.0))


def _step(run: Examined) -> float:
    """Return the fixed step of the engine, s; 0 if it has none."""
    return float(run.trajectory.settings.get("dt") or 0.0)


def _settling_time(run: Examined) -> float:
    """Return the time from which on forces are judged, s: the end of the first `FIRST_STEPS` steps of fixed size."""
    return FIRST_STEPS * _step(run)


def _lasting(flags: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield begin and end of each stretch of at least `LASTING` true flags; the end is the place after the last."""
    changes = np.diff(np.concatenate([[False], flags, [False]]).astype(int))
    for begin, end in np.flatnonzero(changes).reshape(-1, 2):
        if end - begin >= LASTING:
            yield begin, end


def _nearby_change(values: np.ndarray) -> np.ndarray:
    """Return the larger change of values to the sample before or after; 0 where neither is known."""
    change = np.abs(np.diff(values, prepend=np.nan, append=np.nan))
    return np.fmax(np.fmax(change[1:], change[:-1]), 0.0)


def largest_magnitude(values: np.ndarray) -> float:
    """Return the largest magnitude of the finite values; 0 if there are none."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
