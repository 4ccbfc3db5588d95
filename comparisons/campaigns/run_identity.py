"""What a run is, whatever it is called: the content of its scene, the engine, the fidelity and all that was asked of the engine.

Two runs are compared only if their identities are the same. Names are for people: a variant `pymunk` may stand for any engine, fidelity
or settings, and a scene file may be edited under its name. The version of the engine is no part of it: whether a new version gets worse
is what a comparison with a baseline asks. It is kept beside the numbers and told where they differ.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from stiction.comparisons.variants import Variant
from stiction.scenes import Scene

DIGITS = 12
"""Significant digits of a scene's numbers that count: the last ones of arithmetic like ``"sqrt(2)/3"`` are those of a machine's libm."""


def run_identity(scene: Scene, variant: Variant, step: float) -> str:
    """Of a variant at one rung on a scene: ``"pymunk, joint, dt = 0.01; scene 53f1d0c2a9e84b67"``."""
    asked = {**variant.settings, variant.parameter: step}
    words = ", ".join(f"{name} = {json.dumps(asked[name], sort_keys=True, default=str)}" for name in sorted(asked))
    return f"{variant.stands_for or variant.engine}, {variant.fidelity}, {words}; scene {scene_digest(scene)}"


def truth_identity(scene: Scene) -> str:
    return f"truth; scene {scene_digest(scene)}"


def parameter_of(key: str) -> str:
    """What the ladder of a run varies, by its key; empty for a truth."""
    return key.rpartition("/")[2].partition("=")[0] if "=" in key else ""


def scene_digest(scene: Scene) -> str:
    """Of what a scene declares, without title and source; names of elements count, for columns and events bear them."""
    content = scene.model_dump(mode="json", exclude={"title", "source", "parameters"}, exclude_defaults=True)
    return hashlib.sha256(json.dumps(_rounded(content), sort_keys=True).encode()).hexdigest()[:16]


def _rounded(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    return float(f"{content:.{DIGITS}g}") if isinstance(content, int | float) and not isinstance(content, bool) else content
