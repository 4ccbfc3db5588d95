"""The public names of the suite: what scripts begin with, and what an engine in another package is made of.

    from stiction import load_scene, load_engine

Each is loaded when it is first used, so that ``stiction --help`` answers at once.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stiction.comparisons.judgement import Judgement, judge
    from stiction.engines import (BadTrajectory, Capabilities, Engine, EngineFailure, EngineMissing, Job, Outcome,
                                  Refused, UnknownEngine, engine_names, load_engine, run_isolated)
    from stiction.reference_impl.multibody.reactions import recover_columns
    from stiction.scenes import (Breakdown, Cost, Event, InputError, Scene, SceneError, StictionError, Trajectory,
                                 load_scene)

__all__ = ["BadTrajectory", "Breakdown", "Capabilities", "Cost", "Engine", "EngineFailure", "EngineMissing", "Event",
           "InputError", "Job", "Judgement", "Outcome", "Refused", "Scene", "SceneError", "StictionError", "Trajectory",
           "UnknownEngine", "engine_names", "judge", "load_engine", "load_scene", "recover_columns", "run_isolated"]

if (_checkout := Path(__file__).parent.parent).joinpath("pyproject.toml").is_file():
    __path__.append(str(_checkout))  # a checkout has the packages next to this one

_OF_SCENES = {"Breakdown", "Cost", "Event", "InputError", "Scene", "SceneError", "StictionError", "Trajectory",
              "load_scene"}
_HOMES = {"recover_columns": "reference_impl.multibody.reactions", "judge": "comparisons.judgement",
          "Judgement": "comparisons.judgement"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'stiction' has no attribute {name!r}")
    home = _HOMES.get(name) or ("scenes" if name in _OF_SCENES else "engines")
    return getattr(import_module(f"stiction.{home}"), name)


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__"))]
