"""What is simulated, and what a simulation yields; no numerics."""

from scenes.base_errors import InputError, StictionError
from scenes.errors import FileError, Problem, SceneError
from scenes.loading import catalogue, load_scene, new_scene_text, scene_from_dict, scene_text, scene_to_toml, vary
from scenes.model import Scene
from scenes.overrides import parse_override
from scenes.trajectory import Breakdown, Cost, Event, Trajectory

__all__ = ["Breakdown", "Cost", "Event", "FileError", "InputError", "Problem", "Scene", "SceneError", "StictionError", "Trajectory",
           "catalogue", "load_scene", "new_scene_text", "parse_override", "scene_from_dict", "scene_text", "scene_to_toml", "vary"]
