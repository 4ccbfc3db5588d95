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
)
from stiction.engines.joint_effects import with_ideal_guides
from stiction.engines.protocol import EngineFailure
from stiction.engines.reference.engine import ReferenceEngine
from stiction.engines.registry import load_engine
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import InputError, Scene, Trajectory, vary
from stiction.scenes.fidelity import Fidelity
from stiction.truths.physics import physics_of

IDEAL_RTOL = 1e-10
"""Relative tolerance of the run with ideal joints, whose error is far below any effect of a clearance."""
IDEAL_SAMPLES = 10_000
"""Number of samples of the run with ideal joints: linear interpolation between them errs by 1e-7 of the range."""
LANDING = 0.2
"""Time at the start that is left out, s: the slider starts in the middle of its gap, falls and comes to rest.

The fall through a gap of 1 cm lasts 0.045 s under gravity.
"""
LANDING_SHARE = 0.1
"""Largest part of a run that is left out for the landing: motions that are over in less than 2 s are mostly impacts."""
PEAK_WINDOW = 1e-3
"""Time over which the effort is averaged for a peak that does not depend on the step, s.

An impact of rigid bodies is an impulse, whose effort in a single step is inversely proportional to the step. Motors
respond within milliseconds.
"""
NUDGE = 1e-6
"""Change of the velocities at the start of a perturbed run, of the largest of them; in m/s and rad/s if all are zero.

It is far below any effect of a clearance, and grows by sensitivity alone.
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
    guides = guides_with_gaps(scene)
    if not guides:
        raise InputError(
            f"{scene.name}: joints: found no guide with length and width; expected one, whose slider has corners"
        )
    changes = {f"{name}.clearance": clearance for name in guides}
    changes |= {f"{name}.restitution": restitution for name in guides}
    return vary(scene, changes)


def nudged(scene: Scene, number: int) -> Scene:
    """Return a scene with velocities at the start that differ by `NUDGE`; the scene itself for the number 0.

    The random changes are projected onto the constraints.
    """
    if number == 0:
        return scene
    dice = np.random.default_rng(number)
    speeds = [abs(part) for body in scene.bodies.values() for part in body.velocity]
    spins = [abs(body.angular_velocity) for body in scene.bodies.values()]
    size = NUDGE * (max(*speeds, *spins) or 1.0)
    changes: dict[str, Any] = {}
    for name, body in scene.bodies.items():
        along, across, turn = size * dice.uniform(-1.0, 1.0, 3)
        x, y = body.velocity
        changes[f"bodies.{name}.velocity"] = [float(x + along), float(y + across)]
        changes[f"bodies.{name}.angular_velocity"] = float(body.angular_velocity + turn)
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
        ``impact_count``, and ``impact_speed`` (largest, m/s). ``window_begin``, ``window_end``: the part of the run
        that they are about, s.
        Efforts are absent from a scene without drives.

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
    guides = guides_with_gaps(scene)
    row["slider_change"] = max(
        float(
            np.max(
                np.abs(
                    trajectory[f"{name}.displacement"][is_inside]
                    - np.interp(t, ideal["t"], ideal[f"{name}.displacement"])
                )
            )
        )
        for name in guides
    )
    row |= _contact_columns(scene, trajectory, is_inside)
    drives = list(scene.drives)
    if drives:
        column = f"{drives[0]}.effort"
        # The effort of a step is its mean over the step that ends at the sample.
        exact = np.interp(t - 0.5 * run.step, ideal["t"], ideal[column])
        row |= _effort_columns(trajectory[column][is_inside], exact, run.t_end - begin)
    row["cpu_time"] = trajectory.cost.stepping_s
    row["version"] = trajectory.version
    return row


def _effort_columns(effort: np.ndarray, ideal: np.ndarray, length: float) -> dict[str, float]:
    """Return the differences of an effort from the ideal one, relative to the latter.

    Both have the shape (samples,) and cover a window of a length, s.
    """
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
    scene: Scene, trajectory: Trajectory, is_inside: np.ndarray
) -> Mapping[str, float]:
    """Return parts of the time by contact, overlap and impacts of all sliders in the samples inside the window.

    With several sliders each part is the largest of them.
    """
    shares = []
    overlaps = []
    speeds = []
    for name in guides_with_gaps(scene):
        clearance = scene.guides[name].clearance or 0.0
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
