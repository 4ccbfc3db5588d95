"""The thresholds that come proven with the suite: what their certificates say, for reports.

Each is a file of `stiction prove SCENE --threshold N --out FILE`, to be checked with ``--check``. The tests of the suite check them; to read one takes no ball arithmetic.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib import resources
from importlib.resources.abc import Traversable

from stiction.comparisons.truth import StickThreshold
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.scenes import Scene, StictionError, scene_from_dict


class Contradiction(StictionError, AssertionError):
    """A truth in floats that has other events or columns than are proven, or a threshold outside of the proven interval by more than its uncertainty."""


@dataclass(frozen=True)
class Theorem:
    """A stick phase at F0 = low, none at F0 = high (N), of a mechanism whatever its own F0; and the sentences that say so."""

    mechanism: SliderBar
    low: Fraction
    high: Fraction
    sentences: tuple[str, ...]

    @classmethod
    def read(cls, certificate: Traversable) -> Theorem:
        """What a file claims."""
        told = json.loads(certificate.read_text(encoding="utf-8"))
        mechanism = SliderBar.from_scene(scene_from_dict(tomllib.loads(told["file"]), told["scene"]))
        return cls(mechanism, Fraction(told["low"]["F0 [N]"]), Fraction(told["high"]["F0 [N]"]), tuple(told["theorem"]))

    def is_of(self, mechanism: SliderBar) -> bool:
        return replace(mechanism, F0=self.mechanism.F0) == self.mechanism


def certificates() -> Iterator[Traversable]:
    """The files."""
    folder = resources.files("stiction.comparisons") / "data"
    yield from (file for file in sorted(folder.iterdir(), key=lambda file: file.name) if file.name.startswith("threshold-"))


def with_theorem(scene: Scene, found: StickThreshold) -> StickThreshold:
    """A threshold with its proven interval where the scene is that of a theorem; as it is otherwise.

    Raises
    ------
    Contradiction
        If it is not within the interval.
    """
    mechanism = SliderBar.from_scene(scene)
    for theorem in map(Theorem.read, certificates()):
        if theorem.is_of(mechanism):
            middle, half = float((theorem.low + theorem.high) / 2), float(theorem.high - theorem.low) / 2
            if found.F0 is not None and not abs(found.F0 - middle) <= half + found.uncertainty:
                raise Contradiction(f"{scene.name}: found the threshold {found.F0!r} +/- {found.uncertainty:.2g} N; proven is {middle!r} +/- {half:.2g} N")
            return replace(found, F0=middle, uncertainty=half, theorem=" ".join(theorem.sentences))
    return found
