"""Compilation of the kernels of a run before it starts, by two processes.

Otherwise each kernel is compiled at its first call. The two processes begin at opposite ends of a list, and each finds
on disk what the other has compiled. The kernels that take longest are at both ends of the list: where the processes
meet, they may compile the same kernel, which then takes little time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module

from stiction.reference_impl.compiled.kernel import Linked, linked_kernels


def compile_ahead(kernels: Sequence[Linked]) -> None:
    """Compile those kernels whose machine code is not on disk yet."""
    missing = [kernel for kernel in kernels if not kernel.is_linked and not kernel.is_kept]
    if not missing:
        return
    second_process = None
    if len(missing) > 1 and (os.cpu_count() or 1) > 1:
        second_process = _start_second_process(missing)
    try:
        for place, kernel in enumerate(missing, start=1):
            kernel.link(f"{place} of {len(missing)}, ")
    finally:
        if second_process is not None:
            second_process.kill()
            second_process.wait()


def compile_all() -> None:
    """Compile, or load from disk, the kernels of all modules that have been imported."""
    kernels = linked_kernels()
    compile_ahead(kernels)
    for kernel in kernels:
        kernel.link()


def event_kernels(friction: bool, projects: bool) -> tuple[Linked, ...]:
    """Return the kernels of the event-driven method, in the order in which they are compiled.

    Parameters
    ----------
    friction
        Whether the scene has friction.
    projects
        Whether the state is projected onto the constraints.
    """
    # Imported here, since these modules import this package.
    from stiction.reference_impl.compiled import linear_algebra
    from stiction.reference_impl.friction import (
        contact_solvers,
        frozen_mode,
        guides_at_rest,
        hlcp,
        lemke,
        mode_choice,
        uniqueness,
    )
    from stiction.reference_impl.integration import (
        event_driven,
        event_location,
        integration_state,
        mode_switch,
        right_hand_side,
        step_audit,
        step_limits,
    )
    from stiction.reference_impl.multibody import (
        banded_systems,
        dynamics,
        kinematics,
        projection,
        trajectory_columns,
    )

    always = (
        event_driven._locate,
        event_driven._relocate_on_constraints,
        event_driven._attempt,
        dynamics.row_form,
        right_hand_side.right_hand_side,
        kinematics.law_at,
        integration_state._stages,
        event_driven._propose,
        event_driven._emit,
        event_driven._refresh,
        event_driven.integrate,
        uniqueness.gain_of_mode,
    )
    rest = (
        trajectory_columns.write_sample,
        trajectory_columns.residual_norms,
        event_driven._commit,
        frozen_mode.solve_mode,
        *((projection.project, projection._correct) if projects else ()),
    )
    if not friction:
        return (*always, *rest, linear_algebra.solve_in_place, integration_state.error_along_motion)
    return (
        mode_switch.switch_mode,
        hlcp.solve,
        hlcp.assemble,
        *always,
        event_location._stays_positive,
        contact_solvers.solve_contact,
        contact_solvers._solve_with_bounds,
        step_audit.audit,
        event_location.go_to_event,
        mode_switch.begin,
        event_location.zero_near_end,
        mode_switch.begin_mode,
        mode_switch._look_behind,
        mode_switch._foresee_speeds,
        mode_choice._settle,
        uniqueness.has_several,
        uniqueness._count,
        mode_switch._come_to_rest,
        guides_at_rest.rest_together,
        guides_at_rest._are_independent,
        uniqueness.friction_gain,
        guides_at_rest._rest_together,
        dynamics.unit_rows,
        banded_systems.open_cell,
        mode_switch._break_away,
        mode_switch._remove_creep_against_slip,
        guides_at_rest.leave_together,
        mode_switch._count_other_modes,
        mode_choice.other_modes,
        mode_choice._other_modes,
        linear_algebra.eliminate_columns,
        lemke.lemke,
        hlcp._units,
        hlcp._scale,
        hlcp._rescale,
        hlcp._violation,
        *rest,
        step_limits.longest_step,
        step_limits.limit_ratio,
        mode_choice.choose_mode,
        trajectory_columns.imbalance,
    )


def _start_second_process(kernels: Sequence[Linked]) -> subprocess.Popen | None:
    """Start a process that compiles kernels from the last to the first; None if it cannot be started.

    Its output is discarded: if a kernel cannot be compiled, this process comes to it, too, and reports the error.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        names = [kernel.name for kernel in reversed(kernels)]
        return subprocess.Popen(
            [sys.executable or "", "-m", __name__, str(os.getpid()), *names],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError:
        return None


def _compile_for_parent(parent: int, names: Sequence[str]) -> None:
    """Compile kernels until one is on disk already, or until the parent process has ended.

    Parameters
    ----------
    parent
        Identifier of the parent process, which compiles the kernels in the opposite order.
    names
        Full names of the kernels.
    """
    for name in names:
        module, _, function = name.rpartition(".")
        kernel = getattr(import_module(module), function)
        if kernel.is_kept or os.getppid() != parent:
            return
        kernel.link()


if __name__ == "__main__":
    _compile_for_parent(int(sys.argv[1]), sys.argv[2:])
