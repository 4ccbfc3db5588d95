"""Engines behind one protocol; a registry of them; their isolation in child processes."""

from stiction.engines.isolation import (
    Isolate,
    Job,
    Outcome,
    Task,
    isolate,
    run_isolated,
    simulation,
)
from stiction.engines.protocol import BadTrajectory, Capabilities, Engine, EngineFailure, Refused
from stiction.engines.registry import EngineMissing, UnknownEngine, engine_names, load_engine

__all__ = [
    "BadTrajectory",
    "Capabilities",
    "Engine",
    "EngineFailure",
    "EngineMissing",
    "Isolate",
    "Job",
    "Outcome",
    "Refused",
    "Task",
    "UnknownEngine",
    "engine_names",
    "isolate",
    "load_engine",
    "run_isolated",
    "simulation",
]
