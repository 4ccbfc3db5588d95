"""Steps of Newton's solvers in the coordinates of the bodies, replayed from recordings of Warp."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.joint_effects import has_static_bounds
from stiction.engines.newton.model import ROTOR, Jitter, ModelWriter, inertia_scale
from stiction.engines.newton.solvers import KINDS, MUJOCO, VBD, create
from stiction.engines.protocol import EngineFailure
from stiction.engines.shared.fixed_step import Sample, Stepper
from stiction.engines.shared.friction_bound import FrictionBound
from stiction.engines.shared.joint_coordinates import motor_link
from stiction.engines.shared.link_tree import LinkTree
from stiction.engines.shared.step_kernels import SpaceStep, begin_space, finish_space
from stiction.reference_impl.compiled.kernel import bound
from stiction.reference_impl.multibody.trajectory_columns import guide_motion, slip_velocity
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.laws import Law, evaluate_law
from stiction.scenes.model import Translational

OFF_PLANE = 1e-2
"""Largest distance from the plane (m), and sine of half the angle by which a body may leave it, before a run ends. No
force acts in these directions, so that only rounding and the iterations of the solver lead there."""
STILL = 1e-4
"""Slip speed up to which a slider between two surfaces is reported to stick, in sizes of the mechanism per second.
Nothing else depends on it."""
CORRECTION = 0.02
"""Part of the error of a drive's coordinate that is corrected in one step. The rounding of a coordinate in single
precision, divided by a step, is a large speed; this part of it is below the rounding of the speed itself."""
CONTACTS_PER_GUIDE = 16
"""Contacts for which there is room for each guide: eight corners of a box at each of two surfaces."""
TOUCHING = 4
"""Steps in which boxes land on the surfaces that they touch at the start, without a contact force at first."""


@dataclass
class _Driven:
    """A drive, whose joint coordinate is ``sign * law + offset``.

    Attributes
    ----------
    dof : int
        The degree of freedom of Newton's model.
    bodies : tuple of int
        Numbers of the two bodies of an angle; -1 for the ground.
    guide : int or None
        Number of the constraint of the scene along which a distance is driven.
    orientation : int
        1, or -1 if the joint coordinate runs against the displacement of that guide.
    """

    law: Law
    dof: int
    sign: int
    bodies: tuple[int, int]
    guide: int | None
    orientation: int
    offset: float = 0.0


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence Warp's messages about its kernels, and Newton's warnings about versions of its own dependencies."""
    import warp

    before = warp.config.log_level
    warp.config.log_level = warp.LOG_ERROR
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        warp.config.log_level = before


class NewtonStepper(Stepper):
    """A scene in a solver of Newton.

    Two states take turns: a step reads one and writes the other. Until a step is accepted, its first state is kept, to
    which `retreat` returns. The calls of Warp of a step in each direction are recorded once and replayed, which takes a
    hundredth of the time of making them in Python.

    Parameters
    ----------
    assembly : Assembly
    h : float
        The step, s.
    options : mapping
        Settings of the run.
    fidelity : Fidelity
    """

    ahead = 1

    def __init__(
        self,
        assembly: Assembly,
        h: float,
        options: Mapping[str, Any],
        fidelity: Fidelity,
    ):
        super().__init__(h)
        scene = assembly.scene
        self._assembly, self._options, self._fidelity = assembly, options, fidelity
        self._kind = kind = KINDS[options["solver"]]
        tree = LinkTree(scene, fidelity)
        self._jitter = Jitter(options["moved_inputs"])
        writer = ModelWriter(scene, tree, fidelity, kind, options, self._jitter)
        self._builder, self._dofs = writer.builder, writer.dofs
        self._twist = np.array(
            [
                [*map(self._jitter, body.velocity), self._jitter(body.angular_velocity)]
                for body in scene.bodies.values()
            ]
        )
        self._load_factors = np.array([self._jitter(1.0) for _ in range(3 * len(scene.bodies))])
        self._joint_rates = None
        if kind.uses_joint_state:
            _, rates = tree.coordinates(scene)
            self._joint_rates = [self._jitter(rate) for rate in rates]
        is_capped = fidelity == Fidelity.JOINT and kind.has_joint_friction
        self.bound = FrictionBound(assembly.whole, options.get("passes", 1), is_capped)
        self.balanced = bool(len(self.bound.held))
        self.settling = TOUCHING if fidelity == Fidelity.CONTACT else 0
        self._loaded = bool(scene.springs_and_dampers or scene.forces)
        self._rest = STILL * assembly.whole.arrays.length_scale
        self._friction_dofs = [
            self._dofs.of_joint[name] for name in scene.frictional_joints if is_capped
        ]
        self._bound_factors = [self._jitter(1.0) for _ in self._friction_dofs]
        # Places of these joints in the order of Newton's joints.
        self._friction_rows = np.argsort(np.argsort(self._friction_dofs))
        self._has_fixed_bounds = all(
            joint.static_coefficient == 0.0 if isinstance(joint, Translational) else True
            for joint in scene.frictional_joints.values()
        ) and not has_static_bounds(scene)
        self._joints = [list(scene.joints).index(name) for name in scene.frictional_joints]
        self._drives = [self._driven(tree, name) for name in scene.drives]
        self._rotor = ROTOR * inertia_scale(scene)
        self._share_states(len(scene.bodies))

    def _driven(self, tree: LinkTree, name: str) -> _Driven:
        """Return the drive of this name, without its offset."""
        scene = self._assembly.scene
        drive = scene.drives[name]
        link, sign = motor_link(scene, tree, drive)
        numbers = {body: number for number, body in enumerate(scene.bodies)}
        first, second = (numbers.get(body, -1) for body in drive.bodies)
        guide = None
        joint = tree.links[link].joint
        if drive.type == "distance" and joint is not None:
            guide = list(scene.joints).index(joint)
        dof = self._dofs.of_drive[name]
        return _Driven(drive.law, dof, sign, (first, second), guide, tree.links[link].sign)

    def _share_states(self, count: int) -> None:
        """Create the arrays of the states of the bodies, which the kernels read and write."""
        self._present, self._before = np.zeros((2, count, 6))
        pushed, q, v, a = np.zeros((4, 3 * count))
        self.data = SpaceStep(
            cap=self.bound.data,
            h=self.h,
            ahead=0.0,
            loaded=int(self._loaded),
            pushed=pushed,
            q=q,
            v=v,
            a=a,
            present=self._present,
            before=self._before,
        )
        self._start = np.zeros((2, 3 * count))

    def compile(self) -> None:
        self._set_up()
        angles = np.array([body.angle for body in self._assembly.scene.bodies.values()])
        self._angles = self._read(self._turn, angles)
        begin_space(self.data, 0.0)
        self.finish = bound(finish_space, self.data)
        for drive in self._drives:
            coordinate, _ = self._motion_of(drive)
            drive.offset = coordinate - drive.sign * evaluate_law(drive.law, 0.0)[0]

    def _set_up(self) -> None:
        """Create the solver, load or compile its kernels, and record a step in each direction."""
        import newton
        import warp

        options, guides = self._options, self._assembly.scene.guides
        is_contact = self._fidelity == Fidelity.CONTACT
        most_contacts = CONTACTS_PER_GUIDE * len(guides) if is_contact else 0
        if options["solver"] == VBD:
            self._builder.color()
        self._model = model = self._builder.finalize(device="cpu")
        # Kamino has rows of its matrices for all contacts for which there is room, used or not.
        model.rigid_contact_max = max(1, most_contacts)
        self._control = model.control()
        self._pipeline = None
        if is_contact and not self._kind.detects_contacts:
            self._pipeline = newton.CollisionPipeline(model, rigid_contact_max=most_contacts)
        # A first solver compiles the kernels, as recording does not. What it keeps from step to step
        # must not enter the run.
        for is_trial in (True, False):
            self._solver = create(options["solver"], model, options, most_contacts)
            self._states = (model.state(), model.state())
            self._contacts = None if self._pipeline is None else self._pipeline.contacts()
            self._observe()
            self._write_start()
            self._graphs: list[Any] = []
            for turn in (0, 1):
                with warp.ScopedCapture(device="cpu") as capture:
                    self._record(turn)
                self._graphs.append(capture.graph)
            if is_trial:
                for graph in self._graphs:
                    warp.capture_launch(graph)
        self._write_start()
        self._turn = 0
        # On the CPU these arrays are views of Newton's memory, by which a step exchanges its data.
        count = len(self._assembly.scene.bodies)
        self._poses = [state.body_q.numpy()[:count] for state in self._states]
        self._twists = [state.body_qd.numpy()[:count] for state in self._states]
        self._wrenches = [state.body_f.numpy()[:count] for state in self._states]
        self._bounds = model.joint_friction.numpy()
        self._torques = self._control.joint_f.numpy()
        self._targets = self._control.joint_target_q.numpy()
        self._target_rates = self._control.joint_target_qd.numpy()
        if self._friction_dofs and self._observables is None:
            # Kamino adds the forces of friction to the states, with a row for each joint that has some.
            self._multipliers = [state.joint_lambdas_f.numpy() for state in self._states]

    def _record(self, turn: int) -> None:
        """Make the calls of a step from the state of a turn to the other one."""
        import newton

        first, second = self._states[turn], self._states[1 - turn]
        if self._pipeline is not None:
            self._pipeline.collide(first, self._contacts)
        further = {} if self._observables is None else {"observables": self._observables}
        if self._options["solver"] == MUJOCO and not self._has_fixed_bounds:
            # MuJoCo's model has a copy of the bounds of friction.
            self._solver.notify_model_changed(newton.ModelFlags.JOINT_DOF_PROPERTIES)
        self._solver.step(first, second, self._control, self._contacts, self.h, **further)

    def _observe(self) -> None:
        """Have MuJoCo report the friction of joints."""
        self._observables = None
        if self._options["solver"] == MUJOCO and len(self.bound.held):
            kind = self._solver.ObservableKind.QFRC_FRICTIONLOSS
            self._observables = self._solver.observables({kind})

    def _write_start(self) -> None:
        """Set both states to the start of the scene."""
        import newton

        model = self._model
        for state in self._states:
            state.body_q.assign(model.body_q)
            velocities = state.body_qd.numpy()
            velocities[:] = 0.0
            velocities[: len(self._twist), [0, 1, 5]] = self._twist
            # Bodies that hold others in the plane move with them.
            for carried, carriages in self._dofs.carriages.items():
                for number, kept in zip(carriages, ((0,), (0, 1))):
                    velocities[number, kept] = velocities[carried, kept]
            if self._joint_rates is not None:
                # Newton's coordinates are zero at the start; joints that close loops come last.
                state.joint_q.zero_()
                rates = state.joint_qd.numpy()
                rates[:] = 0.0
                rates[: len(self._joint_rates)] = self._joint_rates
                newton.eval_fk(model, state.joint_q, state.joint_qd, state)

    def aim(self) -> None:
        # The step before was accepted: its second state is the first one of this step.
        if self.k:
            self._turn = 1 - self._turn
        self._start[0], self._start[1] = self.data.q, self.data.v
        self._start_angles = self._angles
        torques, targets = self._torques, self._targets
        t, h = self.k * self.h, self.h
        for drive in self._drives:
            value, end = (evaluate_law(drive.law, time)[0] for time in (t, t + h))
            if self._kind.has_armature:
                coordinate, speed = self._motion_of(drive)
                error = drive.sign * value + drive.offset - coordinate
                wanted = drive.sign * (end - value) / h + CORRECTION * error / h
                # The rotor's inertia dwarfs that of the mechanism, so this force gives the joint its
                # rate within the step, whatever the mechanism does.
                torques[drive.dof] = self._rotor * (wanted - speed) / h
            else:
                targets[drive.dof] = drive.sign * (end - evaluate_law(drive.law, 0.0)[0])
                self._target_rates[drive.dof] = drive.sign * (end - value) / h

    def advance(self, caps: Sequence[float]) -> None:
        import warp

        for dof, cap, factor in zip(self._friction_dofs, caps, self._bound_factors):
            self._bounds[dof] = cap * factor
        if self._loaded:
            loads, wrenches = self.data.pushed * self._load_factors, self._wrenches[self._turn]
            wrenches[:, 0], wrenches[:, 1], wrenches[:, 5] = loads[0::3], loads[1::3], loads[2::3]
        self.clock.call(warp.capture_launch, self._graphs[self._turn])
        self._angles = self._read(1 - self._turn, self._start_angles)
        self._read_friction()

    def retreat(self) -> None:
        # The first state of the step is unchanged.
        pass

    def _read(self, turn: int, angles: np.ndarray) -> np.ndarray:
        """Read the bodies of a state into `data`; return their angles, which continue those given."""
        poses, twists, present = self._poses[turn], self._twists[turn], self._present
        present[:, 0:2] = poses[:, 0:2]
        turned = 2.0 * np.arctan2(poses[:, 5].astype(float), poses[:, 6].astype(float))
        # A quaternion and its negative are the same orientation: of all angles, the nearest one.
        continued = turned + 2.0 * np.pi * np.round((angles - turned) / (2.0 * np.pi))
        present[:, 2] = continued
        present[:, 3:5] = twists[:, 0:2]
        present[:, 5] = twists[:, 5]
        self._refuse_off_plane(poses)
        return continued

    def _refuse_off_plane(self, poses: np.ndarray) -> None:
        """Raise EngineFailure if a body has left the plane of the mechanism."""
        off = max(np.abs(poses[:, 2]).max(), np.abs(poses[:, 3:5]).max())
        if off > OFF_PLANE:
            raise EngineFailure(
                f"newton: a body has left the plane, by {off:.2g} (m, or sine of half an angle) at "
                f"t = {self.k * self.h:g} s; expected at most {OFF_PLANE:g}"
            )

    def _read_friction(self) -> None:
        """Set the magnitudes of the frictions in the last pass, N or N m."""
        if not self._friction_dofs:
            return
        if self._observables is not None:
            frictions = self._observables.qfrc_frictionloss.numpy()[self._friction_dofs]
        else:
            frictions = self._multipliers[1 - self._turn][self._friction_rows]
        self.bound.held[:] = np.abs(frictions)

    def _slip_speeds(self) -> np.ndarray:
        """Return the slip speeds of the frictional joints at the start of the last step, m/s or rad/s."""
        q, v = (values[np.newaxis] for values in self._start)
        arrays = self._assembly.whole.arrays
        return np.array([slip_velocity(arrays, joint, q, v)[0] for joint in self._joints])

    def _motion_of(self, drive: _Driven) -> tuple[float, float]:
        """Return the coordinate of a drive's joint, and its rate, at the end of the last step."""
        q, v = self.data.q, self.data.v
        if drive.guide is not None:
            arrays = self._assembly.whole.arrays
            place, speed = guide_motion(arrays, drive.guide, q[np.newaxis], v[np.newaxis])
            return drive.orientation * float(place[0]), drive.orientation * float(speed[0])
        angle = rate = 0.0
        for weight, body in zip((drive.sign, -drive.sign), drive.bodies):
            if body >= 0:
                angle += weight * float(q[3 * body + 2])
                rate += weight * float(v[3 * body + 2])
        return angle, rate

    def sample(self) -> Sample:
        q, v = self._start[0].copy(), self._start[1].copy()
        if self.balanced:
            modes, frictions = self.bound.modes_before(), self.bound.frictions()
        else:
            speeds = self._slip_speeds()
            modes = np.where(np.abs(speeds) > self._rest, np.sign(speeds), 0.0).astype(int)
            unknown = np.nan if self._fidelity == Fidelity.CONTACT else 0.0
            frictions = np.full(len(speeds), unknown)
        return Sample(q, v, self.data.a.copy(), modes, frictions)
