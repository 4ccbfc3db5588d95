"""Guises of a mechanism that must not matter, and that a guise which does matter is found."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from stiction.comparisons.random_scenes.metamorphic import (Guise, difference, disagreement, guises, mirrored, moved, renamed, scaled,
                                                            simulate)
from stiction.comparisons.random_scenes.random_mechanisms import SeededDice, extreme_scene, moderate_scene
from stiction.scenes import scene_from_dict

NAMES = ("grid", "moved", "mirrored", "scaled", "renamed", "company")
T_END, RTOL, SEED = 1.5, 1e-9, 20


def drawn(seed: int, number: int) -> tuple[dict, dict[str, Guise]]:
    random = np.random.default_rng([seed, number])
    tables = moderate_scene(SeededDice(random))
    return tables, {guise.name: guise for guise in guises(tables, random)}


def disagreements(name: str, seed: int, scenes: range, t_end: float = T_END) -> list[str]:
    found = ((number, *drawn(seed, number)) for number in scenes)
    return [f"seed {seed}, scene {number}: {words}" for number, tables, all_ in found
            if (words := disagreement(tables, all_[name], t_end, RTOL))]


@pytest.mark.parametrize("name", NAMES)
def test_guises_agree(name, compiled):
    assert disagreements(name, SEED, range(30)) == []


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("t_end", [1.5, 8.0])
def test_guises_of_many_agree(name, t_end, compiled):
    assert disagreements(name, SEED + 1, range(300), t_end) == []


def test_scenes_have_what_the_guises_are_about():
    several = [tables for tables, _ in (drawn(SEED, number) for number in range(30)) if len(scene_from_dict(tables).frictional_guides) > 1]
    events = sum(len(simulate(Guise("as it is", tables), T_END, RTOL).events) for tables in several)
    assert len(several) > 10 and events > 30


@pytest.mark.parametrize("tables", [moderate_scene(SeededDice(3)), extreme_scene(np.random.default_rng(3))], ids=["moderate", "extreme"])
def test_twice_mirrored_and_scaled_back_is_the_same(tables):
    assert mirrored(mirrored(tables)) == tables
    assert scaled(scaled(tables, 1024.0), 1 / 1024.0) == tables  # powers of two round nothing
    there_and_back = moved(moved(tables, np.array([1.0, -2.0]), 0.0), np.array([-1.0, 2.0]), 0.0)
    for name, body in tables["bodies"].items():
        assert there_and_back["bodies"][name]["position"] == pytest.approx(body["position"], abs=1e-12)
    other, names = renamed(tables)
    assert set(names.values()) == {name for section in ("bodies", "joints", "drives", "springs", "forces") for name in tables[section]}
    assert not set(names) & set(names.values())


@pytest.mark.parametrize("name", NAMES[1:])
def test_a_guise_that_is_another_mechanism_disagrees(name, compiled):
    """A mass that is another by a thousandth of itself, in each guise; the way home forgotten, in those that have one."""
    tables, all_ = drawn(SEED, 0)
    other = copy.deepcopy(all_[name].tables)
    body = next(iter(other["bodies"].values()))
    body["mass"] *= 1.001
    assert disagreement(tables, replace(all_[name], tables=other), T_END, RTOL)
    if name in ("moved", "mirrored", "scaled"):
        assert disagreement(tables, replace(all_[name], home=lambda x: x), T_END, RTOL)


def test_the_last_bits_count_where_they_must(compiled):
    tables, all_ = drawn(SEED, 0)
    almost = copy.deepcopy(tables)
    next(iter(almost["bodies"].values()))["mass"] *= 1 + 1e-12
    runs = [simulate(Guise("as it is", each), T_END, RTOL) for each in (tables, almost)]
    assert 0.0 < difference(*runs, tables["bodies"], all_["grid"]) < 1e-9
    assert "last bit" in disagreement(tables, replace(all_["grid"], tables=almost), T_END, RTOL)
