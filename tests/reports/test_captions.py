"""Numbers in captions are recomputed from a written report, by code that shares nothing with the studies."""

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
    found = re.search(r"slider-bar-case-\d", name)
    return found[0] if found else data.tables["study"]["scene"].iloc[0]


def case(name: str, data: Data) -> list[float]:
    return [float(re.search(r"case (\d)", data.scenes[scene_of(name, data)]["title"])[1])]


def paper_figure(name: str, data: Data) -> list[float]:
    return [float(PAPER[re.sub(r"^fig\d+-", "", name)])]


def seconds(name: str, data: Data) -> list[float]:
    return [float(data.scenes[scene_of(name, data)]["t_end"])]


def parameters(name: str, data: Data) -> list[float]:
    row = data.tables["parameters"].set_index("scene").loc[scene_of(name, data)]
    return [float(f"{value:g}") for value in row.dropna()]


def stable_step(name: str, data: Data) -> list[float]:
    """ms; where the classical Runge-Kutta method's |1 + z + z^2/2 + z^3/6 + z^4/24| = 1 on the negative axis.

    z is the step times the larger root of s^2 + 2 alpha s + beta^2, Baumgarte's equation of the residual.
    """
    given = data.scenes[scene_of(name, data)]["stabilization"]
    fastest = np.roots([1, 2 * given["alpha"], given["beta"] ** 2]).real.min()
    limits = np.roots([1 / 24, 1 / 6, 1 / 2, 1])  # besides z = 0
    return [1e3 * limits[np.isreal(limits)].real.min() / fastest]


Rule = Callable[[str, Data], list[float]]
RULES: dict[str, Rule] = {
    r"\b[Cc]ase (\d)": case,
    r"the paper's Fig\. (\d+)": paper_figure,
    r"\bin (24) s|within (24) s": seconds,
    r"In SI units: (.*)\.$": parameters,
    r"step of ([\d.]+) ms beyond": stable_step,
}


def captions(report: Report) -> Iterator[tuple[str, str]]:
    yield from ((each.name, each.caption) for each in (*report.figures, *report.tables))


def checked(report: Report, data: Data) -> Iterator[tuple[str, Rule, float, float]]:
    """Numbers that captions have of a scene: where they stand, its rule, what it says and what the data say."""
    for name, caption in captions(report):
        for pattern, rule in RULES.items():
            for found in re.finditer(pattern, caption):
                text = next(filter(None, found.groups()))
                said = re.findall(r"= ([-\d.e]+)(?:,|$)", text) if rule is parameters else [text]
                for one, true in zip(map(float, said), rule(name, data), strict=True):
                    yield name, rule, one, true


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


def test_numbers_of_captions_are_those_of_the_data(report, data):
    found = list(checked(report, data))
    assert [each for each in found if each[2] != pytest.approx(each[3], rel=6e-3)] == []
    assert {rule for _, rule, _, _ in found} == set(RULES.values()) and len(found) > 20


@pytest.mark.parametrize("rule", [case, seconds, parameters, stable_step])
def test_data_that_say_something_else_are_noticed(rule, report, data):
    changed = deepcopy(data)
    for scene in changed.scenes.values():
        scene["title"] = re.sub(r"\d$", "7", scene["title"])
        scene["t_end"] = 25
        scene.get("stabilization", {})["alpha"] = 100
    numeric = changed.tables["parameters"].select_dtypes("number")
    changed.tables["parameters"][numeric.columns] = 1.1 * numeric + 1
    said = [(one, true) for _, of, one, true in checked(report, changed) if of is rule]
    assert said and all(one != pytest.approx(true, rel=6e-3) for one, true in said)
