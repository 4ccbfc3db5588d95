"""What was run with which settings: the scenes' parameters, and the variants as their runs tell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from stiction.comparisons.results import Results
from stiction.scenes import catalogue, load_scene


def scene_parameters(validation: Results) -> pd.DataFrame:
    """The parameters of the scenes of the catalogue that were run: every figure depends on them."""
    names = [name for name in dict.fromkeys(record.scene for record in validation.records) if name in catalogue()]
    return pd.DataFrame([{"scene": name, **load_scene(name).parameters} for name in names])


def variant_settings(validation: Results) -> pd.DataFrame:
    """One row per variant, as its runs tell: friction law and who supplies it, stabilization, iterations, all else."""
    named = ("friction_law", "stabilization", "iterations")
    runs = {record.variant.label: record for record in validation.records}
    runs |= {record.variant.label: record for record in validation.records if record.trajectory is not None}
    rows = []
    for record in runs.values():
        variant, trajectory = record.variant, record.trajectory
        told = variant.settings if trajectory is None else trajectory.settings
        others = {key: value for key, value in told.items() if key not in (*named, "method", variant.parameter)}
        rows.append({
            "variant": variant.label, "engine": variant.engine, "version": trajectory.version if trajectory else None,
            "fidelity": variant.fidelity, "ladder": f"{variant.parameter} = {words(variant.ladder)}",
            "method": words(told.get("method")), **{key.replace("_", " "): words(told.get(key)) for key in named},
            "other settings": words(others)})
    return pd.DataFrame(rows)


def words(value: Any) -> str:
    """A setting as text: ``baumgarte (alpha = 90, beta = 10)`` for a mapping with a method."""
    if value is None:
        return ""
    if isinstance(value, Mapping):
        others = ", ".join(f"{key} = {words(entry)}" for key, entry in value.items() if key != "method")
        return f"{value['method']} ({others})" if others and "method" in value else str(value.get("method", others))
    if isinstance(value, (list, tuple)):
        return ", ".join(map(words, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
