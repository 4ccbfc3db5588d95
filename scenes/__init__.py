"""What is simulated, and what a simulation yields; no numerics."""

from scenes.loading import Problem, SceneError, catalogue, load_scene, scene_from_dict, vary
from scenes.model import Scene
from scenes.trajectory import Cost, Event, Trajectory

__all__ = ["Cost", "Event", "Problem", "Scene", "SceneError", "Trajectory", "catalogue", "load_scene",
           "scene_from_dict", "vary"]
