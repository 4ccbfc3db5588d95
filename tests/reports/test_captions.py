"""Numbers in captions are recomputed from a written report, by code that shares nothing with the studies.

A caption may word its numbers as it likes: what is compared is which numbers it contains.
"""

import re
import tomllib
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from report_material import CASE, record, unsaved_figures

from stiction.comparisons.bench.variants import Variant
from stiction.reports import report_of, write_report
from stiction.reports.report import Report

PAPER = {
    f"slider-bar-case-{case}-{subject}": 5 + 3 * (case - 1) + place
    for case in (1, 2, 3)
    for place, subject in enumerate(("velocity-acceleration", "corner-forces", "driving-moment"))
} | {"drift": 14}
"""The paper's Figs. 5 to 14, by what they show."""
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
"""A number in a caption; the digit of a name such as F0 is none."""
PRINTED = 6e-3
"""Largest relative rounding of a number with three digits."""


@dataclass(frozen=True)
class Data:
    """What a reader of the folder has: tables and scenes."""

    tables: dict[str, pd.DataFrame]
    scenes: dict[str, dict]


def data_of(folder: Path) -> Data:
    scenes = {
        path.stem: tomllib.loads(path.read_text())
        for path in (folder / "reproduce" / "scenes").glob("*.toml")
    }
    tables = {path.stem: pd.read_csv(path) for path in (folder / "data").glob("*.csv")}
    return Data(tables, scenes)


def scene_of(name: str, data: Data) -> str:
    """The scene that a figure or table names, else that of the study of drift."""
    named = re.search(r"slider-bar-case-\d", name)
    return named[0] if named else data.tables["study"]["scene"].iloc[0]


def case(name: str, data: Data) -> list[float]:
    return [float(re.search(r"case (\d+)", data.scenes[scene_of(name, data)]["title"])[1])]


def paper_figure(name: str, data: Data) -> list[float]:
    return [float(PAPER[re.sub(r"^fig\d+-", "", name)])]


def seconds(name: str, data: Data) -> list[float]:
    return [float(data.scenes[scene_of(name, data)]["t_end"])]


def parameters(name: str, data: Data) -> list[float]:
    row = data.tables["parameters"].set_index("scene").loc[scene_of(name, data)]
    return [float(value) for value in row.dropna()]


def stable_step(name: str, data: Data) -> list[float]:
    """ms; where the classical Runge-Kutta method's |1 + z + z^2/2 + z^3/6 + z^4/24| = 1 on the negative axis.

    z is the step times the larger root of s^2 + 2 alpha s + beta^2, Baumgarte's equation of the residual.
    """
    terms = data.scenes[scene_of(name, data)]["stabilization"]
    fastest = np.roots([1, 2 * terms["alpha"], terms["beta"] ** 2]).real.min()
    limits = np.roots([1 / 24, 1 / 6, 1 / 2, 1])  # besides z = 0
    return [1e3 * limits[np.isreal(limits)].real.min() / fastest]


Rule = Callable[[str, Data], list[float]]
RULES: dict[str, tuple[Rule, ...]] = {
    r"mechanism-.*": (case, parameters),
    r"fig(0[5-9]|1[0-3])-.*": (case, paper_figure),
    r"fig14-drift": (case, paper_figure, seconds, stable_step),
    r"(accuracy|torque)-slider-bar-case-\d": (case,),
}
"""By the name of a figure or table: the numbers that its caption must contain."""


def required(report: Report, data: Data) -> Iterator[tuple[str, Rule, list[float], list[float]]]:
    """Yield name, rule, the numbers that the data require in the caption, and the numbers in the caption."""
    for each in (*report.figures, *report.tables):
        for pattern, rules in RULES.items():
            if re.fullmatch(pattern, each.name):
                written = [float(number) for number in NUMBER.findall(each.caption)]
                for rule in rules:
                    yield each.name, rule, rule(each.name, data), written


def missing(true: list[float], written: list[float]) -> list[float]:
    return [
        one
        for one in true
        if not any(other == pytest.approx(one, rel=PRINTED) for other in written)
    ]


@pytest.fixture(scope="module")
def report(validation) -> Report:
    """With the figures of all three cases: those of the other two show the truth of the first."""
    others = [f"slider-bar-case-{case}" for case in (2, 3)]
    failed = record(Variant("reference", "reference", "rtol", (1e-9,)), 1e-9, "failed", "made up")
    records = [
        replace(failed, scene=scene, key=failed.key.replace(CASE, scene)) for scene in others
    ]
    truths = {
        **validation.truths,
        **{scene: replace(validation.truths[CASE], scene=scene) for scene in others},
    }
    return report_of(replace(validation, records=(*validation.records, *records), truths=truths))


@pytest.fixture(scope="module")
def data(report, tmp_path_factory) -> Data:
    folder = tmp_path_factory.mktemp("captions") / "run"
    with unsaved_figures():
        write_report(report, folder)
    return data_of(folder)


def test_captions_contain_the_numbers_of_the_data(report, data):
    wrong = [
        (name, rule.__name__, missing(true, written))
        for name, rule, true, written in required(report, data)
        if missing(true, written)
    ]
    assert wrong == []


def test_every_figure_of_the_paper_is_checked(report, data):
    checked = {name for name, rule, _, _ in required(report, data) if rule is paper_figure}
    assert {re.sub(r"^fig\d+-", "", name) for name in checked} == set(PAPER)
    every_rule = {rule for rules in RULES.values() for rule in rules}
    assert {rule for _, rule, _, _ in required(report, data)} == every_rule


@pytest.mark.parametrize("rule", [case, seconds, parameters, stable_step])
def test_data_that_say_something_else_are_noticed(rule, report, data):
    changed = deepcopy(data)
    for scene in changed.scenes.values():
        scene["title"] = re.sub(r"\d$", "77", scene["title"])
        scene["t_end"] = 25
        scene.get("stabilization", {})["alpha"] = 150
    numeric = changed.tables["parameters"].select_dtypes("number")
    changed.tables["parameters"][numeric.columns] = 1.1 * numeric + 1
    noticed = [
        bool(missing(true, written))
        for _, of, true, written in required(report, changed)
        if of is rule
    ]
    assert noticed and all(noticed)
