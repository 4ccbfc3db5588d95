"""Plugin of pytest with which a test can simulate a scene, in any repository that has stiction installed.

For example::

    def test_slider_bar(stiction_scene):
        numbers = stiction_scene("slider-bar-case-1", "my_solver:MySolver", dt=1e-3)
        assert numbers["position_error"] < 1e-4
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def stiction_scene(request: pytest.FixtureRequest) -> Callable[..., dict[str, float]]:
    """Return a function that simulates a scene with an engine, and measures the result.

    It is called as ``stiction_scene(scene, engine, dt=.., **options)``, or with ``rtol`` instead of ``dt``.

    Parameters of the call
    ----------------------
    scene : str
        Name of a scene of the catalogue, or of a TOML file in the folder of the test.
    engine : str
        Name of an engine, or ``module:Class``.
    dt, rtol : float
        Step (s) or relative tolerance; exactly one of them must be given.
    fidelity : str, optional
        ``"joint"`` (default) or ``"contact"``.
    overrides : Mapping, optional
        Values of the scene to replace, as with ``--set``.
    timeout_s : float, optional
        Time that the run may take, s; 120 by default. It takes place in a child process.
    **settings
        Settings of the engine.

    Returns
    -------
    dict of float
        Errors against the best available truth, events, drift and counters, as far as the scene and the engine have
        them, by name: ``"position_error"``, ``"velocity_error"``, ``"torque_error"``, ``"event_time_error"``,
        ``"events_missed"``, ``"position_drift"``, ``"steps"``, ..

    If the run fails or ends early, the test fails with the reason that the engine gives.
    """
    folder = request.path.parent

    def simulate(scene: str, engine: str, **options: Any) -> dict[str, float]:
        return _numbers(scene, engine, folder, **options)

    return simulate


def _numbers(
    scene: str,
    engine: str,
    folder: Path,
    *,
    dt: float | None = None,
    rtol: float | None = None,
    fidelity: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    timeout_s: float = 120.0,
    **settings: Any,
) -> dict[str, float]:
    """Return the numbers of a run; scenes that are not in the catalogue are files in a folder."""
    # Imported here, because pytest loads this module in each run of each project that has stiction
    # installed.
    from stiction.comparisons.bench.planned_runs import PlannedRun, row_of
    from stiction.comparisons.bench.variants import Variant
    from stiction.comparisons.regression.measurement import task_of
    from stiction.engines import isolate
    from stiction.engines.reference.engine import compile_kernels
    from stiction.engines.status import Status
    from stiction.scenes import Fidelity, InputError, catalogue, load_scene
    from stiction.scenes.fidelity import fidelity_of

    if dt is not None and rtol is None:
        parameter, step = "dt", dt
    elif rtol is not None and dt is None:
        parameter, step = "rtol", rtol
    else:
        raise InputError(
            f"dt, rtol: found {dt}, {rtol}; expected one of them: a fixed step in seconds or a tolerance"
        )
    loaded = load_scene(scene if scene in catalogue() else folder / scene, overrides)
    modelled = Fidelity.JOINT if fidelity is None else fidelity_of(fidelity)
    variant = Variant(engine, engine, parameter, (step,), modelled, settings)
    run = PlannedRun(loaded, variant, step)
    # Compiled here, so that it does not count towards the time limit of the child.
    compile_kernels()
    [outcome] = isolate(
        [task_of(run, ("accuracy", "event", "drift", "counter"), 1)], workers=1, timeout_s=timeout_s
    )
    row = row_of(run, outcome)
    if row.status != Status.OK or row.reason:
        pytest.fail(f"{row.key}: {row.status.label}: {row.reason}", pytrace=False)
    return {metric.name: metric.value for metric in row.metrics}
