"""The thresholds that come proven with the suite, for reports.

Each is a file of `stiction prove SCENE --threshold N --out FILE`, to be checked with ``--check``. The tests of the
suite check them; to read one takes no ball arithmetic.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib import resources
from pathlib import Path

from stiction.comparisons.truth import StickThreshold
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.scenes import Scene, StictionError, scene_from_dict

DATA = Path(str(resources.files("stiction.comparisons") / "data"))
"""Folder of the certificates."""


class Contradiction(StictionError, AssertionError):
    """A truth in floats that differs from what is proven by more than its uncertainty."""


@dataclass(frozen=True)
class Theorem:
    """A stick phase at F0 = low and none at F0 = high (N), of a mechanism with any F0; the same in sentences."""

    mechanism: SliderBar
    low: Fraction
    high: Fraction
    sentences: tuple[str, ...]

    @classmethod
    def read(cls, certificate: Path) -> Theorem:
        """Read the claims of a file."""
        claims = json.loads(certificate.read_text(encoding="utf-8"))
        mechanism = SliderBar.from_scene(scene_from_dict(tomllib.loads(claims["file"]), claims["scene"]))
        low, high = (Fraction(claims[end]["F0 [N]"]) for end in ("low", "high"))
        return cls(mechanism, low, high, tuple(claims["theorem"]))


def certificates() -> list[Path]:
    """The files that come with the suite."""
    return sorted(DATA.glob("threshold-*.json"))


def threshold_of_theorem(scene: Scene) -> StickThreshold | None:
    """Return the proven threshold where the scene is that of a theorem; its uncertainty is half the interval."""
    mechanism = SliderBar.from_scene(scene)
    for theorem in map(Theorem.read, certificates()):
        if replace(mechanism, F0=theorem.mechanism.F0) == theorem.mechanism:
            middle, half = (theorem.low + theorem.high) / 2, (theorem.high - theorem.low) / 2
            return StickThreshold(float(middle), float(half), (float(theorem.low), float(theorem.high)),
                                  theorem=" ".join(theorem.sentences))
    return None
