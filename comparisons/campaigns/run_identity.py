"""What a run is, whatever it is called: the content of its scene, the engine, the fidelity and all that was asked of the engine.

Two runs are compared only if their identities are the same. Names are for people: a variant `pymunk` may stand for any engine, fidelity
or settings, and a scene file may be edited under its name. The version of the engine is no part of it: whether a new version gets worse
is what a comparison with a baseline asks. It is kept beside the numbers and told where they differ.
"""

from __future__ import annotations

import json

from stiction.comparisons.digest import scene_digest
from stiction.comparisons.variants import Variant
from stiction.scenes import Scene


def run_identity(scene: Scene, variant: Variant, step: float) -> str:
    """Identity of a variant's run with a step on a scene: ``"pymunk, joint, dt = 0.01; scene 53f1d0c2a9e84b67"``."""
    asked = {**variant.settings, variant.parameter: step}
    words = ", ".join(f"{name} = {json.dumps(asked[name], sort_keys=True, default=str)}" for name in sorted(asked))
    return f"{variant.stands_for or variant.engine}, {variant.fidelity}, {words}; scene {scene_digest(scene)}"


def truth_identity(scene: Scene) -> str:
    return f"truth; scene {scene_digest(scene)}"


def parameter_of(key: str) -> str:
    """What the ladder of a run varies, by its key; empty for a truth."""
    return key.rpartition("/")[2].partition("=")[0] if "=" in key else ""
