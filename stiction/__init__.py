"""The public names of the suite, for scripts and for engines in other packages.

    from stiction import load_scene, load_engine

Each name is imported from its module when it is first used, so that ``stiction --help`` starts fast.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stiction.comparisons.judge.judgement import Judgement, judge
    from stiction.engines import (
        BadTrajectory,
        Capabilities,
        Engine,
        EngineFailure,
        EngineMissing,
        Job,
        Outcome,
        Refused,
        UnknownEngine,
        engine_names,
        load_engine,
        run_isolated,
    )
    from stiction.reference_impl.energies import energies
    from stiction.reference_impl.equations_of_motion import EquationsOfMotion, Terms
    from stiction.reference_impl.multibody.reactions import recover_columns
    from stiction.reference_impl.multibody.trajectory_columns import corner_forces
    from stiction.reference_impl.scene_loading import assembled, load_scene
    from stiction.scenes import (
        Baumgarte,
        Body,
        Breakdown,
        Cost,
        Drive,
        Event,
        Force,
        InputError,
        LinearSpring,
        NoStabilization,
        Projection,
        Revolute,
        Scene,
        SceneError,
        StictionError,
        Torque,
        TorsionalSpring,
        Trajectory,
        Translational,
        laws,
        scene_from_dict,
    )
    from stiction.scenes.continuation import continued
    from stiction.scenes.laws import evaluate_law

__all__ = [
    "BadTrajectory",
    "Baumgarte",
    "Body",
    "Breakdown",
    "Capabilities",
    "Cost",
    "Drive",
    "Engine",
    "EngineFailure",
    "EngineMissing",
    "EquationsOfMotion",
    "Event",
    "Force",
    "InputError",
    "Job",
    "Judgement",
    "LinearSpring",
    "NoStabilization",
    "Outcome",
    "Projection",
    "Refused",
    "Revolute",
    "Scene",
    "SceneError",
    "StictionError",
    "Terms",
    "Torque",
    "TorsionalSpring",
    "Trajectory",
    "Translational",
    "UnknownEngine",
    "assembled",
    "continued",
    "corner_forces",
    "energies",
    "engine_names",
    "evaluate_law",
    "judge",
    "laws",
    "load_engine",
    "load_scene",
    "recover_columns",
    "run_isolated",
    "scene_from_dict",
]

# In a checkout, the subpackages are folders beside this one.
_PARENT = Path(__file__).parent.parent
if (_PARENT / "pyproject.toml").is_file():
    __path__.append(str(_PARENT))

_DEFAULT_MODULE = "engines"
"""Module of the public names that are not in `_MODULES`."""
_MODULES = {
    "comparisons.judge.judgement": {"Judgement", "judge"},
    "reference_impl.energies": {"energies"},
    "reference_impl.equations_of_motion": {"EquationsOfMotion", "Terms"},
    "reference_impl.multibody.reactions": {"recover_columns"},
    "reference_impl.multibody.trajectory_columns": {"corner_forces"},
    "reference_impl.scene_loading": {"assembled", "load_scene"},
    "scenes": {
        "Baumgarte",
        "Body",
        "Breakdown",
        "Cost",
        "Drive",
        "Event",
        "Force",
        "InputError",
        "LinearSpring",
        "NoStabilization",
        "Projection",
        "Revolute",
        "Scene",
        "SceneError",
        "StictionError",
        "Torque",
        "TorsionalSpring",
        "Trajectory",
        "Translational",
        "scene_from_dict",
    },
    "scenes.continuation": {"continued"},
    "scenes.laws": {"evaluate_law"},
}
"""Public names by the modules that define them."""


def __getattr__(name: str) -> Any:
    """Import and return a public name of the suite."""
    if name not in __all__:
        raise AttributeError(f"module 'stiction' has no attribute {name!r}")
    if name == "laws":
        return import_module("stiction.scenes.laws")
    module_of_name = _DEFAULT_MODULE
    for module, names in _MODULES.items():
        if name in names:
            module_of_name = module
    return getattr(import_module(f"stiction.{module_of_name}"), name)


def __dir__() -> list[str]:
    """Return the public names and the special names of the module."""
    return [*__all__, *(name for name in globals() if name.startswith("__"))]
