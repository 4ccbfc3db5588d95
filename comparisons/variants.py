"""What is compared: an engine in one fidelity with fixed settings, over a ladder of steps or tolerances."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from engines.isolation import Job, Outcome
from engines.registry import EngineMissing, engine_names, load_engine
from scenes import Scene, Trajectory, vary


@dataclass(frozen=True)
class Variant:
    """An engine with settings, over a ladder.

    Attributes
    ----------
    label : str
        Short and unique, as it stands in legends: ``"pymunk, contact"``.
    engine : str
    parameter : {"dt", "rtol"}
        What the ladder varies.
    ladder : tuple of float
        From coarse to fine.
    fidelity : str
    settings : Mapping
    stands_for : str
        The engine in whose place this one is compared with a baseline: its own if empty.
    """

    label: str
    engine: str
    parameter: str
    ladder: tuple[float, ...]
    fidelity: str = "joint"
    settings: Mapping[str, Any] = field(default_factory=dict)
    stands_for: str = ""


@dataclass(frozen=True)
class Record:
    """One run of the campaign and what became of it.

    Attributes
    ----------
    key : str
        ``"<scene>/<variant>/<parameter>=<step>"``; leads from a row of a table to the trajectory.
    variant : Variant
    step : float
        The rung of the ladder: dt (s) or rtol.
    outcome : Outcome
        Its value is the trajectory, None unless the status is ``"ok"``.
    """

    key: str
    scene: str
    variant: Variant
    step: float
    outcome: Outcome

    @property
    def trajectory(self) -> Trajectory | None:
        return self.outcome.value

    def describe(self) -> dict[str, Any]:
        """The columns that every table begins with."""
        trajectory = self.trajectory
        return {"scene": self.scene, "variant": self.variant.label, "engine": self.variant.engine,
                "version": trajectory.version if trajectory else None, "fidelity": self.variant.fidelity,
                "parameter": self.variant.parameter, "step": self.step, "status": self.outcome.status,
                "reason": self.outcome.reason or (trajectory.termination if trajectory and trajectory.termination != "end" else ""),
                "cpu [s]": trajectory.cost.stepping_s if trajectory else None,
                "settings": json.dumps(dict(trajectory.settings), default=str) if trajectory else None,
                "key": self.key}


REFERENCE_TIGHT = Variant("reference", "reference", "rtol", (1e-6, 1e-9, 1e-12), settings={"stabilization": "projection"})
REFERENCE_BAUMGARTE = Variant("reference, Baumgarte", "reference", "rtol", (1e-9,), settings={"stabilization": "baumgarte"})
PAPER = Variant("paper's scheme", "reference", "dt", (1e-2, 2.5e-3, 1e-3), settings={"method": "paper", "stabilization": "baumgarte"})
PAPER_UNSTABILIZED = Variant("paper's scheme, no stabilization", "reference", "dt", (1e-2, 2.5e-3, 1e-3),
                             settings={"method": "paper", "stabilization": "none"})
TRIAL = Variant("trial and error", "reference", "rtol", (1e-9,), settings={"solver": "trial", "stabilization": "projection"})
MOREAU = Variant("Moreau, contact", "moreau", "dt", (4e-3, 1e-3, 2.5e-4), fidelity="contact")
EXTERNAL = (
    Variant("Exudyn", "exudyn", "dt", (1e-2, 4e-3, 1e-3)),
    Variant("Exudyn, contact", "exudyn", "dt", (4e-3, 1e-3, 5e-4), fidelity="contact"),
    Variant("pymunk", "pymunk", "dt", (1e-2, 2.5e-3, 1e-3, 2.5e-4)),
    Variant("pymunk, contact", "pymunk", "dt", (1e-2, 2.5e-3, 1e-3, 5e-4), fidelity="contact"),
    Variant("PyBullet", "pybullet", "dt", (1e-2, 2.5e-3, 1e-3, 2.5e-4)),
    Variant("PyBullet, contact", "pybullet", "dt", (1e-2, 2.5e-3, 1e-3, 5e-4), fidelity="contact"),
    MOREAU,
)


def variants(engines: Iterable[str] | None = None, quick: bool = False) -> tuple[Variant, ...]:
    """The variants of the main job.

    Parameters
    ----------
    engines
        Names to which the external engines are limited; the reference is always among them. An engine of an entry point
        or a ``module:Class`` takes part at joint fidelity with dt = 1e-2, 1e-3.
    quick
        The two coarsest rungs of every ladder (of the reference: the coarsest and the finest).
    """
    chosen = [name for name in (engine_names() if engines is None else engines) if name != "reference"]
    known = {variant.engine for variant in EXTERNAL}
    others = [Variant(name, name, "dt", (1e-2, 1e-3)) for name in chosen if name not in known]
    everything = [REFERENCE_TIGHT, REFERENCE_BAUMGARTE, PAPER, PAPER_UNSTABILIZED, TRIAL,
                  *(variant for variant in EXTERNAL if variant.engine in chosen), *others]
    if not quick:
        return tuple(everything)
    return tuple(Variant(v.label, v.engine, v.parameter,
                         (v.ladder[0], v.ladder[-1]) if v is REFERENCE_TIGHT else v.ladder[:2], v.fidelity, v.settings)
                 for v in everything)


def run_key(scene: Scene, variant: Variant, step: float) -> str:
    return f"{scene.name}/{variant.label}/{variant.parameter}={step:g}"


def job(scene: Scene, variant: Variant, step: float, **arguments: Any) -> Job:
    """The run of a variant at one rung of its ladder, for `engines.isolation`.

    The finest rung keeps samples every 2 ms, for the jumps of the driving effort, the others every 10 ms.
    """
    output = {"output_step": 0.002 if step == variant.ladder[-1] else 0.01}
    return Job(run_key(scene, variant, step), variant.engine, scene,
               {variant.parameter: step, "fidelity": variant.fidelity, **output, **variant.settings, **arguments})


def has_static_coefficient(variant: Variant) -> bool:
    """Whether the variant represents mus > mu; without it, it is compared with the truth for mus = mu."""
    try:
        return load_engine(variant.engine).capabilities.static_coefficient.get(variant.fidelity, False)
    except EngineMissing:
        return True  # its runs will be rows with status "missing"; any truth will do


def physics_of(scene: Scene, static_coefficient: bool) -> Scene:
    """The scene with the physics that an engine has: mus = mu on every guide unless it has a static coefficient."""
    overrides = {f"{name}.mus": guide.mu for name, guide in scene.frictional_guides.items() if guide.mus is not None}
    return scene if static_coefficient or not overrides else vary(scene, overrides)
