"""A hinge that dry friction holds: a model whose creep users of MuJoCo and its ports have published."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def hinge_creep(model: Mapping[str, Any], **options: Any) -> tuple[float, float]:
    """Measure the speed of a body on a hinge under a torque, and its change in the last fifth of the run, rad/s.

    Parameters
    ----------
    model
        Inertia, friction, step and times in SI units, by the names of ``comparisons/data/published_joint_creep.toml``.
    **options
        Those of `_hinge`: torque, noslip_iterations, and the time constant of ``solreffriction``.
    """
    import mujoco

    compiled = _hinge(model, **options)
    data = mujoco.MjData(compiled)
    data.qfrc_applied[0] = options["torque"]
    steps = round(model["measured"] / model["timestep"])
    before_last_fifth = steps - steps // 5
    for _ in range(before_last_fifth):
        mujoco.mj_step(compiled, data)
    earlier = float(data.qvel[0])
    for _ in range(steps - before_last_fifth):
        mujoco.mj_step(compiled, data)
    return float(data.qvel[0]), abs(float(data.qvel[0]) - earlier)


def _hinge(
    model: Mapping[str, Any],
    *,
    torque: float,
    noslip_iterations: int = 0,
    time_constant: float | None = None,
) -> Any:
    """Compile the model: one body on a hinge with ``frictionloss``, without gravity. The caller applies `torque`."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = model["timestep"], [0.0, 0.0, 0.0]
    spec.option.noslip_iterations = noslip_iterations
    body = spec.worldbody.add_body(
        mass=1.0, ipos=[0.0, 0.0, 0.0], inertia=[model["inertia"]] * 3, explicitinertial=True
    )
    joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
    joint.frictionloss = model["friction"]
    if time_constant is not None:
        joint.solref_friction = [time_constant, 1.0]
    return spec.compile()
