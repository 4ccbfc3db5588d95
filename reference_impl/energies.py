"""Energies of a motion, and the work of all that adds energy to the mechanism or takes it away."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from stiction.reference_impl.equations_of_motion import EquationsOfMotion
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Constant, evaluate_law
from stiction.scenes.model import Drive, Force, TorsionalSpring
from stiction.scenes.trajectory import stacked

Vector = tuple[float, float]
_UNIT = 1.0
"""Length of the drives by which coordinates are measured: a distance must be positive."""


def energies(run: Trajectory) -> pd.DataFrame:
    """Return the energies of a run, `energy_columns`, one row per output time and two per event.

    Raises
    ------
    InputError
        For a trajectory without its scene, or without the columns of states, efforts or frictions.
    """
    if run.mechanism is None:
        raise InputError(f"mechanism: found None; expected a trajectory that knows its scene, {run.scene}")
    frame = run.to_frame(events=True)
    return energy_columns(run.mechanism, frame["t"].to_numpy(), {name: frame[name].to_numpy() for name in frame})


def energy_columns(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Return kinetic and potential energy, and work by its source; all in J, all works from the first row on.

    The columns are ``kinetic``; ``potential``, of weight and springs; ``NAME.work`` of each load and drive, on the
    mechanism; ``NAME.dissipated`` by each damper and frictional guide; ``balance``: kinetic and potential energy less
    their first values, less the works, plus what was dissipated. It is zero for an exact motion, but for the
    trapezoidal rule by which powers are integrated.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Not decreasing; an instant that occurs twice has both sides of a jump.
    columns : Mapping[str, ndarray]
        `needed_columns`, each of shape (n,).

    Raises
    ------
    InputError
        For a missing column.
    """
    if missing := [name for name in needed_columns(scene) if name not in columns]:
        raise InputError(f"columns: found no {', '.join(missing)}; expected states, efforts and frictions")
    q, v = (np.ascontiguousarray(stacked(columns, scene.bodies, labels)) for labels in BODY_COLUMNS[:2])
    at, rate = _coordinates(scene, t, q, v)
    mass = np.array([value for body in scene.bodies.values() for value in (body.mass, body.mass, body.inertia)])
    kinetic = v ** 2 @ mass / 2
    potential = -(q.reshape(len(t), -1, 3)[:, :, :2] @ np.array(scene.gravity or (0.0, 0.0))) @ mass[::3]
    powers, losses = {}, {}
    for name, spring in scene.springs.items():
        rest = spring.rest_angle if isinstance(spring, TorsionalSpring) else spring.rest_length
        potential = potential + spring.stiffness / 2 * (at[name] - rest) ** 2
        if spring.damping:
            losses[f"{name}.dissipated"] = spring.damping * rate[name] ** 2
    for name, load in scene.forces.items():
        powers[f"{name}.work"] = np.array([evaluate_law(load.law, time)[0] for time in t]) * rate[name]
    for name, drive in scene.drives.items():
        powers[f"{name}.work"] = columns[f"{name}.effort"] * np.array([evaluate_law(drive.law, time)[1] for time in t])
    for name in scene.frictional_guides:
        losses[f"{name}.dissipated"] = -columns[f"{name}.friction"] * rate[name]
    energy = kinetic + potential
    lost = sum([*(-power for power in powers.values()), *losses.values()], np.zeros(len(t)))
    works = {name: _integral(t, power) for name, power in {**powers, **losses}.items()}
    return pd.DataFrame({"t": t, "kinetic": kinetic, "potential": potential, **works,
                         "balance": energy - energy[:1] + _integral(t, lost)})


def unaccounted_energy(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> tuple[float, float, float]:
    """Return, in J, the largest balance of `energy_columns`, its uncertainty, and all that the kinetic energy changed.

    The balance is unsure by its difference to that of every other row. Parameters are as of `energy_columns`.
    """
    jumps = np.diff(t, prepend=-np.inf) == 0  # of which both sides are kept
    half = np.flatnonzero((np.arange(len(t)) % 2 == 0) | jumps | np.append(jumps[1:], True))
    found = energy_columns(scene, t, columns)
    coarse = energy_columns(scene, t[half], {name: columns[name][half] for name in needed_columns(scene)})
    unsure = found["balance"].to_numpy()[half] - coarse["balance"]
    changes = np.sum(np.abs(np.diff(found["kinetic"])))
    return float(found["balance"].abs().max()), float(unsure.abs().max()), float(changes)


def needed_columns(scene: Scene) -> list[str]:
    """Names of the columns that the energies take: states, efforts of drives, friction of guides."""
    states = [f"{body}.{label}" for body in scene.bodies for labels in BODY_COLUMNS[:2] for label in labels]
    return [*states, *(f"{name}.effort" for name in scene.drives),
            *(f"{name}.friction" for name in scene.frictional_guides)]


def _coordinates(scene: Scene, t: np.ndarray, q: np.ndarray,
                 v: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return by name the coordinate on which each spring, load and friction acts, and its rate.

    Each is that of a drive in the same place: the residual of its constraint, and the residual's rate.
    """
    def angle(bodies: tuple[str, str]) -> Drive:
        return Drive(type="angle", bodies=bodies, law=Constant(type="constant", value=_UNIT))

    def distance(bodies: tuple[str, str], points: tuple[Vector, Vector], axis: Vector | None) -> Drive:
        return Drive(type="distance", bodies=bodies, points=points, axis=axis,
                     law=Constant(type="constant", value=_UNIT))

    drives = {name: angle(spring.bodies) if isinstance(spring, TorsionalSpring)
              else distance(spring.bodies, spring.points, spring.axis) for name, spring in scene.springs.items()}
    drives |= {name: distance((load.body, GROUND), (load.point, (0.0, 0.0)), load.direction) if isinstance(load, Force)
               else angle((load.body, GROUND)) for name, load in scene.forces.items()}
    drives |= {name: distance(guide.bodies, (guide.slider_point, guide.point), guide.direction)
               for name, guide in scene.frictional_guides.items()}
    others = {"joints": {}, "drives": drives, "springs": {}, "forces": {}}
    with np.errstate(divide="ignore", invalid="ignore"):  # points that coincide have no direction, nor a rate: NaN
        terms = EquationsOfMotion(scene.model_copy(update=others)).at(t, q, v)
    return dict(zip(drives, (terms.phi + _UNIT).T)), dict(zip(drives, terms.phi_dot.T))


def _integral(t: np.ndarray, power: np.ndarray) -> np.ndarray:
    return np.append(0.0, np.cumsum(np.diff(t) * (power[1:] + power[:-1]) / 2))
