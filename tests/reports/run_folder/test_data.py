"""What a run folder keeps of the runs: those that figures show, bit by bit, and the command for the others."""

import shlex
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import tomli_w
from conftest import invoke
from report_material import CASE, record

from stiction.comparisons.bench.methods import stored_keys
from stiction.comparisons.bench.participants import participants, variant
from stiction.comparisons.bench.presentation.cells import AGAIN, TRAJECTORY
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import Record, has_static_coefficient, job
from stiction.engines import Outcome, engine_names, load_engine
from stiction.reports.run_folder.data import SAMPLE_STEP, data_tables, thin, write_data
from stiction.reports.run_folder.reproduce import rerun_command
from stiction.scenes import load_scene
from stiction.truths.physics import physics_of


@pytest.fixture(scope="module")
def small(validation):
    """Two steps of one engine: figures show the one nearer to 1 ms."""
    fine, coarse = (
        replace(variant("paper's scheme"), ladder=(1e-2, 2.5e-3)),
        load_engine("reference").simulate(load_scene(CASE), t_end=9.0, dt=1e-2),
    )
    records = (validation.records[0], record(fine, 1e-2, value=coarse), *validation.records[1:])
    return replace(
        validation, records=records, settings={**validation.settings, "trajectories": "drawn"}
    )


@pytest.fixture(scope="module")
def folder(small, tmp_path_factory):
    path = tmp_path_factory.mktemp("stored")
    write_data(small, path, stored_keys(small))
    return path


def test_what_figures_show_is_stored_and_every_row_says_how_to_make_it(small, folder):
    runs = pd.read_parquet(folder / "data" / "runs.parquet").set_index("key")
    came_out = runs[runs["status"] == "ok"]
    coarse = f"{CASE}/paper's scheme/dt=0.01"
    assert set(came_out.index[came_out[TRAJECTORY].isna()]) == {coarse}
    # No command finds the engine "other", whose runs are made up.
    assert (came_out[AGAIN].notna() == came_out["engine"].isin(engine_names())).all()
    assert {
        path.relative_to(folder).as_posix() for path in (folder / "data" / "trajectories").iterdir()
    } == set(came_out[TRAJECTORY].dropna())
    for name, table in data_tables(small, stored_keys(small)).items():
        if TRAJECTORY in table:
            here = table[table["status"] == "ok"]
            assert (here[AGAIN].notna() == here["engine"].isin(engine_names())).all() and all(
                (folder / file).is_file() for file in here[TRAJECTORY].dropna()
            ), name


def test_an_engine_that_is_a_file_has_its_name_in_every_table(small, tmp_path):
    (tmp_path / "file.toml").write_text(
        tomli_w.dumps(
            {
                "name": "sled",
                "version": [sys.executable, "--version"],
                "command": [sys.executable, "{scene}", "{result}", "{dt}"],
            }
        )
    )
    mine = replace(
        small.records[0],
        variant=replace(small.records[0].variant, engine=str(tmp_path / "file.toml")),
    )
    tables = data_tables(replace(small, records=(mine,), timed=(), tables={}), ())
    assert [list(tables[name]["engine"]) for name in ("runs", "variants")] == [["sled"], ["sled"]]


def test_stored_runs_are_read_back_bit_by_bit(small, folder):
    files = data_tables(small, stored_keys(small))["runs"].set_index("key")[TRAJECTORY].dropna()
    for run in small.records:
        if run.key in files:
            pd.testing.assert_frame_equal(
                pd.read_parquet(folder / files[run.key]),
                thin(run.trajectory).to_frame(events=True, interpolated=True),
                check_exact=True,
            )


def test_fine_samples_are_thinned_and_events_are_not():
    run = load_engine("reference").simulate(
        load_scene(CASE), t_end=9.0, rtol=1e-9, output_step=2e-3
    )
    kept = thin(run)
    np.testing.assert_allclose(np.diff(kept.t), SAMPLE_STEP, rtol=1e-9)
    assert (
        kept.t[0] == 0
        and kept.t[-1] == run.t[-1]
        and kept.events == run.events
        and len(run.events) > 0
    )
    at = np.searchsorted(run.t, kept.t)
    assert all(np.array_equal(kept[name], run[name][at]) for name in run.columns)
    coarse = load_engine("reference").simulate(
        load_scene(CASE), t_end=0.55, dt=1e-2, output_step=0.05
    )
    assert np.array_equal(thin(coarse).t, coarse.t)


@pytest.mark.parametrize(
    "label, rung",
    [
        ("paper's scheme", 1e-2),
        ("trial and error", 1e-9),
        ("pymunk", 1e-2),
        ("Exudyn, contact", 4e-3),
    ],
)
def test_the_command_makes_the_same_run(label, rung, tmp_path, monkeypatch, in_this_process):
    [chosen] = [each for each in participants() if each.label == label]
    scene = physics_of(load_scene(CASE), has_static_coefficient(chosen))
    made = job(scene, chosen, rung)
    run = load_engine(chosen.engine).simulate(scene, **made.arguments)
    command = shlex.split(
        rerun_command(
            Record(made.label, CASE, chosen, rung, Outcome(made.label, "ok", run)),
            Results((), {}, {}),
        )
    )
    assert command[:2] == ["stiction", "run"]
    monkeypatch.chdir(tmp_path)
    invoke(*command[1:], "--out", "again.parquet", "--events")
    pd.testing.assert_frame_equal(
        pd.read_parquet("again.parquet"),
        run.to_frame(events=True, interpolated=True),
        check_exact=True,
    )


def test_an_effect_is_made_again_with_all_effects(small):
    run = small.records[0]
    effect = replace(run, key=f"{run.key}/no friction")
    assert rerun_command(effect, small) == f"stiction compare effects {CASE} --engines reference"
