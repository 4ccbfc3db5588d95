"""Work of `stiction run` in its child process, which does not import the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stiction.engines.registry import load_engine
from stiction.scenes import InputError, Scene, Trajectory


def run_as_asked(
    engine: str, scene: Scene, assemble: bool, arguments: Mapping[str, Any]
) -> Trajectory | InputError:
    """Return a trajectory, or the error if the input is wrong, which is not a failure of the task.

    If `assemble` is true, the start of the scene is moved onto its constraints first. The arguments are those of
    `Engine.simulate`.
    """
    from stiction.reference_impl.multibody.initial_state import with_consistent_start

    try:
        chosen = load_engine(engine)
        # The engine compiles its kernels together, in parallel. Assembling the start would compile
        # some of them first, one at a time.
        chosen.prepare_run(scene, **arguments)
        return chosen.simulate(with_consistent_start(scene, assemble), **arguments)
    except InputError as error:
        return error
