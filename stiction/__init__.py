"""The public names of the suite: what scripts begin with, and what an engine in another package is made of.

    from stiction import load_scene, load_engine

Each is loaded when it is first used, so that ``stiction --help`` answers at once.
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
    from stiction.scenes import (
        Breakdown,
        Cost,
        Event,
        InputError,
        Scene,
        SceneError,
        StictionError,
        Trajectory,
        load_scene,
        scene_from_dict,
        scene_to_toml,
    )
    from stiction.scenes.laws import evaluate_law

__all__ = [
    "BadTrajectory",
    "Breakdown",
    "Capabilities",
    "Cost",
    "Engine",
    "EngineFailure",
    "EngineMissing",
    "EquationsOfMotion",
    "Event",
    "InputError",
    "Job",
    "Judgement",
    "Outcome",
    "Refused",
    "Scene",
    "SceneError",
    "StictionError",
    "Terms",
    "Trajectory",
    "UnknownEngine",
    "corner_forces",
    "energies",
    "engine_names",
    "evaluate_law",
    "judge",
    "load_engine",
    "load_scene",
    "recover_columns",
    "run_isolated",
    "scene_from_dict",
    "scene_to_toml",
]

if (_checkout := Path(__file__).parent.parent).joinpath("pyproject.toml").is_file():
    __path__.append(str(_checkout))  # a checkout has the packages next to this one

_HOMES = {
    "comparisons.judge.judgement": {"Judgement", "judge"},
    "reference_impl.energies": {"energies"},
    "reference_impl.equations_of_motion": {"EquationsOfMotion", "Terms"},
    "reference_impl.multibody.reactions": {"recover_columns"},
    "reference_impl.multibody.trajectory_columns": {"corner_forces"},
    "scenes": {
        "Breakdown",
        "Cost",
        "Event",
        "InputError",
        "Scene",
        "SceneError",
        "StictionError",
        "Trajectory",
        "load_scene",
        "scene_from_dict",
        "scene_to_toml",
    },
    "scenes.laws": {"evaluate_law"},
}
"""Modules of the public names; those that stand in none of them are of `stiction.engines`."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'stiction' has no attribute {name!r}")
    home = next((module for module, names in _HOMES.items() if name in names), "engines")
    return getattr(import_module(f"stiction.{home}"), name)


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__"))]
