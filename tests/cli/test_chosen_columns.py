"""Figures of chosen columns: of one run, and of several engines with the reference on top."""

import json

import numpy as np
import pandas as pd
import pytest
from conftest import invoke

from stiction import load_engine, load_scene
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope, union
from stiction.comparisons.studies.runs import STUDY
from stiction.reports.run_folder.stored_run import read_run
from stiction.scenes.columns import COLUMNS, WORDS, columns_of, label_of
from stiction.scenes.pictures.evolution import evolution

CASE = "slider-bar-case-1"


@pytest.fixture(scope="module")
def runs():
    """A run of the reference and a coarse one of another engine."""
    scene = load_scene(CASE)
    exact = load_engine("reference").simulate(scene, t_end=1.0)
    return exact, load_engine("pymunk").simulate(scene, t_end=1.0, dt=0.05)


def test_the_reference_is_black_and_on_top_whatever_the_order(runs):
    exact, coarse = runs
    for order in ((exact, coarse), (coarse, exact)):
        [ax] = evolution(order, ["motor.effort"]).axes
        last = ax.get_lines()[-1]
        assert last.get_label().startswith("reference")
        assert last.get_color() == "#000000"
        assert len({line.get_color() for line in ax.get_lines()}) == 2


def test_labels_are_words_with_symbol_and_unit(runs):
    exact, _ = runs
    picture = exact.plot("motor.effort", "guide.normal_force", width_mm=84)
    labels = [" ".join(ax.get_ylabel().split()) for ax in picture.axes]
    assert labels == ["torque $M$ of motor [N m]", "normal force $R$ of guide [N]"]
    assert picture.get_figwidth() == pytest.approx(84 / 25.4)
    assert all(ax.get_title() == "" for ax in picture.axes)


def test_every_column_of_a_mechanism_has_words():
    named = {name for column in COLUMNS if column.owner != "drift" for name in column.names}
    assert named - {"effort"} == set(WORDS)
    scene = load_scene(CASE)
    for name in columns_of(scene):
        if not name.startswith("drift"):
            assert name.rpartition(".")[0] in label_of(name, scene)


def test_columns_of_a_run_are_checked_before_it(tmp_path):
    plot = ["--plot", str(tmp_path / "a.png")]
    ended = invoke("run", CASE, "--columns", "motor.eff", *plot, exit_code=2)
    assert "did you mean 'motor.effort'" in ended.output
    assert "--plot" in invoke("run", CASE, "--columns", "motor.effort", exit_code=2).output
    assert (
        "expected one of double, single"
        in invoke("run", CASE, "--width", "wide", *plot, exit_code=2).output
    )
    assert not (tmp_path / "a.png").exists()


def test_columns_of_several_engines_are_samples_of_their_runs(in_this_process):
    scene = load_scene(CASE)
    scope = Scope((scene,), engines=("pymunk",), t_end=0.5, options={"columns": ("motor.effort",)})
    made = STUDY.plan(scope).make()
    results: Results = union([made], scenes=(scene,))
    table = results.table("runs")
    assert set(table["column"]) == {"motor.effort"}
    for record in results.records:
        rows = table[table["key"] == record.key]
        frame = record.run.to_frame(events=True)
        assert np.array_equal(rows["value"].to_numpy(float), frame["motor.effort"].to_numpy())
    [chart] = STUDY.presented(results).figures
    [panel] = chart.panels
    assert panel.series[-1].label.startswith("reference")
    # One run for each engine and fidelity.
    assert len(panel.series) == 3


def test_a_single_study_becomes_a_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    invoke("new", "sled.toml")
    invoke(
        "compare",
        "drift",
        "sled.toml",
        "--quick",
        "--engines",
        "pymunk",
        "--t-end",
        "0.5",
        "--report",
        "drift",
    )
    stored = read_run("drift")
    assert list(stored.validation().scenes) == ["sled"]
    assert pd.read_csv("drift/data/drift.csv")["scene"].unique().tolist() == ["sled"]
    origin = json.loads((tmp_path / "drift" / "provenance.json").read_text())
    assert origin["command"].startswith("stiction")
    assert not origin["choices"]
    refused = invoke("compare", "runs", "sled.toml", "--report", "runs", exit_code=2)
    assert "has no report" in refused.output
