"""A capsule that two pads grasp: a model whose creep users of MuJoCo have published."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

_MICROMETRES = 1e6
"""Micrometres in a metre."""


def creep_and_load(model: Mapping[str, Any], **options: Any) -> tuple[float, float, float]:
    """Measure the creep of the capsule downwards and its uncertainty, um/s, and the mean load of both pads, N.

    The creep is the mean speed between the ends of the measured time. The uncertainty is its difference from the slope
    by least squares, which is caused by rocking of the capsule.

    Parameters
    ----------
    model
        Sizes, masses, stiffness and times in SI units, by the names of ``comparisons/data/published_creep.toml``.
    **options
        Those of `_grasp`: cone, impratio, noslip_iterations, condim, and whether contacts are stiff.
    """
    import mujoco

    compiled = _grasp(model, **options)
    data = mujoco.MjData(compiled)
    # z is the third coordinate of the capsule's free joint
    height = compiled.joint(compiled.body("capsule").jntadr[0]).qposadr[0] + 2
    data.ctrl[:] = model["target"]
    step = partial(mujoco.mj_step, compiled, data)
    # The pads close and the capsule comes to its steady creep before anything is measured.
    for _ in range(round(model["settle"] / model["timestep"])):
        step()
    heights, loads, force = [data.qpos[height]], [], np.zeros(6)
    for _ in range(round(model["measured"] / model["timestep"])):
        step()
        heights.append(data.qpos[height])
        loads.append(0.0)
        for contact in range(data.ncon):
            mujoco.mj_contactForce(compiled, data, contact, force)
            loads[-1] += force[0]
    t = model["timestep"] * np.arange(len(heights))
    between_ends, fitted = (heights[0] - heights[-1]) / t[-1], -np.polyfit(t, heights, 1)[0]
    return (
        _MICROMETRES * between_ends,
        _MICROMETRES * abs(between_ends - fitted),
        float(np.mean(loads)),
    )


def _grasp(
    model: Mapping[str, Any],
    *,
    cone: str = "elliptic",
    impratio: float,
    noslip_iterations: int = 0,
    condim: int | None = None,
    stiff: bool = False,
) -> Any:
    """Compile the model: pads on slides along x, squeezed by position actuators, and a free capsule along y."""
    import mujoco

    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.gravity = model["timestep"], [0.0, 0.0, -model["gravity"]]
    option.cone = {
        "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC,
        "pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL,
    }[cone]
    option.impratio, option.noslip_iterations = impratio, noslip_iterations
    surface = {"friction": model["friction"], "condim": condim or model["condim"]}
    if stiff:
        surface["solref"] = [model["stiff_time_constant"], 1.0]
    for side in (-1.0, 1.0):
        pad = spec.worldbody.add_body(pos=[side * model["pad_distance"], 0.0, 0.0])
        name = f"slide{side:+g}"
        pad.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[-side, 0.0, 0.0],
            damping=[model["pad_damping"]] * 3,
        )
        pad.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=model["pad_half_size"],
            mass=model["pad_mass"],
            **surface,
        )
        spec.add_actuator(target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_position(
            kp=model["stiffness"]
        )
    capsule = spec.worldbody.add_body(name="capsule")
    capsule.add_freejoint()
    capsule.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        mass=model["capsule_mass"],
        quat=[1.0, 1.0, 0.0, 0.0],
        size=[model["capsule_radius"], model["capsule_half_length"], 0.0],
        **surface,
    )
    return spec.compile()
