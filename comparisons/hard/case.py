"""Hard cases from ``cases.toml``: scenes, their expected outcomes, and how these are measured."""

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

MOTION = "a motion"
"""Expectation: the scene has one motion."""
NO_MOTION = "no motion"
"""Expectation: the run stops where there is no motion any more, or more than one."""
REFUSAL = "a refusal"
"""Expectation: the input is refused."""
MOTION_OR_WORD = "a motion or a word"
"""Expectation: the one motion, or the statement that the method cannot compute it."""
NONE = "no solution"
"""Kind of a stop: there is no motion with finite forces."""
SEVERAL = "several solutions"
"""Kind of a stop: there are several motions."""
CHAIN_LINKS = 10_000
"""Rods of a chain that is too large for most solvers."""
LARGE_COMMENT = "#" * (5 * 2**20) + "\n"
"""A comment of 5 MiB, more than a scene file may have."""
DEEP_NESTING = "x = " + "[" * 50_000
"""Nested arrays, more than most parsers can read."""
REORDERED = "reordered"
"""Variation of a scene whose joints have the reverse order."""


@dataclass(frozen=True)
class Limits:
    """Limits of errors, relative to the size of the measured quantity.

    Attributes
    ----------
    right : float
        Largest error of a run that is right.
    degraded : float
        Largest error of a run that is degraded; with larger errors it is wrong.
    """

    right: float
    degraded: float


LIMITS = {"rtol": Limits(1e-6, 1e-3), "dt": Limits(1e-2, 1e-1)}
"""Limits by the parameter of a variant.

An adaptive method has the tolerance 1e-10. Local errors may grow by four digits; the other six are right. A fixed step
is a thousandth of the time scale of the case, and the error of ten such steps of a first-order method is right. A
degraded run has lost three further digits, or one.
"""
CONDITIONS = Limits(1e-9, 1e-9)
"""Limits of the complementarity conditions of a state: they are solved at each instant, so that errors do not grow."""


@dataclass(frozen=True)
class HardCase:
    """One hard case. The attributes are the keys of ``cases.toml``.

    Attributes
    ----------
    name, topic : str
        Name of the case, and the topic under which it is listed.
    must : str
        The expected outcome in one line, for readers.
    scene : str
        Name in the catalogue of scenes, whose `source` contains the derivation; empty if there is a `text`.
    set : Mapping
        Changes of the scene.
    text : sequence of str
        Names of the texts which together are the scene file (`_texts`), instead of `scene`.
    change : Mapping
        Replacements in this file, by the text that is replaced.
    variations : sequence
        Variations of the scene whose runs must agree with the first run: `REORDERED`, or factors of length, mass and
        time.
    expected : str
        `MOTION`, `NO_MOTION`, `REFUSAL` or `MOTION_OR_WORD`.
    stop : Mapping
        For `NO_MOTION`: the time at which the motion ends, ``at`` (a formula, s), and its ``kind``, `NONE` or
        `SEVERAL`.
    words : str
        Words that a refusal must contain.
    dt : float
        Step of methods with fixed steps, s: a thousandth of the time scale of the case.
    most_steps : int
        Largest number of fixed steps; a longer run is not made.
    reference : Mapping
        Settings of the reference that replace those of its variant.
    static : bool
        True if the case is about mus > mu, and has no meaning for methods with one coefficient. In other cases these
        get mus = mu.
    depth : Depth
        First depth at which the case is examined. Cases for which all variants together take more than seven seconds
        belong to `Depth.FULL`.
    rtol_limits : sequence of float
        The `Limits` of adaptive methods, if they are not those of `LIMITS`.
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
        """Return the limits of the errors of variants with a parameter, ``rtol`` or ``dt``."""
        if parameter == "rtol" and self.rtol_limits:
            return Limits(*self.rtol_limits)
        return LIMITS[parameter]

    def stops_at(self, scene: Scene) -> float:
        """Return the time at which the motion of a scene ends, s."""
        return float(value(str(self.stop["at"]), scene))

    @property
    def units(self) -> Units:
        """Units of the first variation in other units."""
        for variation in self.variations:
            if not isinstance(variation, str):
                return _units(variation)
        raise ValueError(f"cases.toml: {self.name}: variations: found no units; expected factors")

    def scenes(self, static_coefficient: bool = True) -> tuple[Scene, ...]:
        """Return the scene of the case, followed by its variations.

        Parameters
        ----------
        static_coefficient
            False for a method with one coefficient, for which mus = mu.

        Raises
        ------
        SceneError
            If the scene cannot be loaded, as some cases expect.
        """
        if self.text:
            return (self._scene_of_text(),)
        first = load_scene(self.scene, self.set)
        if not static_coefficient and not self.static and "mus" in first.parameters:
            first = load_scene(self.scene, {**self.set, "mus": "mu"})
        scenes = [first]
        for variation in self.variations:
            if isinstance(variation, str):
                scenes.append(reordered(first))
            else:
                scenes.append(scaled(first, _units(variation)))
        return tuple(scenes)

    def _scene_of_text(self) -> Scene:
        """Load the scene from a file with the texts of the case."""
        texts = _texts()
        text = "".join(texts[name] for name in self.text)
        for replaced, replacement in self.change.items():
            count = text.count(replaced)
            if count != 1:
                raise ValueError(
                    f"cases.toml: {self.name}: change: found {replaced!r} {count} times; expected once"
                )
            text = text.replace(replaced, replacement)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.toml"
            path.write_text(text)
            return load_scene(path)


def _units(factors: Mapping[str, Any]) -> Units:
    """Return units from factors of length, mass and time, which may be formulas."""
    return Units(**{name: evaluate(factor, {}) for name, factor in factors.items()})


def reordered(scene: Scene) -> Scene:
    """Return a scene with its joints in reverse order."""
    raw = scene.model_dump()
    raw["joints"] = dict(reversed(raw["joints"].items()))
    return scene_from_dict(raw, scene._origin, name=scene.name)


@cache
def _tables() -> dict[str, Any]:
    """Return the content of ``cases.toml``."""
    return tomllib.loads((resources.files(__package__) / "cases.toml").read_text(encoding="utf-8"))


def _texts() -> dict[str, str]:
    """Return the texts of which scene files consist, by name: those of ``cases.toml``, and long ones."""
    return {
        **_tables()["texts"],
        "chain": chain(),
        "five MiB": LARGE_COMMENT,
        "nested": DEEP_NESTING,
    }


@cache
def hard_cases(depth: Depth = Depth.FULL) -> tuple[HardCase, ...]:
    """Return the cases that are examined at a depth."""
    cases = []
    for topic, tables in _tables()["cases"].items():
        for name, table in tables.items():
            case = _case(name, topic, table)
            if depth.reaches(case.depth):
                cases.append(case)
    return tuple(cases)


def _case(name: str, topic: str, table: Mapping[str, Any]) -> HardCase:
    """Return a case from its table; one with a stop expects no motion."""
    keys = dict(table)
    keys.setdefault("expected", NO_MOTION if "stop" in table else MOTION)
    keys["depth"] = Depth(table.get("depth", Depth.DEFAULT))
    return HardCase(name, topic, **keys)


def chain() -> str:
    """Return the scene file of a vertical chain of `CHAIN_LINKS` rods at rest; the first hangs on the ground."""
    rods = []
    pins = []
    for i in range(CHAIN_LINKS):
        rods.append(f"b{i} = {{ mass = 1, inertia = 0.1, position = [0, {-i - 0.5}] }}")
        support = "ground" if i == 0 else f"b{i - 1}"
        support_y = 0 if i == 0 else -0.5
        pins.append(
            f'j{i} = {{ type = "revolute", bodies = ["b{i}", "{support}"], '
            f"points = [[0, 0.5], [0, {support_y}]] }}"
        )
    lines = ["t_end = 0.01", "gravity = [0, -9.81]", "[bodies]", *rods, "[joints]", *pins]
    return "\n".join(lines) + "\n"
