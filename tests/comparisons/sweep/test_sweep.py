"""A sweep is the same whoever computes it and however often it is interrupted; what fails is a row."""

import json
import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pandas as pd
import pytest
from conftest import called_here, content, invoke
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from stiction.cli.exit_codes import BAD_INPUT
from stiction.comparisons.bench.executors import open_isolate
from stiction.comparisons.bench.presentation.cells import intervals_of
from stiction.comparisons.bench.store import kept_file
from stiction.comparisons.measures.reference_bands import ReferenceBands
from stiction.comparisons.measures.settling import NotSettled
from stiction.comparisons.measures.steady_state_measures import MEASURES, SteadyRun, steady_window
from stiction.comparisons.sweep import points
from stiction.comparisons.sweep.axes import SweepAxis, parse_axis
from stiction.comparisons.sweep.sweep import Specification, SweepRefused, sweep
from stiction.engines import Outcome
from stiction.reports.figures.style import rc
from stiction.reports.figures.sweep_figures import sweep_drawings
from stiction.scenes import SceneError, load_scene, scene_from_dict
from stiction.truths.bands import Band, BandKind

CASE_1 = load_scene("slider-bar-case-1")


def specification(
    *axes,
    measures=("stick-fraction", "peak-torque"),
    scene=CASE_1,
    settle=40.0,
    t_end=160.0,
    timeout_s=600.0,
    **run,
):
    run = SteadyRun(settle, t_end, **run)
    return Specification(scene, tuple(map(parse_axis, axes)), tuple(measures), run, timeout_s)


def row_of(specification, part, index):
    task = specification.tasks(part)[index]
    return task.function(*task.args)


GRID = specification(
    "F0=1:6:6", "motor.rate=pi/8,pi/4,pi/2", measures=("stick-fraction", "threshold")
)
RATES = [np.pi / 8, np.pi / 4, np.pi / 2]


class Here:
    """Computes at once in this process; gives up after `limit` tasks."""

    def __init__(self, limit=None):
        self.limit, self.computed = limit, []

    def __call__(self, tasks, *, on_result, **_):
        for task in tasks:
            if self.limit is not None and len(self.computed) >= self.limit:
                raise KeyboardInterrupt
            self.computed.append(task)
            called_here([task], on_result=on_result)


def swept_here(folder, *axes, **about):
    return sweep(specification(*axes, **about), folder / "swept", made_by=Here())


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep") / "grid"
    return sweep(GRID, folder, made_by=Here()), folder


def test_same_bytes_for_any_number_of_workers(here, tmp_path):
    """None, and two."""
    sweep(GRID, tmp_path / "grid", workers=2)
    assert content(tmp_path / "grid") == content(here[1])


def test_rows_are_the_grid_in_order(here):
    result, _ = here
    expected = [(F0, rate) for F0 in np.linspace(1, 6, 6) for rate in RATES]
    assert list(zip(result.map["F0"], result.map["motor.rate"])) == expected
    assert list(result.threshold["motor.rate"]) == RATES


def test_threshold_separates_the_map(here):
    """Bisection and map look at the same motions: every point of the map is on its side of a bracket."""
    result, _ = here
    found = result.threshold[result.threshold["status"] == "ok"]
    assert (
        len(found) >= 2
        and (result.threshold["reason"][result.threshold["status"] != "ok"] != "").all()
    )
    for row in found.to_dict("records"):
        column = result.map[result.map["motor.rate"] == row["motor.rate"]]
        assert (column.loc[column["F0"] >= row["without_stick"], "stick-fraction"] == 0).all()
        assert (column.loc[column["F0"] <= row["with_stick"], "stick-fraction"].iloc[-1]) > 0
        assert row["with_stick"] < row["threshold"] < row["without_stick"]


def test_goes_on_after_an_interruption(here, tmp_path):
    folder, broken = tmp_path / "grid", Here(limit=2)
    with pytest.raises(KeyboardInterrupt):
        sweep(GRID, folder, made_by=broken)
    with closing(sqlite3.connect(kept_file(folder))) as database:
        [kept] = database.execute("SELECT count(*) FROM outcomes").fetchone()
    assert kept == 2 and not (folder / "map.parquet").exists()
    left, planned, told = Here(), [], []
    sweep(GRID, folder, made_by=left, on_start=planned.append, on_result=told.append)
    assert (
        planned
        == [len(told)]
        == [len(GRID.tasks("map")) + len(GRID.tasks("threshold"))]
        == [len(left.computed) + kept]
    )
    assert content(folder) == content(here[1]) and not kept_file(folder).exists()
    again = Here()
    sweep(GRID, folder, made_by=again)
    assert again.computed == []


def test_computes_what_was_lost_or_cut_off(here, tmp_path):
    folder = shutil.copytree(here[1], tmp_path / "grid")
    (folder / "map.parquet").unlink()
    repaired = Here()
    sweep(GRID, folder, made_by=repaired)
    assert len(repaired.computed) == len(GRID.tasks("map")) and content(folder) == content(here[1])
    (folder / "threshold.parquet").write_bytes((folder / "threshold.parquet").read_bytes()[:100])
    repaired = Here()
    sweep(GRID, folder, made_by=repaired)
    assert len(repaired.computed) == len(GRID.tasks("threshold")) and content(folder) == content(
        here[1]
    )


LOST = {2: ("timed out", "no result within 20 s"), 4: ("crashed", "SIGABRT: out of cheese")}
"""Ends of the third and the fifth point."""


def test_a_point_that_hangs_or_crashes_costs_only_itself(tmp_path):
    def treacherous(tasks, *, timeout_s, on_result, **_):
        assert timeout_s == 20.0
        for i, task in enumerate(tasks):
            if i in LOST:
                on_result(Outcome(task.label, LOST[i][0], reason=LOST[i][1]))
            else:
                called_here([task], on_result=on_result)

    swept = specification("F0=1:6:6", timeout_s=20.0)
    found = sweep(swept, tmp_path / "a", made_by=treacherous).map
    alone = sweep(swept, tmp_path / "b", made_by=Here()).map
    lost = found["F0"].isin([3, 5])
    assert found["F0"].tolist() == [1, 2, 3, 4, 5, 6]
    assert found.loc[lost, ["status", "reason"]].values.tolist() == list(map(list, LOST.values()))
    assert found.loc[lost, "stick-fraction"].isna().all()
    pd.testing.assert_frame_equal(found[~lost], alone[~lost])


def test_another_sweep_in_the_folder_is_refused(here, tmp_path):
    other = specification(
        "F0=1:6:6", "motor.rate=pi/8,pi/4,pi", measures=("stick-fraction", "threshold")
    )
    with pytest.raises(SweepRefused, match=r"differs in axes\.motor\.rate"):
        sweep(other, here[1], made_by=Here())
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(SweepRefused, match="found files but no sweep.json"):
        sweep(GRID, tmp_path, made_by=Here())
    with pytest.raises(SweepRefused, match="found a file"):
        sweep(GRID, tmp_path / "letter.txt", made_by=Here())
    assert (tmp_path / "letter.txt").read_text() == "mine"


@pytest.mark.parametrize(
    "change",
    [
        dict(scene=load_scene("slider-bar-case-1", {"guide.mus": 0.05})),
        dict(t_end=161.0),
        dict(settle=41.0),
        dict(measures=["peak-torque"]),
        dict(engine="pymunk"),
        dict(dt=1e-3),
    ],
    ids=lambda change: next(iter(change)),
)
def test_digest_covers(change):
    assert (
        specification("F0=1,2", **change).digest
        != specification("F0=1,2").digest
        == specification("F0=1,2").digest
    )


def test_a_folder_of_other_code_is_refused(here, monkeypatch):
    """Constants of the measures are code."""
    monkeypatch.setattr("stiction.comparisons.sweep.sweep.source_digest", lambda: "other")
    with pytest.raises(SweepRefused, match="differs in code"):
        sweep(specification("F0=1,2"), here[1], made_by=Here())


def test_failing_points_are_rows(tmp_path, monkeypatch):
    result = swept_here(tmp_path, "guide.mu=-1,0.02,0.03,1").map
    assert list(result["status"]) == ["refused", "ok", "ok", "refused"]
    assert (
        "expected a number >= 0" in result["reason"][0]
        and "expected at least mu" in result["reason"][3]
    )
    assert result["stick-fraction"].isna().tolist() == [True, False, False, True]
    monkeypatch.setattr("stiction.comparisons.measures.steady_state_measures.STEP_LIMIT", 5)
    row = row_of(specification("F0=3"), "map", 0)
    assert row["status"] == "failed" and "step limit" in row["reason"]


RANGES = {
    "F0": (0.5, 6),
    "Omega": (1, 2),
    "load.phase": (-1, 1),
    "mu": (-0.01, 0.04),
    "guide.mus": (0.02, 0.1),
    "m1": (0.5, 5),
    "slider.mass": (1e-6, 5),
    "spring.stiffness": (0, 5),
    "L": (1, 3),
    "guide.width": (0, 0.5),
    "pin.points.0.0": (-1.2, -0.8),
    "bar.position.0": (1, 1.5),
    "slider.velocity.0": (-0.2, 0.2),
    "motor.rate": (0.4, 1),
    "gravity.1": (-10, 0),
    "stabilization.alpha": (0, 90),
    "t_end": (1, 9),
}


@st.composite
def axes_of_two(draw):
    keys = draw(st.lists(st.sampled_from(sorted(RANGES)), min_size=1, max_size=3, unique=True))
    values = [
        draw(st.lists(st.floats(*RANGES[key]), min_size=2, max_size=2, unique=True)) for key in keys
    ]
    return tuple(map(SweepAxis, keys, map(tuple, values)))


@settings(max_examples=15, deadline=None)
@given(
    axes_of_two(), st.sampled_from(["slider-bar-case-1", "slider-bar-case-2", "slider-bar-case-3"])
)
def test_a_point_is_the_scene_run_alone_to_the_bit(axes, name):
    """Read from its file with the same overrides; where that is refused, the point says the same."""
    run = SteadyRun(10.0, 160.0)
    measures = [measure for measure in MEASURES.values() if not measure.from_start]

    def alone(point):
        try:
            window = steady_window(load_scene(name, point), run, measures)
            numbers = {measure.column: measure.value(window).hex() for measure in measures}
            return {"status": "ok", "reason": "", **numbers}
        except Exception as error:
            statuses = {NotSettled: "no steady state", SceneError: "refused", Exception: "failed"}
            return {
                "status": next(
                    status for kind, status in statuses.items() if isinstance(error, kind)
                ),
                "reason": " ".join(f"{type(error).__name__}: {error}".split()),
            }

    try:
        names = tuple(measure.name for measure in measures)
        swept = Specification(load_scene(name), axes, names, run)
    except SceneError:  # an axis without any value that the scene can have
        reject()
    for index, point in enumerate(swept.points("map")):
        row = row_of(swept, "map", index)
        found = {key: value.hex() if key in MEASURES else value for key, value in row.items()}
        expected = point | alone(point)
        assert {key: found[key] for key in expected} == expected


def test_thresholds_say_where_the_slider_sticks_again(tmp_path):
    """Of mu = 0.015 and 0.01 (mus = 0.04), and not of 0.03; the command prints it."""
    ended = sweep_command(
        "--vary", "mu=0.01,0.015,0.03", "--measure", "threshold", "--out", str(tmp_path / "out")
    )
    table = pd.read_parquet(tmp_path / "out" / "threshold.parquet")
    bands = [[end for band in intervals_of(text) for end in band] for text in table["sticks_again"]]
    assert (
        bands[0] == pytest.approx([4.33, 4.71], abs=0.03)
        and bands[1] == pytest.approx([3.77, 4.55], abs=0.03)
        and bands[2] == []
    )
    assert np.all(table["scanned_to"] > 2.4 * table["threshold"])
    assert ended.count("the slider sticks again at about") == 2


def test_threshold_that_is_not_in_the_range_is_a_row(tmp_path):
    result = swept_here(tmp_path, "F0=5:6:2", measures=["threshold"]).threshold
    assert (
        list(result["status"]) == ["not found"]
        and "no stick phase at F0 = 5 N" in result["reason"][0]
    )


@pytest.mark.parametrize(
    "text, expected",
    [
        ("F0", "KEY=FROM:TO:COUNT"),
        ("=1:2:3", "KEY=FROM:TO:COUNT"),
        ("F0=", "KEY=FROM:TO:COUNT"),
        ("F0=1:2", "FROM:TO:COUNT"),
        ("F0=1:2:3:4", "FROM:TO:COUNT"),
        ("F0=1:2:2.5", "whole number"),
        ("F0=1:2:1", "whole number"),
        ("F0=1:2:-3", "whole number"),
        ("F0=1:2:1e12", "whole number"),
        ("F0=1:1:5", "differ"),
        ("F0=1,2,1", "differ"),
        ("F0=one:2:3", "unknown name"),
        ("F0=1,,2", "expected a number"),
        ("F0=1/0:2:3", "divides by zero"),
        ("F0=3-6", "found '3-6', which is the single value -3; expected a range FROM:TO:COUNT"),
        ("motor.rate=pi/2", "FROM:TO:COUNT"),
    ],
)
def test_bad_axes(text, expected):
    with pytest.raises(ValueError, match=expected):
        parse_axis(text)


def test_axes():
    assert parse_axis("F0=-3").values == (-3.0,)
    assert parse_axis("motor.rate=pi/4:pi/2:3").values == (np.pi / 4, 3 * np.pi / 8, np.pi / 2)
    assert parse_axis(" F0 = 3, 2^2 ").values == (3.0, 4.0) and parse_axis("F0=6:1:2").values == (
        6.0,
        1.0,
    )
    assert parse_axis("mu=0:0.3:7").values == (
        0.0,
        0.05,
        0.1,
        0.15,
        0.2,
        0.25,
        0.3,
    )  # none is 0.15000000000000002


@given(st.floats(-10, 10), st.floats(-10, 10), st.integers(2, 50))
def test_values_of_an_axis_are_equally_spaced_to_rounding(low, high, count):
    if low != high and len(set(np.linspace(low, high, count))) == count:
        values = np.array(parse_axis(f"F0={low!r}:{high!r}:{count}").values)
        assert np.all(
            np.abs(values - np.linspace(low, high, count))
            <= 2 * np.spacing(np.abs(np.linspace(low, high, count)))
        )


INCLINE = load_scene("block-on-incline")


@pytest.mark.parametrize(
    "change, expected",
    [
        (dict(measures=[]), "measures: found none"),
        (dict(measures=["speed"]), "expected some of stick-fraction"),
        (dict(settle=160.0), "settle < t_end"),
        (
            dict(measures=["peak-speed:wheel"]),
            "peak-speed: found 'wheel'; expected one of guide, bar, slider",
        ),
        (
            dict(measures=["stick-fraction:bar"]),
            "stick-fraction: found 'bar'; expected one of guide",
        ),
        (dict(measures=["event-count:guide"]), "found 'event-count:guide'"),
        (dict(measures=["peak-speed:"]), "found 'peak-speed:'"),
        (dict(scene=load_scene("four-bar")), "stick-fraction: found no frictional joints"),
        (dict(scene=INCLINE, measures=["peak-torque"]), "peak-torque: found no drives"),
        (dict(scene=INCLINE, measures=["threshold"]), "and a parameter F0"),
        (dict(scene=INCLINE, measures=["event-count"]), "F0: found no such key"),
        (dict(engine="nobody"), "engine: found 'nobody'"),
        (dict(fidelity="contact"), "reference has joint"),
    ],
)
def test_bad_specifications(change, expected):
    with pytest.raises((ValueError, SceneError), match=expected):
        specification("F0=1,2", **change)


def test_map_is_drawn_with_its_threshold(here):
    with rc():
        drawing, curve, bands = sweep_drawings(here[0])
    assert curve.name == "curve-threshold" and bands.name == "map-bands"
    [ax, bar] = drawing.figure.axes
    labels = ax.get_xlabel(), ax.get_ylabel(), bar.get_ylabel()
    assert labels == ("F0 [N]", "motor.rate [rad/s]", "stick-fraction")
    assert np.array_equal(ax.lines[0].get_xdata(), here[0].threshold["threshold"], equal_nan=True)


@pytest.fixture(scope="module")
def shaken():
    """A sledge on a slope of 0.2 that a force shakes along it.

    It stays for ever, or goes down a way in each period, faster and faster with little friction.
    """
    slope = ["cos(slope)", "sin(slope)"]
    return scene_from_dict(
        {
            "t_end": 10,
            "gravity": [0, -9.81],
            "parameters": {"shake": 8, "mu": 0.15, "slope": 0.2},
            "bodies": {"sledge": {"mass": 2, "inertia": 0.1, "angle": "slope"}},
            "joints": {
                "track": {
                    "type": "translational",
                    "slider": "sledge",
                    "direction": slope,
                    "angle": "slope",
                    "mu": "mu",
                    "mus": 0.4,
                }
            },
            "forces": {
                "hand": {
                    "type": "force",
                    "body": "sledge",
                    "direction": slope,
                    "law": {"type": "sine", "amplitude": "shake", "frequency": "pi"},
                }
            },
        },
        "sledge",
    )


def test_a_slider_that_goes_away_has_no_steady_state(shaken, tmp_path):
    """Held up to m g (mus cos - sin) = 3.8 N.

    With mu below tan it never stops again once it has begun to slide. With mu above, it does in each period: its place
    is another one each time, and makes no difference.
    """
    result = swept_here(
        tmp_path,
        "shake=1,3,6,9",
        "mu=0.15,0.3",
        measures=["peak-speed", "stick-fraction"],
        scene=shaken,
        settle=4.0,
        t_end=30.0,
    )
    rows = {(row["shake"], row["mu"]): row for row in result.map.to_dict("records")}
    for (shake, mu), row in rows.items():
        if shake <= 3.0:
            assert (row["status"], row["stick-fraction"]) == ("ok", 1.0) and row[
                "peak-speed"
            ] < 1e-9
        elif mu == 0.15:
            assert row["status"] == "no steady state" and "does not repeat itself" in row["reason"]
            assert np.isnan(row["peak-speed"])
        else:
            assert (
                row["status"] == "ok"
                and row["peak-speed"] > 0.1
                and 0.0 < row["stick-fraction"] < 1.0
            )
    with rc():
        drawings = list(sweep_drawings(result))
    assert all(
        "points without a number: 2 no steady state, white" in drawing.caption
        for drawing in drawings
    )


def sweep_command(*arguments, **options):
    return invoke("sweep", "slider-bar-case-1", *arguments, **options).output


def test_command(tmp_path):
    folder = tmp_path / "out"
    arguments = [
        "--vary",
        "F0=2:4:2",
        "--vary",
        "motor.rate=pi/4,pi/2",
        "--measure",
        "stick-fraction,event-count",
        "--t-end",
        "120",
        "--workers",
        "1",
        "--out",
        str(folder),
    ]
    assert "stick-fraction" in sweep_command(*arguments)
    assert {
        "map.parquet",
        "map.csv",
        "map-stick-fraction.png",
        "map-stick-fraction.pdf",
        "map-event-count.png",
        "sweep.json",
    } <= {path.name for path in folder.iterdir()}
    assert len(pd.read_parquet(folder / "map.parquet")) == 4
    assert json.loads((folder / "sweep.json").read_text())["settings"]["settle"] == 40.0
    assert "settings.t_end" in sweep_command(*arguments, "--t-end", "121", exit_code=BAD_INPUT)


def test_slipping_everywhere_is_an_answer_without_a_figure_of_thresholds(tmp_path):
    """The command succeeds; the map of bands shows that the slider slips, and no figure is empty."""
    folder = tmp_path / "out"
    sweep_command(
        *("--vary", "F0=5:6:2", "--vary", "k=1.0,1.01", "--measure", "threshold"),
        *("--workers", "1", "--out", str(folder)),
    )
    table = pd.read_parquet(folder / "threshold.parquet")
    assert list(table["status"]) == ["not found"] * 2 and table["threshold"].isna().all()
    assert {kind for text in table["all_bands"] for *_, kind in json.loads(text)} == {"slips"}
    names = {path.name for path in folder.iterdir()}
    assert "map-bands.png" in names and "curve-threshold.png" not in names


def test_without_any_steady_state_it_is_not_known_whether_the_slider_sticks(monkeypatch):
    """No stick phase was seen, and yet this is no answer."""
    unknown = Band(5.0, 6.0, BandKind.UNSETTLED, 0.0, 0.0)
    monkeypatch.setattr(
        points, "bands_from_own_start", lambda *_: ReferenceBands((unknown,), {}, "")
    )
    row = row_of(specification("F0=5:6:2", measures=["threshold"]), "threshold", 0)
    assert row["status"] == "no steady state" and "5 N to 6 N" in row["reason"]


@pytest.mark.parametrize(
    "arguments, words",
    [
        ("F0=1:2", "FROM:TO:COUNT"),
        ("FO=1,2", "no such key"),
        ("guide.mu=-1,-2", "expected a number >= 0"),
        ("F0=1,2 --settle -1", "expected a number > 0"),
        ("F0=1,2 --executor threads", "expected processes"),
        ("F0=1,2 --engine nobody", "found 'nobody'"),
        ("F0=1,2 --timeout 0", "--timeout"),
        ("F0=1,2 --engine moreau", "moreau has contact"),
        ("F0=1,2 --workers 0", "--workers"),
        ("F0=1,2 --vary F0=3,4", "each key once"),
    ],
)
def test_bad_command_lines(arguments, words, tmp_path):
    folder = tmp_path / "out"
    printed = sweep_command(
        "--vary",
        *arguments.split(),
        "--measure",
        "stick-fraction",
        "--out",
        str(folder),
        exit_code=BAD_INPUT,
    )
    assert words in printed and not folder.exists()


@pytest.mark.long
def test_dask_computes_the_same(here, tmp_path):
    """On a cluster of this machine, and on the same one by its address."""
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with open_isolate("dask", 2) as made_by:
        sweep(GRID, tmp_path / "own", made_by=made_by)
    with (
        dask.config.set({"distributed.worker.daemon": False}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        open_isolate(f"dask:{cluster.scheduler_address}") as made_by,
    ):
        sweep(GRID, tmp_path / "addressed", made_by=made_by)
    assert content(tmp_path / "own") == content(tmp_path / "addressed") == content(here[1])
