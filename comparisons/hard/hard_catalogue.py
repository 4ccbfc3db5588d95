"""The catalogue of hard cases, from ``cases.toml``.

A case is a table ``["topic"."name"]``. Keys that are no attributes of `HardCase`:

===============  ===========================================================================================
``set``          changes of the scene
``text``         instead of ``scene``, one of `hostile_scenes.TEXTS`; ``change``: what is replaced in it
``variations``   ``"reordered"``, or other units: factors of length, mass and time
``stop``         there is no motion ``at`` a time (a formula) and after; the ``kind`` of the breakdown
``follows``      formula by column, see `closed_forms.value`; ``let``: definitions in it
``truth``        the truth ``of`` a mechanism: ``columns`` (``slider.x``), ``events`` (true), ``time_at_rest`` (false)
``rests``        bodies that stay where they are
``same_motion``  the run in other units is the first one
``checks``       names of checks of single cases, see `checks.NAMED`
``rtol_limits``  `Limits` of adaptive methods
===============  ===========================================================================================
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib import resources
from typing import Any

from stiction.comparisons import truth as truths
from stiction.comparisons.depth import Depth
from stiction.comparisons.hard import checks
from stiction.comparisons.hard.case import LIMITS, MOTION, NO_MOTION, Check, HardCase, Limits
from stiction.comparisons.hard.closed_forms import value
from stiction.comparisons.hard.hostile_scenes import scene_text
from stiction.comparisons.hard.other_units import Units, scaled
from stiction.scenes import Scene, Trajectory, scene_from_dict
from stiction.scenes.expressions import evaluate

FILE = "cases.toml"
ATTRIBUTES = ("scene", "must", "dt", "static", "most_steps", "reference", "words")
"""Keys that are attributes of `HardCase` as they stand."""
KEYS = {*ATTRIBUTES, "set", "expected", "depth", "text", "change", "variations", "stop", "follows", "let", "truth",
        "rests", "same_motion", "checks", "rtol_limits"}


@cache
def hard_cases(depth: Depth = Depth.FULL) -> tuple[HardCase, ...]:
    """The cases that a depth reaches."""
    topics = tomllib.loads((resources.files(__package__) / FILE).read_text(encoding="utf-8"))
    cases = (_case(topic, name, table) for topic, tables in topics.items() for name, table in tables.items())
    return tuple(case for case in cases if depth.reaches(case.depth))


def _case(topic: str, name: str, table: Mapping[str, Any]) -> HardCase:
    unknown = sorted(table.keys() - KEYS)
    if unknown:
        raise ValueError(f"{FILE}, {name}: found {', '.join(map(repr, unknown))}; expected {', '.join(sorted(KEYS))}")
    found, stop, text = list(_checks(table)), table.get("stop"), table.get("text")
    return HardCase(
        name, topic,
        check=partial(_all_measures, found) if found else None,
        expected=table.get("expected", NO_MOTION if stop else MOTION),
        stop=partial(_stop, stop) if stop else None,
        overrides=table.get("set", {}),
        variations=tuple(map(_variation, table.get("variations", ()))),
        limits={**LIMITS, "rtol": Limits(*table["rtol_limits"])} if "rtol_limits" in table else LIMITS,
        depth=Depth(table.get("depth", Depth.DEFAULT)),
        text=partial(scene_text, text, table.get("change", {})) if text else None,
        **{key: table[key] for key in ATTRIBUTES if key in table})


def _checks(table: Mapping[str, Any]) -> Iterator[Check]:
    if "rests" in table:
        yield checks.at_rest(table["rests"])
    if "follows" in table:
        yield checks.follows(table["follows"], table.get("let"))
    if "truth" in table:
        asked = table["truth"]
        truth = getattr(truths, f"{asked['of']}_truth")
        yield checks.follows_truth(truth, asked.get("columns", ["slider.x"]), asked.get("events", True))
        if asked.get("time_at_rest", False):
            yield checks.rests_as(truth)
    if table.get("same_motion", False):
        yield checks.same_motion(_units(table["variations"][0]))
    yield from (checks.NAMED[name] for name in table.get("checks", ()))


def _all_measures(parts: Sequence[Check], scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
    return {name: error for check in parts for name, error in check(scenes, runs).items()}


def _stop(table: Mapping[str, Any], scene: Scene) -> tuple[float, str]:
    return float(value(str(table["at"]), scene)), table["kind"]


def _variation(entry: str | Mapping[str, Any]) -> Callable[[Scene], Scene]:
    return reordered if entry == "reordered" else partial(scaled, units=_units(entry))


def _units(factors: Mapping[str, Any]) -> Units:
    return Units(**{name: evaluate(factor, {}) for name, factor in factors.items()})


def reordered(scene: Scene) -> Scene:
    """The scene with its joints in reverse order."""
    raw = scene.model_dump()
    raw["joints"] = dict(reversed(raw["joints"].items()))
    return scene_from_dict(raw, scene._origin, name=scene.name)
