"""Changes of a motion by clearance in its guides: a run with contacts in a gap against the run with ideal joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from stiction.comparisons.bench.variants import Variant, has_static_coefficient
from stiction.comparisons.measures.corner_gaps import (
    contact_shares,
    corner_gaps,
    guides_with_gaps,
    impacts_in,
    require_corners,
)
from stiction.engines.joint_effects import with_ideal_guides
from stiction.engines.protocol import EngineFailure
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.registry import load_engine
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import Scene, Trajectory, vary
from stiction.scenes.fidelity import Fidelity
from stiction.truths.physics import physics_of

IDEAL_RTOL = 1e-10
"""Relative tolerance of the run with ideal joints, whose error is far below any effect of a clearance."""
IDEAL_SAMPLES = 10_000
"""Number of samples of the run with ideal joints.

Linear interpolation of a sine of p periods between them errs by 5e-8 p^2 of its amplitude.
"""
LANDING = 0.2
"""Time at the start that is left out, s: the slider starts in the middle of its gap, falls and comes to rest.

At a clearance of 1 cm the fall lasts 0.045 s under gravity.
"""
LANDING_SHARE = 0.1
"""Largest part of a run that is left out for the landing.

It limits the time left out of runs of less than 2 s, which would lose most of their motion.
"""
PEAK_WINDOW = 1e-3
"""Time over which the effort is averaged for a peak that does not depend on the step, s.

An impact of rigid bodies is an impulse, whose effort in a single step is inversely proportional to the step. Motors
do not respond to changes that are faster than about a millisecond.
"""
NUDGE = 1e-6
"""Largest change of each velocity (m/s or rad/s) at a perturbed start, relative to the largest velocity of the scene.

If all velocities are zero, it is the absolute change. It is far below any effect of a clearance, so that runs differ
noticeably only where the motion is sensitive to its start.
"""


@dataclass(frozen=True)
class GapRun:
    """A run with clearance, to be compared with ideal joints.

    Attributes
    ----------
    scene : Scene
        The scene as it is declared.
    clearance, restitution : float
        Gap to each surface (m) and coefficient of restitution of all guides with a length and a width.
    variant : Variant
        The method, of contact fidelity and with a fixed step.
    step : float
        Step, s.
    t_end : float
        End of the run, s.
    start : int
        0 for the start of the scene, otherwise the number of a perturbed start.
    """

    scene: Scene
    clearance: float
    restitution: float
    variant: Variant
    step: float
    t_end: float
    start: int = 0

    @property
    def key(self) -> str:
        """Unique name of the run."""
        start = f", start {self.start}" if self.start else ""
        return (
            f"clearance/{self.scene.name}/{self.variant.label}/c={self.clearance:g}, "
            f"e={self.restitution:g}, dt={self.step:g}, t_end={self.t_end:g}{start}"
        )

    @property
    def simulated_scene(self) -> Scene:
        """The scene with its gaps, with the coefficients of friction that the engine represents."""
        scene = physics_of(self.scene, has_static_coefficient(self.variant))
        return nudged(with_gaps(scene, self.clearance, self.restitution), self.start)

    def simulate(self) -> Trajectory:
        """Return the run, with an output at each step.

        Raises
        ------
        EngineFailure
            If the run ended early.
        """
        run = load_engine(self.variant.engine).simulate(
            self.simulated_scene,
            dt=self.step,
            output_step=self.step,
            t_end=self.t_end,
            fidelity=Fidelity.CONTACT,
            **self.variant.settings,
        )
        if run.termination != "end":
            raise EngineFailure(run.termination)
        return run

    def ideal_run(self) -> Trajectory:
        """Return the run of the reference with ideal joints and the same friction.

        Raises
        ------
        EngineFailure
            If it ended early.
        """
        scene = with_ideal_guides(physics_of(self.scene, has_static_coefficient(self.variant)))
        return _ideal_run(_IdealMotion(scene.to_toml(), self.t_end, scene))


@dataclass(frozen=True)
class _IdealMotion:
    """The key of the cache of runs with ideal joints: the contents of a scene as text, and the end of the run, s."""

    text: str
    t_end: float
    scene: Scene = field(compare=False)


@lru_cache(maxsize=4)
def _ideal_run(motion: _IdealMotion) -> Trajectory:
    """Return the run of the reference with ideal joints; a child process makes it once for several gaps and steps."""
    run = ReferenceEngine().simulate(
        motion.scene,
        rtol=IDEAL_RTOL,
        t_end=motion.t_end,
        output_step=motion.t_end / IDEAL_SAMPLES,
    )
    if run.termination != "end":
        raise EngineFailure(f"reference with ideal joints: {run.termination}")
    return run


def with_gaps(scene: Scene, clearance: float, restitution: float = 0.0) -> Scene:
    """Return a scene whose guides with a length and a width have a clearance (m) and a restitution.

    Raises
    ------
    InputError
        If the scene has no such guide.
    """
    guides = require_corners(scene)
    changes = {f"{name}.clearance": clearance for name in guides}
    changes |= {f"{name}.restitution": restitution for name in guides}
    return vary(scene, changes)


def nudged(scene: Scene, number: int) -> Scene:
    """Return a scene with randomly changed velocities at the start; the scene itself for the number 0.

    The changes, of the size `NUDGE`, are projected onto the constraints. `number` is the seed of the random numbers.
    """
    if number == 0:
        return scene
    generator = np.random.default_rng(number)
    speeds = [abs(part) for body in scene.bodies.values() for part in body.velocity]
    spins = [abs(body.angular_velocity) for body in scene.bodies.values()]
    size = NUDGE * (max(*speeds, *spins) or 1.0)
    changes: dict[str, Any] = {}
    for name, body in scene.bodies.items():
        change_x, change_y, change_spin = size * generator.uniform(-1.0, 1.0, 3)
        x, y = body.velocity
        changes[f"bodies.{name}.velocity"] = [float(x + change_x), float(y + change_y)]
        changes[f"bodies.{name}.angular_velocity"] = float(body.angular_velocity + change_spin)
    return with_consistent_start(vary(scene, changes), assemble=True)


def clearance_effect(run: GapRun) -> dict[str, Any]:
    """Simulate a run with clearance, and return the columns of its difference from ideal joints.

    Returns
    -------
    dict
        ``slider_change``: largest difference of the displacement of a slider along its guide, m.
        ``effort_share``: mean size of the difference of the first drive's effort over the mean size of the ideal
        effort. ``effort_rms``: root mean square of this difference over that of the ideal effort. ``effort_peak``:
        largest effort over the largest ideal one. ``effort_peak_mean``: the same of the effort averaged over
        `PEAK_WINDOW`. ``flight_share``, ``one_corner_share``, ``adjacent_share``, ``opposite_share``: parts of the
        time, see `ContactShares`. ``largest_overlap``: largest depth of a corner in its surface, m.
        ``impact_count``: number of impacts. ``impact_speed``: largest speed of an impact, m/s. ``window_begin``,
        ``window_end``: the part of the run from which all these are computed, s. ``cpu_time``: CPU time of the steps,
        s. ``version``: version of the engine.
        Efforts are absent if the scene has no drive, or if the ideal effort is zero throughout.

    Raises
    ------
    EngineFailure
        If a run ended early.
    InputError
        If no guide has a length and a width.
    """
    trajectory = run.simulate()
    ideal = run.ideal_run().to_frame(events=True, interpolated=True)
    begin = min(LANDING, LANDING_SHARE * run.t_end)
    is_inside = trajectory.t >= begin
    t = trajectory.t[is_inside]
    row: dict[str, Any] = {"window_begin": begin, "window_end": run.t_end}

    scene = run.simulated_scene
    changes = []
    for name in guides_with_gaps(scene):
        column = f"{name}.displacement"
        ideal_displacement = np.interp(t, ideal["t"], ideal[column])
        change = np.abs(trajectory[column][is_inside] - ideal_displacement)
        changes.append(float(change.max()))
    row["slider_change"] = max(changes)
    row |= _contact_columns(scene, trajectory, is_inside, run.clearance)
    drives = list(scene.drives)
    if drives:
        column = f"{drives[0]}.effort"
        # The effort at a sample is the mean over the step that ends there, and so belongs to the middle of the step.
        ideal_effort = np.interp(t - 0.5 * run.step, ideal["t"], ideal[column])
        row |= _effort_columns(trajectory[column][is_inside], ideal_effort, run.t_end - begin)
    row["cpu_time"] = trajectory.cost.stepping_s
    row["version"] = trajectory.version
    return row


def _effort_columns(effort: np.ndarray, ideal: np.ndarray, length: float) -> dict[str, float]:
    """Return the differences of an effort from the ideal one, relative to the latter; empty if the latter is zero.

    Both have the shape (samples,) and cover a window of a length, s.
    """
    if not np.any(ideal):
        return {}
    difference = effort - ideal
    window = max(1, round(len(effort) * PEAK_WINDOW / length))
    means = np.convolve(effort, np.full(window, 1.0 / window), mode="valid")
    return {
        "effort_share": float(np.mean(np.abs(difference)) / np.mean(np.abs(ideal))),
        "effort_rms": float(np.sqrt(np.mean(difference**2) / np.mean(ideal**2))),
        "effort_peak": float(np.max(np.abs(effort)) / np.max(np.abs(ideal))),
        "effort_peak_mean": float(np.max(np.abs(means)) / np.max(np.abs(ideal))),
    }


def _contact_columns(
    scene: Scene, trajectory: Trajectory, is_inside: np.ndarray, clearance: float
) -> Mapping[str, float]:
    """Return parts of the time by contact, overlap and impacts of all sliders in the samples inside the window.

    With several sliders each part of the time is the largest among the sliders, and impacts are those of all sliders.
    """
    shares = []
    overlaps = []
    speeds = []
    for name in guides_with_gaps(scene):
        gaps = corner_gaps(scene, trajectory, name)[:, is_inside]
        shares.append(contact_shares(gaps, clearance))
        overlaps.append(max(0.0, -float(gaps.min())))
        impacts = impacts_in(trajectory.t[is_inside], gaps, clearance)
        speeds += [impact.speed for impact in impacts]
    return {
        "flight_share": max(share.none for share in shares),
        "one_corner_share": max(share.one for share in shares),
        "adjacent_share": max(share.adjacent for share in shares),
        "opposite_share": max(share.opposite for share in shares),
        "largest_overlap": max(overlaps),
        "impact_count": len(speeds),
        "impact_speed": max(speeds, default=0.0),
    }
