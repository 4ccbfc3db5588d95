"""Hard cases: scenes, what must be true of their motion, and how it is measured, from ``cases.toml``."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.hard.closed_forms import value
from stiction.comparisons.hard.scaled_scenes import Units, scaled
from stiction.scenes import Scene, load_scene, scene_from_dict
from stiction.scenes.expressions import evaluate

MOTION, NO_MOTION, REFUSAL, MOTION_OR_WORD = (
    "a motion",
    "no motion",
    "a refusal",
    "a motion or a word",
)
"""Expectations: one motion; a stop where existence or uniqueness ends; a refusal of the input; the one motion, or the
admission that this method cannot have it."""
NONE, SEVERAL = "no solution", "several solutions"
LINKS = 10_000
"""Rods of the hostile chain."""


@dataclass(frozen=True)
class Limits:
    """Errors, relative to the size of what is measured, up to which a run is right, and up to which it is degraded."""

    right: float
    degraded: float


LIMITS = {"rtol": Limits(1e-6, 1e-3), "dt": Limits(1e-2, 1e-1)}
"""Limits by the parameter of a variant. An adaptive method runs at rtol 1e-10: four digits for the growth of local
errors, six that are right. A fixed step is a thousandth of the case's time scale: ten steps' worth of a first-order
error are right. Three digits, or one, less is degraded; beyond that not a digit is left."""
CONDITIONS = Limits(1e-9, 1e-9)
"""Limits of the complementarity conditions of an accepted state, relative: they are solved, not integrated."""


@dataclass(frozen=True)
class HardCase:
    """One row of the table of hard cases; the attributes are the keys of ``cases.toml``.

    Attributes
    ----------
    must : str
        What must be true, in one line.
    scene : str
        Name in the catalogue of scenes; its `source` has the derivation. Empty where there is a `text`.
    set : Mapping
        Changes of the scene.
    text : sequence of str
        Instead of `scene`: names of `texts`, or of long ones, that make a scene file; `change` replaces parts of it.
    variations : sequence
        Scenes whose runs must agree with the first: ``"reordered"``, or factors of length, mass and time.
    expected : str
        `MOTION`, `NO_MOTION`, `REFUSAL` or `MOTION_OR_WORD`.
    stop : Mapping
        For `NO_MOTION`: the motion ends ``at`` a time (a formula, s), ``kind`` is `NONE` or `SEVERAL`.
    words : str
        Words that a refusal must contain.
    dt : float
        Step of fixed-step methods: a thousandth of the time scale of the case, s.
    most_steps : int
        A fixed-step run of more steps than these is not made.
    reference : Mapping
        Settings of the reference instead of its variant's own.
    static : bool
        The case is about mus > mu: nothing for a method with one coefficient, which else gets mus = mu.
    depth : Depth
        First depth at which it is examined. Those for which all variants together take more than seven seconds are left
        to `Depth.FULL`.
    rtol_limits : sequence of float
        `Limits` of adaptive methods instead of those of `LIMITS`.
    rests, follows, let, truth, same_motion, checks
        Measures of its runs, see `stiction.comparisons.hard.checks`.
    """

    name: str
    topic: str
    must: str = ""
    scene: str = ""
    set: Mapping[str, Any] = field(default_factory=dict)
    text: Sequence[str] = ()
    change: Mapping[str, str] = field(default_factory=dict)
    variations: Sequence[str | Mapping[str, Any]] = ()
    expected: str = MOTION
    stop: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""
    dt: float = 1e-3
    most_steps: int = 20_000
    reference: Mapping[str, Any] = field(default_factory=dict)
    static: bool = False
    depth: Depth = Depth.DEFAULT
    rtol_limits: Sequence[float] = ()
    rests: Sequence[str] = ()
    follows: Mapping[str, str] = field(default_factory=dict)
    let: Mapping[str, str] = field(default_factory=dict)
    truth: Mapping[str, Any] = field(default_factory=dict)
    same_motion: bool = False
    checks: Sequence[str] = ()

    def limits(self, parameter: str) -> Limits:
        """Limits of the variants with a parameter."""
        return (
            Limits(*self.rtol_limits)
            if self.rtol_limits and parameter == "rtol"
            else LIMITS[parameter]
        )

    def stops_at(self, scene: Scene) -> float:
        """Time (s) at which the motion of a scene ends."""
        return float(value(str(self.stop["at"]), scene))

    @property
    def units(self) -> Units:
        """Units of the first variation."""
        return next(
            _units(variation) for variation in self.variations if not isinstance(variation, str)
        )

    def scenes(self, static_coefficient: bool = True) -> tuple[Scene, ...]:
        """Load the scene of the case and its variations; without a static coefficient with mus = mu.

        Raises
        ------
        SceneError
            If it cannot be loaded, as some cases expect.
        """
        if self.text:
            texts = {
                **_tables()["texts"],
                "chain": chain(),
                "five MiB": "#" * (5 * 2**20) + "\n",
                "nested": "x = " + "[" * 50_000,
            }
            text = "".join(texts[name] for name in self.text)
            for found, replacement in self.change.items():
                if (times := text.count(found)) != 1:
                    raise ValueError(
                        f"cases.toml: {self.name}: change: found {found!r} {times} times; expected once"
                    )
                text = text.replace(found, replacement)
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "scene.toml"
                path.write_text(text)
                return (load_scene(path),)
        first = load_scene(self.scene, self.set)
        if not static_coefficient and not self.static and "mus" in first.parameters:
            first = load_scene(self.scene, {**self.set, "mus": "mu"})
        return first, *(
            reordered(first) if isinstance(variation, str) else scaled(first, _units(variation))
            for variation in self.variations
        )


def _units(factors: Mapping[str, Any]) -> Units:
    return Units(**{name: evaluate(factor, {}) for name, factor in factors.items()})


def reordered(scene: Scene) -> Scene:
    """Return the scene with its joints in reverse order."""
    raw = scene.model_dump()
    raw["joints"] = dict(reversed(raw["joints"].items()))
    return scene_from_dict(raw, scene._origin, name=scene.name)


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads((resources.files(__package__) / "cases.toml").read_text(encoding="utf-8"))


@cache
def hard_cases(depth: Depth = Depth.FULL) -> tuple[HardCase, ...]:
    """Return the cases that a depth reaches."""
    cases = (
        HardCase(
            name,
            topic,
            **{
                "expected": NO_MOTION if "stop" in table else MOTION,
                **table,
                "depth": Depth(table.get("depth", Depth.DEFAULT)),
            },
        )
        for topic, tables in _tables()["cases"].items()
        for name, table in tables.items()
    )
    return tuple(case for case in cases if depth.reaches(case.depth))


def chain() -> str:
    """Write a scene file of `LINKS` rods that hang on each other, at rest."""
    rods = "\n".join(
        f"b{i} = {{ mass = 1, inertia = 0.1, position = [0, {-i - 0.5}] }}" for i in range(LINKS)
    )
    pins = "\n".join(
        f'j{i} = {{ type = "revolute", bodies = ["b{i}", "{f"b{i - 1}" if i else "ground"}"], '
        f"points = [[0, 0.5], [0, {-0.5 if i else 0}]] }}"
        for i in range(LINKS)
    )
    return f"t_end = 0.01\ngravity = [0, -9.81]\n[bodies]\n{rods}\n[joints]\n{pins}\n"
