"""Scenes that start where a run has ended."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from stiction.scenes.base_errors import InputError
from stiction.scenes.laws import shifted_law
from stiction.scenes.loading import scene_from_dict
from stiction.scenes.model import Scene
from stiction.scenes.trajectory import Trajectory
from stiction.scenes.wording import names


def continued(scene: Scene, run: Trajectory | str | Path) -> Scene:
    """Return a scene that starts in the last state of a run, for example after a spring has been taken away.

    Time starts again at 0 with the end of the run. The laws of time go on from there: at t = 0 they have the values
    that they had at the end of the run.

    Parameters
    ----------
    scene
        The scene, with the changes that apply from now on. Its starting positions and velocities are replaced.
    run
        The run, or a table of its columns (.csv or .parquet), as `stiction run --out` and `Trajectory.save` write it.

    Raises
    ------
    InputError
        If the table cannot be read, has no row with a time, or lacks a position or velocity of a body of the scene.
    """
    time, state = _end_of(run)
    missing = [
        f"{body}.{label}"
        for body in scene.bodies
        for label in ("x", "y", "angle", "vx", "vy", "omega")
        if f"{body}.{label}" not in state
    ]
    if missing:
        origin = run.scene if isinstance(run, Trajectory) else run
        raise InputError(
            f"{origin}: found no columns {names(missing)}; expected the positions and velocities of all "
            f"bodies of {scene.name}"
        )
    tables = scene.to_dict()
    for body, table in tables["bodies"].items():
        table["position"] = [state[f"{body}.x"], state[f"{body}.y"]]
        table["angle"] = state[f"{body}.angle"]
        table["velocity"] = [state[f"{body}.vx"], state[f"{body}.vy"]]
        table["angular_velocity"] = state[f"{body}.omega"]
    for section, elements in (("drives", scene.drives), ("forces", scene.forces)):
        for name, element in elements.items():
            law = shifted_law(element.law, time)
            tables[section][name]["law"] = law.model_dump(mode="json")
    return scene_from_dict(tables, scene._origin, name=scene.name)


def _end_of(run: Trajectory | str | Path) -> tuple[float, Mapping[str, float]]:
    """Return the time (s) of the last row of a run, and its values by column."""
    if isinstance(run, Trajectory):
        if not len(run.t):
            raise InputError(f"{run.scene}: found a run without rows; expected one with an end")
        return float(run.t[-1]), {name: float(values[-1]) for name, values in run.columns.items()}

    import pandas as pd

    path = Path(run)
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; expected a table that `run --out` wrote") from error
    if "t" not in table or table.empty:
        raise InputError(
            f"{path}: found no row with a time t; expected a table that `run --out` wrote"
        )
    last = table.iloc[-1]
    return float(last["t"]), {str(name): float(value) for name, value in last.items()}
