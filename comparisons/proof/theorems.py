"""The thresholds that come proven with the suite, for reports.

Each is a file of `stiction prove SCENE --threshold N --out FILE`, to be checked with ``--check``. The tests of the
suite check them; to read one takes no ball arithmetic.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from fractions import Fraction
from importlib import resources
from pathlib import Path

from stiction.comparisons.truth import StickThreshold
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.scenes import Scene, StictionError, scene_from_dict

DATA = Path(str(resources.files("stiction.comparisons") / "data"))
"""Folder of the certificates."""


class Contradiction(StictionError, AssertionError):
    """A truth in floats, or a threshold, that differs from what is proven by more than its uncertainty."""


def certificates() -> list[Path]:
    """The files that come with the suite."""
    return sorted(DATA.glob("threshold-*.json"))


def with_theorem(scene: Scene, found: StickThreshold) -> StickThreshold:
    """A threshold with its proven interval where the scene is that of a theorem; as it is otherwise.

    Raises Contradiction if it is not within the interval.
    """
    mechanism = SliderBar.from_scene(scene)
    for file in certificates():
        claims = json.loads(file.read_text(encoding="utf-8"))
        proven = SliderBar.from_scene(scene_from_dict(tomllib.loads(claims["file"]), claims["scene"]))
        if replace(mechanism, F0=proven.F0) == proven:
            low, high = (Fraction(claims[end]["F0 [N]"]) for end in ("low", "high"))
            middle, half = float((low + high) / 2), float(high - low) / 2
            if found.F0 is not None and not abs(found.F0 - middle) <= half + (found.uncertainty or 0.0):
                raise Contradiction(f"{scene.name}: found the threshold {found.F0!r} +/- {found.uncertainty:.2g} N; "
                                    f"proven is {middle!r} +/- {half:.2g} N")
            return replace(found, F0=middle, uncertainty=half, theorem=" ".join(claims["theorem"]))
    return found
