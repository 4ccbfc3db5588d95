"""Creep of a capsule between two pads, as MuJoCo has it here and as others published it.

It is an anchor outside of this suite: its model, its numbers and its engine are not ours. The listing of the model and
the numbers are in ``comparisons/data/published_creep.toml`` with their sources; what could not be read there, and was
chosen to meet some of the numbers, is named there as matched.
"""

from __future__ import annotations

import tomllib
from decimal import Decimal
from functools import partial
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from stiction.engines.isolation import Task
from stiction.engines.registry import load_engine

PUBLISHED, CREEP, UNCERTAINTY, MATCHED = "published [um/s]", "creep [um/s]", "uncertainty [um/s]", "matched"


def last_digit(published: float) -> float:
    """Return one unit of the last digit of a printed number that is not 0: of 1500 it is 100, of 1.4 it is 0.1."""
    return float(Decimal(1).scaleb(int(Decimal(repr(published)).normalize().as_tuple().exponent)))


def published_creep() -> pd.DataFrame:
    """Run all published cases in MuJoCo; some seconds.

    Returns
    -------
    DataFrame
        A row a case: `case`, `published [um/s]` with `last digit [um/s]`, `creep [um/s]` downwards with its
        `uncertainty [um/s]` (between ends and least squares of the same 2 s, which differ by what rocks), `ratio` of
        creep to published, `load [N]` of both pads and `published load [N]`, `margin` (Coulomb's limit over weight),
        `matched` (True where the case had part in the choice of what the source does not say), `source`, `version`.

    Raises
    ------
    EngineMissing
        If MuJoCo is not installed.
    """
    data = _data()
    version = load_engine(data["engine"]).version
    model = data["model"] | data["matched"]
    rows = []
    for case in data["cases"]:
        published = case.get("published_um_s", np.nan)
        creep, uncertainty, load = _measured(model, **case["options"])
        rows.append({"case": case["name"], PUBLISHED: published,
                     "last digit [um/s]": last_digit(published) if published > 0 else np.nan, CREEP: creep,
                     UNCERTAINTY: uncertainty, "ratio": creep / published, "load [N]": load,
                     "published load [N]": case.get("published_N", np.nan),
                     "margin": model["friction"][0] * load / (model["capsule_mass"] * model["gravity"]),
                     MATCHED: case.get("matched", False), "source": case["source"], "version": version})
    return pd.DataFrame(rows)


def published_engine() -> str:
    """Return the engine whose creep was published."""
    return str(_data()["engine"])


def _data() -> dict[str, Any]:
    file = resources.files("stiction.comparisons") / "data" / "published_creep.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def published_creep_task() -> Task:
    """Return `published_creep` as a task of the runner."""
    return Task("hold/published creep", published_creep)


def _grasp(model: dict[str, Any], *, cone: str = "elliptic", impratio: float, noslip_iterations: int = 0,
           condim: int | None = None, stiff: bool = False) -> Any:
    """The model compiled: pads on slides along x, squeezed by position actuators, and a free capsule along y."""
    import mujoco

    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.gravity = model["timestep"], [0.0, 0.0, -model["gravity"]]
    option.cone = {"elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC, "pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL}[cone]
    option.impratio, option.noslip_iterations = impratio, noslip_iterations
    surface = {"friction": model["friction"], "condim": condim or model["condim"]}
    if stiff:
        surface["solref"] = [model["stiff_time_constant"], 1.0]
    for side in (-1.0, 1.0):
        pad, name = spec.worldbody.add_body(pos=[side * model["pad_distance"], 0.0, 0.0]), f"slide{side:+g}"
        pad.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-side, 0.0, 0.0],
                      damping=[model["pad_damping"]] * 3)
        pad.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=model["pad_half_size"], mass=model["pad_mass"], **surface)
        spec.add_actuator(target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_position(kp=model["stiffness"])
    capsule = spec.worldbody.add_body(name="capsule")
    capsule.add_freejoint()
    capsule.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, mass=model["capsule_mass"], quat=[1.0, 1.0, 0.0, 0.0],
                     size=[model["capsule_radius"], model["capsule_half_length"], 0.0], **surface)
    return spec.compile()


def _measured(model: dict[str, Any], **options: Any) -> tuple[float, float, float]:
    """Creep downwards and its uncertainty, um/s, and the mean load of both pads, N."""
    import mujoco

    compiled = _grasp(model, **options)
    data, height = mujoco.MjData(compiled), compiled.joint(compiled.body("capsule").jntadr[0]).qposadr[0] + 2
    data.ctrl[:] = model["target"]
    step = partial(mujoco.mj_step, compiled, data)
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
    return 1e6 * between_ends, 1e6 * abs(between_ends - fitted), float(np.mean(loads))
