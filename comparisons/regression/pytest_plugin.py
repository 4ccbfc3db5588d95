"""A plugin of pytest that makes any scene a test, in any repository that has stiction installed.

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
    """Simulate a scene with an engine and measure: ``stiction_scene(scene, engine, dt=.. or rtol=.., **options)``.

    Parameters of the call
    ----------------------
    scene : str
        A name of the catalogue, or a TOML file in the folder of the test.
    engine : str
        A name or ``module:Class``.
    dt, rtol : float
        One of them: step (s) or relative tolerance.
    fidelity : str, optional
        ``"joint"``, which is meant where it is not given, or ``"contact"``.
    overrides : Mapping, optional
        Values of the scene to replace, as ``--set`` does.
    timeout_s : float, optional
        Seconds that the run may take, 120 if not given. It happens in a child process.
    **settings
        Of the engine.

    Returns
    -------
    dict of float
        Errors against the best truth there is, events, drift and counters, as far as scene and engine have them:
        ``"position_error"``, ``"velocity_error"``, ``"torque_error"``,
        ``"event_time_error"``, ``"events_missed"``, ``"position_drift"``, ``"steps"``, ..

    A run that fails, or ends early, fails the test with the engine's own words.
    """
    return lambda scene, engine, **options: _numbers(scene, engine, request.path.parent, **options)


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
    # imported here: pytest loads this module in every run of every project on the machine
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
    compile_kernels()  # here, lest the child does it within its time limit
    [outcome] = isolate(
        [task_of(run, ("accuracy", "event", "drift", "counter"), 1)], workers=1, timeout_s=timeout_s
    )
    row = row_of(run, outcome)
    if row.status != Status.OK or row.reason:
        pytest.fail(f"{row.key}: {row.status.label}: {row.reason}", pytrace=False)
    return {metric.name: metric.value for metric in row.metrics}
