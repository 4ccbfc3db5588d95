"""The reference implementation behind the engine protocol."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import ThreadpoolController

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.joint_effects import ALL_EFFECTS
from stiction.engines.protocol import Capabilities, Engine, check_settings, installed_version
from stiction.scenes import Cost, Event, InputError, Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fidelity import Fidelity

if TYPE_CHECKING:
    from stiction.reference_impl.integration.result import Run
    from stiction.reference_impl.multibody.mechanism import Mechanism

SETTINGS = {
    "method": "event",
    "solver": "automatic",
    "stabilization": "scene",
    "assemble": False,
    "event_values": True,
    "audit": "sampled",
}
METHODS = ("event", "paper", "textbook")
STABILIZATIONS = ("scene", "none", "baumgarte", "projection")
AUDITS = {"none": 0, "sampled": 1, "dense": 32}
"""Number of instants of each step at which Coulomb's law is verified, by the setting `audit`."""
DEFAULT_TOLERANCE = 1e-9
"""Relative tolerance where none is given."""
RUNGE_KUTTA_ORDER = 4
"""Order of the paper's integrator between break-aways."""
QUOTIENT_ROUNDING = 1e-12
"""Relative rounding of t_end divided by an output step, which may be just below a whole number."""
NO_REMAINDER = 1e-9
"""Part of an output step that is rounding of the difference between the last output and the end, and no step."""
_SPLIT = (
    "surfaces of a slider: equal mobilization f/(mus N); guides at rest that share a load: the frictions of the "
    "smallest sum of squares that Coulomb's law admits; a guide that joints lock: no friction; a guide at rest "
    "that a drive holds, and several forces of one motion: left open (nan)"
)


class ReferenceEngine(Engine):
    """The method of Zhuang & Wang (2014), which formulates friction as an HLCP.

    ``method`` selects the integrator:

    - ``"event"``: DOP853 with relative tolerance `rtol`; contact modes are fixed between located events.
    - ``"paper"``: the scheme of the paper, with a fixed step `dt` and an HLCP in every evaluation. It is also used if
      `dt` is given without a method.
    - ``"textbook"``: the same scheme in dense NumPy (`stiction.reference_impl.paper`). It is hundreds of times
      slower, and exists to be read and compared with the compiled code.

    Mechanically independent parts of a scene are integrated separately; an event contains the values of its part.

    ``solver`` selects how contact forces are found, for ``"event"`` and ``"paper"``:

    - ``"lemke"``: Lemke's method, as in the paper.
    - ``"enumeration"``: all contact modes are tried.
    - ``"trial"``: trial and error on the signs of the normal forces (Klepp 1996), the usual method before
      complementarity problems.
    - ``"automatic"``: Lemke's method and, if it ends without a solution, enumeration. Large mechanisms whose contact
      forces are known to be unique are solved by trial and error first. The counters ``lemke_rays``, ``enumerations``
      and ``trial_fallbacks`` report how often one method replaced another.

    If the selected solver finds no solution the run ends, and `Trajectory.breakdown` contains the time and the guide.

    ``audit`` selects the instants at which the event-driven method verifies that a step satisfies Coulomb's law:
    ``"sampled"``, one instant in each step, which is not chosen by the integrator; ``"dense"``, 32 instants in each
    step; ``"none"``. If a step violates the law, the run ends with a breakdown.

    ``stabilization``: ``"scene"`` uses the stabilization declared by the scene; ``"none"``, ``"baumgarte"`` and
    ``"projection"`` replace it.

    ``assemble``: if true, an initial state that violates the constraints is projected onto them.

    ``event_values``: if false, events contain time, kind and guide but no values, for runs with very many events.
    """

    name = "reference"
    capabilities = Capabilities(
        fidelities=(Fidelity.JOINT,),
        static_coefficient={Fidelity.JOINT: True},
        friction_law={
            Fidelity.JOINT: "Coulomb, set-valued, mu and mus, load of each corner force (engine)"
        },
        reactions="engine",
        order="8, with located events (method event); 4 between events and 1 across a break-away "
        "(methods paper, textbook)",
        adaptive=True,
        joint_effects={Fidelity.JOINT: ALL_EFFECTS},
    )

    @property
    def version(self) -> str:
        return installed_version("stiction")

    def default_settings(self, fidelity: Fidelity) -> Mapping[str, Any]:
        return dict(SETTINGS)

    def settings_of_run(
        self, given: Mapping[str, Any], *, fidelity: Fidelity, dt: float | None, rtol: float | None
    ) -> dict[str, Any]:
        return {**SETTINGS, "method": _method(dt, rtol), **given}

    def check_arguments(self, *, fidelity: Fidelity, settings: Mapping[str, Any], **_: Any) -> None:
        # a step or a tolerance: each method has its own
        check_settings(settings, self.default_settings(fidelity), self.name, fidelity)

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return True

    def prepare_run(
        self,
        scene: Scene,
        *,
        dt: float | None = None,
        rtol: float | None = None,
        method: str | None = None,
        stabilization: str = "scene",
        **_: Any,
    ) -> None:
        from stiction.reference_impl.compiled.compiling_ahead import compile_ahead, event_kernels

        # The kernels of the other methods are compiled at their first call.
        if (method or _method(dt, rtol)) == "event":
            projects = scene.stabilization.method if stabilization == "scene" else stabilization
            compile_ahead(event_kernels(bool(scene.bounded_elements), projects == "projection"))

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        return None

    def run(
        self,
        scene: Scene,
        *,
        t_end: float,
        dt: float | None,
        rtol: float | None,
        fidelity: Fidelity,
        output_step: float,
        settings: Mapping[str, Any],
        assembly: Assembly | None = None,
    ) -> Trajectory:
        from stiction.engines.shared.fixed_step import step_of, steps_between_outputs
        from stiction.reference_impl.compiled.kernel import clock, compiling_seconds
        from stiction.reference_impl.friction.solver_names import SOLVERS
        from stiction.reference_impl.integration.event_driven import simulate_event_driven
        from stiction.reference_impl.integration.paper_scheme import simulate_as_paper
        from stiction.reference_impl.multibody.initial_state import consistent_starts
        from stiction.reference_impl.multibody.subsystems import simulate_parts

        chosen = self.settings_of_run(settings, fidelity=fidelity, dt=dt, rtol=rtol)
        _check(chosen, dt, rtol)
        # Compiling is reported apart from setting up, wherever it happens in this run.
        compiled = compiling_seconds()
        self.prepare_run(scene, method=chosen["method"], stabilization=chosen["stabilization"])
        started = clock()
        mechanisms = assembly_of(scene, assembly).parts
        parts = [part.stabilized(chosen["stabilization"]) for part in mechanisms]
        starts = consistent_starts(parts, chosen["assemble"])
        assembled = clock() - started
        solver = SOLVERS[chosen["solver"]]
        # `simulate` integrates one part up to a time. A part that breaks down ends the others there.
        if chosen["method"] == "event":
            rtol = DEFAULT_TOLERANCE if rtol is None else rtol
            output = output_times(t_end, output_step)
            scale = {"rtol": rtol}

            def simulate(i: int, until: float) -> Run:
                return simulate_event_driven(
                    parts[i],
                    *starts[i],
                    output[output <= until],
                    until,
                    rtol,
                    solver=solver,
                    sides=chosen["event_values"],
                    audits=AUDITS[chosen["audit"]] if parts[i].guide_names else 0,
                )
        else:
            dt = step_of(dt, t_end)
            steps = max(1, round(t_end / dt))
            dt = t_end / steps
            every = steps_between_outputs(steps, output_step / dt)
            scale = {"dt": dt, "runge_kutta_order": RUNGE_KUTTA_ORDER}

            def simulate(i: int, until: float) -> Run:
                if chosen["method"] == "textbook":
                    return _as_written(
                        parts[i], *starts[i], dt, min(steps, ceil(until / dt)), every
                    )
                return simulate_as_paper(
                    parts[i],
                    *starts[i],
                    dt,
                    min(steps, ceil(until / dt)),
                    every,
                    solver,
                    sides=chosen["event_values"],
                )

        # Parts that do not act on each other are integrated one after the other, each with its own
        # steps and events.
        with _linear_algebra().limit(limits=1):
            run = simulate_parts(scene, parts, simulate, t_end)
        rows = _rows_that_are_motion(run, max(part.arrays.length_scale for part in parts))
        stressed = [name for part in parts for name in part.stressed_guides]
        cost = replace(
            run.cost, setup_s=run.cost.setup_s + assembled, compile_s=compiling_seconds() - compiled
        )
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=run.t[:rows],
            columns={name: values[:rows] for name, values in run.columns.items()},
            events=run.events,
            switches=run.switches,
            cost=cost,
            termination=run.termination,
            breakdown=run.breakdown,
            alternatives={name: values[:rows] for name, values in run.alternatives.items()},
            settings={
                **scale,
                "method": chosen["method"],
                "solver": chosen["solver"],
                "stabilization": parts[0].stabilization,
                "friction_law": self.capabilities.friction_law[Fidelity.JOINT],
                "hyperstatic_split": _SPLIT,
                **({"loads_left_open": stressed} if stressed else {}),
            },
        )


def _rows_that_are_motion(run: Run, size: float) -> int:
    """Return the number of rows; after a breakdown, of those before the first that is no motion.

    A row is no motion if it is not finite, or further off the constraints than `size`. A fixed step that is unstable
    overflows within a step or two, and its last rows are of that kind. Forces that are not unique are nan in a motion.
    """
    # A run that broke down at once has one row, its start without forces.
    if run.breakdown is None or len(run.t) < 2:
        return len(run.t)
    labels = {label for group in BODY_COLUMNS for label in group}
    is_motion = [run.columns["drift.position"] <= size]
    for name, values in run.columns.items():
        is_of_body = name.rpartition(".")[2] in labels
        is_motion.append(np.isfinite(values) if is_of_body else ~np.isinf(values))
    motion = np.all(is_motion, axis=0)
    return len(run.t) if motion.all() else int(np.argmin(motion))


def _method(dt: float | None, rtol: float | None) -> str:
    """Return the method that runs where none is given."""
    return "paper" if dt is not None and rtol is None else "event"


def _check(chosen: Mapping[str, Any], dt: float | None, rtol: float | None) -> None:
    """Raise InputError for settings that do not go together, or with a step or a tolerance."""
    from stiction.reference_impl.friction.solver_names import SOLVERS

    for key, words in (
        ("method", METHODS),
        ("solver", SOLVERS),
        ("audit", AUDITS),
        ("stabilization", STABILIZATIONS),
    ):
        if chosen[key] not in words:
            raise InputError(
                f"reference: {key} = {chosen[key]!r}; expected one of {', '.join(words)}"
            )
    # The textbook method is the paper's as written, without other solvers and stabilizations.
    if chosen["method"] == "textbook":
        for key in ("solver", "stabilization"):
            if chosen[key] != SETTINGS[key]:
                raise InputError(
                    f"reference: {key} = {chosen[key]!r}; expected {SETTINGS[key]!r} of method 'textbook'"
                )
    if chosen["method"] == "event" and dt is not None:
        raise InputError("reference: dt given, but method 'event' has a tolerance; expected rtol")
    if chosen["method"] != "event" and rtol is not None:
        raise InputError(
            f"reference: rtol given, but method {chosen['method']!r} has a fixed step; expected dt"
        )


def output_times(t_end: float, step: float) -> np.ndarray:
    """Return 0, step, 2 step, ... and t_end."""
    times = np.arange(int(np.floor(t_end / step * (1 + QUOTIENT_ROUNDING))) + 1) * step
    if not t_end - times[-1] <= NO_REMAINDER * step:
        times = np.append(times, t_end)
    return np.minimum(times, t_end)


def _as_written(
    mechanism: Mechanism, q: np.ndarray, v: np.ndarray, dt: float, steps: int, every: int
) -> Run:
    """Return a run by the paper's scheme as written; raise SceneError for elements that the paper does not have."""
    from stiction.reference_impl.friction.open_forces import open_forces
    from stiction.reference_impl.integration.result import Run, alternative_columns
    from stiction.reference_impl.multibody.trajectory_columns import build_columns
    from stiction.reference_impl.paper import March, Paper
    from stiction.scenes.event_values import rows_of

    started = time.process_time()
    paper = Paper(mechanism.scene)
    prepared = time.process_time()
    march = paper.march(q, v, dt, steps)
    stepped = time.process_time()
    # Forces by the rows of the mechanism, whose order differs from that of the paper's equations.
    order = [paper.equations.rows.index(name) for name in mechanism.row_names]
    order += range(len(order), march.force.shape[1])

    def columns(part: March, every: int = 1) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        t, q, v, a, force, slip = (
            values[::every]
            for values in (part.t, part.q, part.v, part.a, part.force[:, order], part.mode)
        )
        force = force / mechanism.force_units
        opened = open_forces(mechanism, t, q, v, force, slip)
        built = build_columns(mechanism, t, q, v, a, opened.force, slip)
        return built, alternative_columns(mechanism, opened, len(t), built)

    sides = rows_of(columns(march.sides)[0]) if march.sides else []
    events = tuple(
        Event(instant, kind, mechanism.guide_names[guide], sides[2 * i], sides[2 * i + 1])
        for i, (instant, kind, guide) in enumerate(march.events)
    )
    motion, alternatives = columns(march, every)
    cost = Cost(
        prepared - started,
        0.0,
        stepped - prepared,
        {"steps": len(march.t) - 1, "events": len(events)},
    )
    return Run(march.t[::every], motion, events, cost, march.breakdown, alternatives)


@cache
def _linear_algebra() -> ThreadpoolController:
    """Return the thread pools of the kernels' linear algebra: small matrices are slower with more than one thread."""
    return ThreadpoolController().select(user_api="blas")


@cache
def compile_kernels(*modules: str) -> float:
    """Compile all kernels, or load them from the cache on disk; returns the CPU seconds this took in this process.

    A run compiles the kernels that it needs by itself. This is for runs that are timed, or have a time limit.

    Parameters
    ----------
    *modules : str
        Names in `stiction.reference_impl.integration`; those of the reference if none is given.
    """
    from stiction.reference_impl.compiled.compiling_ahead import compile_all

    for kernels in modules or ("coulomb_audit", "event_driven", "paper_scheme"):
        import_module(f"stiction.reference_impl.integration.{kernels}")
    started = time.process_time()
    compile_all()
    return time.process_time() - started
