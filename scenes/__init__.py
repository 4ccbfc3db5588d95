"""Scenes that are simulated and trajectories that simulations yield; no numerics."""

from stiction.scenes.base_errors import InputError, StictionError
from stiction.scenes.errors import FileError, Problem, SceneError
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.loading import (
    catalogue,
    load_scene,
    new_scene_text,
    scene_from_dict,
    scene_text,
    vary,
)
from stiction.scenes.model import (
    Baumgarte,
    Body,
    Drive,
    Force,
    LinearSpring,
    NoStabilization,
    Projection,
    Revolute,
    Scene,
    Torque,
    TorsionalSpring,
    Translational,
)
from stiction.scenes.overrides import parse_override
from stiction.scenes.trajectory import Breakdown, Cost, Event, Trajectory

__all__ = [
    "Baumgarte",
    "Body",
    "Breakdown",
    "Cost",
    "Drive",
    "Event",
    "Fidelity",
    "FileError",
    "Force",
    "InputError",
    "LinearSpring",
    "NoStabilization",
    "Problem",
    "Projection",
    "Revolute",
    "Scene",
    "SceneError",
    "StictionError",
    "Torque",
    "TorsionalSpring",
    "Trajectory",
    "Translational",
    "catalogue",
    "load_scene",
    "new_scene_text",
    "parse_override",
    "scene_from_dict",
    "scene_text",
    "vary",
]
