"""Energies of a motion, and the work of all that adds energy to the mechanism or takes it away."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from stiction.reference_impl.equations_of_motion import (
    EquationsOfMotion,
    Motion,
    one_sided_tension,
)
from stiction.scenes import InputError, Scene, Trajectory
from stiction.scenes.column_file import row_slices
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fields import GROUND
from stiction.scenes.model import Force, Revolute, Spring
from stiction.scenes.trajectory import stacked

TOUCHES = 1e-9
"""Stretch of a spring, relative to the largest, up to which it is at its contact."""
AT_ONCE = 2**15
"""Instants whose energies are found together: positions and Jacobians of all bodies there take some megabytes."""


def energies(run: Trajectory) -> pd.DataFrame:
    """Return the energies of a run and the work of each load, drive, damper and frictional joint.

    Parameters
    ----------
    run
        A trajectory with its scene.

    Returns
    -------
    DataFrame
        One row per output time and two per event, all columns but ``t`` in J:

        - ``kinetic``, ``potential``: energies of the mechanism; potential energy is that of weight and springs;
        - ``NAME.work``: work done on the mechanism by each load and drive since the first row;
        - ``NAME.dissipated``: energy dissipated by each damper and each joint with friction or damping since the first
          row;
        - ``balance``: change of kinetic and potential energy, minus the work, plus the dissipated energy. It is zero
          for an exact motion, up to the error of the trapezoidal rule by which powers are integrated.

    Raises
    ------
    InputError
        If the trajectory lacks its scene, or columns of states, efforts or frictions.
    """
    if run.mechanism is None:
        raise InputError(
            f"mechanism: found None; expected a trajectory that knows its scene, {run.scene}"
        )
    frame = run.to_frame(events=True, interpolated=True)
    return energy_columns(
        run.mechanism, frame["t"].to_numpy(), {name: frame[name].to_numpy() for name in frame}
    )


def energy_columns(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Return `energies` of a motion: times that do not decrease, and `needed_columns`, each of shape (n,).

    An instant that occurs twice has both sides of a jump.
    """
    if missing := [name for name in needed_columns(scene) if name not in columns]:
        raise InputError(
            f"columns: found no {', '.join(missing)}; expected states, efforts and frictions"
        )
    found = _rates(scene, t, columns)
    lost = sum(
        [*(-power for power in found.powers.values()), *found.losses.values()], np.zeros(len(t))
    )
    works = {
        name: cumulative_trapezoid(power, t, initial=0)
        for name, power in {**found.powers, **found.losses}.items()
    }
    energy = found.kinetic + found.potential
    return pd.DataFrame(
        {
            "t": t,
            "kinetic": found.kinetic,
            "potential": found.potential,
            **works,
            "balance": energy - energy[:1] + cumulative_trapezoid(lost, t, initial=0),
        }
    )


@dataclass(frozen=True)
class _Rates:
    """Energies (J) at instants, and what changes them (W), by the names of `energies`; all of shape (n,)."""

    kinetic: np.ndarray
    potential: np.ndarray
    powers: Mapping[str, np.ndarray]
    losses: Mapping[str, np.ndarray]


def _rates(scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> _Rates:
    """Energies and powers at instants, each from the columns at that instant alone."""
    q, v = (stacked(columns, scene.bodies, labels) for labels in BODY_COLUMNS[:2])
    mass, motion = EquationsOfMotion(scene).mass, Motion(list(scene.bodies), t, q, v)
    kinetic = v**2 @ mass / 2
    potential = (
        -(q.reshape(len(t), -1, 3)[:, :, :2] @ np.array(scene.gravity or (0.0, 0.0))) @ mass[::3]
    )
    powers, losses = {}, {}
    for name, spring in scene.springs_and_dampers.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            # ends that meet have no direction, nor a rate: nan
            length = motion.coordinate(spring)
        stretch = length.value - spring.rest
        if spring.acts is None:
            potential = potential + spring.stiffness / 2 * stretch**2
            if spring.damping:
                losses[f"{name}.dissipated"] = spring.damping * length.rate**2
            continue
        # What is stretched while its damper keeps the spring from acting gives its energy to the damper, so that the
        # loss is what the spring gives and the bodies do not get.
        elastic = np.where(spring.side * stretch > 0.0, spring.stiffness * stretch, 0.0)
        potential = potential + elastic * stretch / 2
        if spring.damping:
            tension = _two_sided_tension(spring, t, stretch, length.rate)
            losses[f"{name}.dissipated"] = (tension - elastic) * length.rate
    for name, load in scene.forces.items():
        if isinstance(load, Force):
            way = motion.direction(GROUND, load.direction).dot(motion.point(load.body, load.point))
        else:
            way = motion.angle(load.body)
        powers[f"{name}.work"] = motion.law(load.law).value * way.rate
    for name, drive in scene.drives.items():
        # the coordinate of a drive that gives way does not follow its law
        followed = motion.coordinate(drive) if drive.is_limited else motion.law(drive.law)
        powers[f"{name}.work"] = columns[f"{name}.effort"] * followed.rate
    for name, joint in scene.frictional_joints.items():
        if isinstance(joint, Revolute):
            slip = (motion.angle(joint.bodies[0]) - motion.angle(joint.bodies[1])).rate
        else:
            arm = motion.between(joint.bodies, (joint.slider_point, joint.point))
            slip = motion.direction(joint.guide, joint.direction).dot(arm).rate
        by_damping = losses.get(f"{name}.dissipated", 0.0)
        losses[f"{name}.dissipated"] = by_damping - columns[f"{name}.friction"] * slip
    return _Rates(kinetic, potential, powers, losses)


def _two_sided_tension(
    spring: Spring, t: np.ndarray, stretch: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """Return the tension (n,) of a damped spring that acts on one side, on both sides of its contacts.

    It jumps where the spring comes into contact. An instant that occurs twice has the values before the contact, where
    there is no tension, and those behind it, where there is that of the damper.
    """
    tension = one_sided_tension(spring, stretch, rate)
    touches = np.abs(stretch) <= TOUCHES * np.max(np.abs(stretch), initial=0.0)
    comes_closer = touches & (spring.side * rate > 0.0)
    is_behind = np.diff(t, prepend=-np.inf) == 0.0
    is_before = np.append(is_behind[1:], False)
    tension = np.where(comes_closer & is_before, 0.0, tension)
    return np.where(comes_closer & is_behind, spring.damping * rate, tension)


def unaccounted_energy(
    scene: Scene, t: np.ndarray, columns: Mapping[str, np.ndarray]
) -> tuple[float, float, float]:
    """Return, in J, the largest balance of `energy_columns`, its uncertainty, and all that the kinetic energy changed.

    The balance is unsure by its difference to that of every other row. Parameters are as of `energy_columns`.
    """
    jumps = np.diff(t, prepend=-np.inf) == 0  # of which both sides are kept
    half = np.flatnonzero((np.arange(len(t)) % 2 == 0) | jumps | np.append(jumps[1:], True))
    kinetic, energy, lost = np.empty((3, len(t)))
    for part in row_slices(len(t), AT_ONCE):
        found = _rates(
            scene, t[part], {name: columns[name][part] for name in needed_columns(scene)}
        )
        kinetic[part], energy[part] = found.kinetic, found.kinetic + found.potential
        lost[part] = sum(
            [*(-power for power in found.powers.values()), *found.losses.values()],
            np.zeros(len(kinetic[part])),
        )
    balance = energy - energy[:1] + cumulative_trapezoid(lost, t, initial=0)
    coarse = energy[half] - energy[:1] + cumulative_trapezoid(lost[half], t[half], initial=0)
    changes = np.sum(np.abs(np.diff(kinetic)))
    return (
        float(np.max(np.abs(balance))),
        float(np.max(np.abs(balance[half] - coarse))),
        float(changes),
    )


def needed_columns(scene: Scene) -> list[str]:
    """Names of the columns that the energies take: states, efforts of drives, friction of joints."""
    states = [
        f"{body}.{label}"
        for body in scene.bodies
        for labels in BODY_COLUMNS[:2]
        for label in labels
    ]
    return [
        *states,
        *(f"{name}.effort" for name in scene.drives),
        *(f"{name}.friction" for name in scene.frictional_joints),
    ]
