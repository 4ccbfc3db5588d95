"""Findings of the commands: damage by the right line, nothing without damage, and a complete report of any engine."""

import json
import re
import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path

import pandas as pd
import pytest
from conftest import here, invoke, isolated_by

from stiction.cli.exit_codes import BAD_INPUT, COULD_NOT_RUN, FINE, NOT_COMPARED, REGRESSED
from stiction.comparisons.bench.campaign import load_campaign
from stiction.comparisons.bench.quantities import QUANTITIES, quantity_of
from stiction.comparisons.regression import older_code
from stiction.comparisons.regression.baseline import load_baseline
from stiction.comparisons.regression.check import IN_TURNS
from stiction.comparisons.regression.measurement import PATH
from stiction.comparisons.regression.nightly import HISTORY
from stiction.comparisons.regression.older_code import (
    STEPPING,
    TOTAL,
    ControlRefused,
    times_in_turns,
)
from stiction.engines.isolation import isolate
from stiction.engines.registry import ENGINES
from stiction.engines.shared.friction_bound import FrictionBound
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import vary
from stiction.truths import Tier

pytestmark = pytest.mark.usefixtures(
    "in_this_process"
)  # but for the night of broken engines, which is made before
ROOT = Path(__file__).parents[3]
SMALL = """
scenes = ["slider-bar-case-1"]
[variants.reference]
engine = "reference"
rtol = [1e-9]
settings = { stabilization = "projection" }
"""
DAMAGED = """
from stiction.engines import EngineFailure
from stiction.engines.reference.engine import ReferenceEngine

class OnlyNow(ReferenceEngine):
    def run(self, scene, **arguments):
        raise EngineFailure("gave up")
"""
BROKEN = """
scenes = ["block-on-incline"]
measure = ["accuracy", "event", "counter"]
[variants.right]
engine = "reference"
rtol = [1e-9]
[variants.uninstalled]
engine = "no_such_package_anywhere:Solver"
dt = [1e-2]
[variants.crashing]
engine = "damaged_solvers:Crashing"
rtol = [1e-9]
[variants.failing]
engine = "damaged_solvers:Failing"
rtol = [1e-9]
[variants."also right"]
engine = "damaged_solvers:Undamaged"
rtol = [1e-9]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "broken.toml").write_text(BROKEN)
    (tmp_path / "empty.toml").write_text("format = 2\n")
    return tmp_path


@pytest.fixture(scope="module")
def small_baseline(tmp_path_factory, compiled):
    """Of the small campaign on this machine."""
    place = tmp_path_factory.mktemp("baseline")
    (place / "small.toml").write_text(SMALL)
    with here(), pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        invoke("baseline", "update", "small.toml", "--file", "b.toml", "--reason", "first")
    return str(place / "b.toml")


KEYS = {
    quantity.head: quantity.key
    for quantity in (
        *QUANTITIES.values(),
        *map(quantity_of, ("end:slider.x", *map(IN_TURNS.format, (TOTAL, STEPPING)))),
    )
}


def lines(output: str) -> list[tuple[str, str]]:
    """First and second column of the table: severity, and the key of what is measured."""
    rows = [[cell.strip() for cell in row.split("|")] for row in output.splitlines()]
    return [(cells[1], KEYS.get(cells[2], cells[2])) for cells in rows if len(cells) > 7][2:]


@pytest.mark.parametrize(
    ("engine", "what"),
    [
        ("Slippery", {"events_missed", "event_time_error", "position_error", "velocity_error"}),
        ("WrongSign", {"status"}),
        ("LooseEvents", {"event_time_error"}),
    ],
)
def test_damage_is_caught_by_the_right_line(engine, what, folder, small_baseline):
    command = f"check small.toml --engine damaged_solvers:{engine} --baseline"
    ended = invoke(command, small_baseline, exit_code=REGRESSED)
    assert ended.output.startswith("**regression**"), ended.output
    regressions = [line for severity, line in lines(ended.output) if severity == "regression"]
    assert what <= set(regressions), ended.output
    if engine != "Slippery":  # which changes everything
        assert set(regressions) == what
    if engine == "LooseEvents":
        assert (
            "slider-bar-case-1/reference/rtol=1e-09" in ended.output and Tier.PROVEN in ended.output
        )


@pytest.mark.parametrize("engine", ["reference", "damaged_solvers:Undamaged"])
def test_no_damage_is_found_where_there_is_none(engine, folder, small_baseline):
    ended = invoke("check", "small.toml", "--baseline", small_baseline, "--engine", engine)
    assert {severity for severity, _ in lines(ended.output)} <= {"not judged"}, ended.output


@pytest.mark.usefixtures("compiled")
class TestControl:
    """Times in turns with the code before, here the same code; the times depend on the machine and are not tested."""

    def test_an_engine_is_timed_against_the_one_it_stands_for(self, folder, monkeypatch):
        monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "support"))
        monkeypatch.syspath_prepend(folder)
        (folder / "damaged.py").write_text(DAMAGED)
        (folder / "loose.toml").write_text(SMALL.replace("1e-9", "1e-6"))
        found = times_in_turns(
            [
                *load_campaign("small.toml").of_engine("damaged:OnlyNow").runs,
                *load_campaign("loose.toml").of_engine("damaged_solvers:Undamaged").runs,
            ],
            ROOT,
        )
        assert found.pop("slider-bar-case-1/reference/rtol=1e-09") == "now: EngineFailure: gave up"
        [ratios] = found.values()
        assert ratios[TOTAL] > 0 and ratios[STEPPING] > 0

    def test_folder_that_is_no_checkout(self, folder):
        ended = invoke(
            "check",
            "small.toml",
            "--baseline",
            "empty.toml",
            "--control",
            folder,
            exit_code=BAD_INPUT,
        )
        assert "--control" in ended.stderr
        assert "expected a checkout of stiction" in ended.stderr

    def test_process_that_dies_says_so(self, folder, monkeypatch):
        monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "support"))
        with pytest.raises(ControlRefused, match="exit code 7"):
            times_in_turns(
                load_campaign("small.toml").of_engine("damaged_solvers:Crashing").runs, ROOT
            )

    def test_code_that_hangs_is_given_up_and_started_again(self, folder, monkeypatch):
        monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "support"))
        monkeypatch.setattr("stiction.comparisons.regression.older_code.COMPILING", 0.0)
        [_, hanging] = load_campaign("small.toml").of_engine("damaged_solvers:Hanging").runs
        [_, fine] = load_campaign("small.toml").runs
        with closing(
            older_code._Code(
                ROOT,
                [older_code._task(run, run.variant, run.variant.engine) for run in (hanging, fine)],
                limit_s=0.5,
            )
        ) as code:
            assert code.timed(0) == code.timed(0) == "no result within 0.5 s"
            code._limit_s = 600.0  # no test hangs on the load of the machine
            assert code.timed(1)[TOTAL] > 0

    def test_verdict(self, folder, small_baseline, monkeypatch):
        (folder / "five.toml").write_text(SMALL.replace("[1e-9]", "[1e-5, 1e-6, 1e-7, 1e-8, 1e-9]"))
        monkeypatch.setattr(
            "stiction.comparisons.regression.measurement.relative_time",
            lambda call, repeats: (1.0, None),
        )
        for ratios, code in (
            ({TOTAL: 1.5, STEPPING: 1.0}, REGRESSED),
            ({TOTAL: 1.0, STEPPING: 1.5}, REGRESSED),
            ({TOTAL: 1.0, STEPPING: 1.0}, FINE),
        ):
            monkeypatch.setattr(
                "stiction.comparisons.regression.nightly.times_in_turns",
                lambda runs, before, limit_s: {run.key: ratios for run in runs},
            )
            ended = invoke(
                "check",
                "five.toml",
                "--baseline",
                small_baseline,
                "--control",
                ROOT,
                exit_code=code,
            )
            found = {metric for severity, metric in lines(ended.output) if severity == "regression"}
            assert found == {IN_TURNS.format(what) for what, ratio in ratios.items() if ratio > 1}


def test_update_refuses_to_touch_a_truth(folder, small_baseline):
    text = Path(small_baseline).read_text()
    true = next(line for line in text.splitlines() if line.startswith('truth."end:slider.x"'))
    moved = text.replace(true, re.sub(r"value = [^,]+", "value = 0.75", true))
    (folder / "moved.toml").write_text(moved)
    ended = invoke(
        "baseline update small.toml --file moved.toml --reason right", exit_code=REGRESSED
    )
    assert "slider-bar-case-1/truth: end:slider.x" in ended.stderr and Tier.PROVEN in ended.stderr
    assert (folder / "moved.toml").read_text() == moved
    assert (
        "truth"
        in invoke("check", "small.toml", "--baseline", "moved.toml", exit_code=REGRESSED).output
    )


def test_baseline_of_a_commit(folder, small_baseline):
    git = ["git", "-c", "user.name=A", "-c", "user.email=a@example.org"]
    shutil.copy(small_baseline, folder / "b.toml")
    for words in (["init", "-q"], ["add", "b.toml"], ["commit", "-qm", "baseline"]):
        subprocess.run([*git, *words], check=True, cwd=folder)
    assert load_baseline("HEAD:b.toml") == load_baseline(small_baseline)
    (folder / "b.toml").unlink()
    invoke("check", "small.toml", "--baseline", "HEAD:b.toml")


@pytest.fixture(scope="module")
def broken_night(tmp_path_factory, compiled):
    """A night with engines that are not installed, crash and fail between healthy ones."""
    place = tmp_path_factory.mktemp("night")
    (place / "broken.toml").write_text(BROKEN)
    (place / "empty.toml").write_text("format = 2\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        return place, invoke(
            "nightly broken.toml --baseline empty.toml --out out", exit_code=COULD_NOT_RUN
        )


class TestBrokenNight:
    def test_code_says_that_not_everything_could_be_run(self, broken_night):
        assert broken_night[1].stderr == ""

    def test_history_has_every_run(self, broken_night):
        frame = pd.read_sql(
            "SELECT * FROM history", sqlite3.connect(broken_night[0] / "out" / HISTORY)
        )
        status = frame.drop_duplicates("key").set_index("variant")["status"]
        assert dict(status) == {
            "truth": "ok",
            "right": "ok",
            "uninstalled": "missing",
            "crashing": "crashed",
            "failing": "failed",
            "also right": "ok",
        }
        right, also = (
            frame[(frame["variant"] == name)].set_index("metric")["value"]
            for name in ("right", "also right")
        )
        assert (right == also).all() and len(right) > 5
        assert set(frame["verdict"]) == {"could not run"}

    def test_report_and_summary_are_complete(self, broken_night):
        [night] = [path for path in (broken_night[0] / "out").iterdir() if path.is_dir()]
        report, summary = (
            (night / "report.md").read_text(),
            json.loads((night / "summary.json").read_text()),
        )
        for words in (
            "no_such_package_anywhere",
            "exit code 7",
            "Newton did not converge",
            quantity_of("position_error").head,
        ):
            assert words in report
        assert (summary["verdict"], summary["exit code"]) == ("could not run", COULD_NOT_RUN)
        assert summary["runs"] == {"ok": 3, "missing": 1, "crashed": 1, "failed": 1}
        assert {lost["key"].split("/")[1] for lost in summary["lost"]} == {
            "uninstalled",
            "crashing",
            "failing",
        }


def test_a_crash_where_the_baseline_has_none_is_a_regression(folder, small_baseline):
    """It is made in a child."""
    with isolated_by(isolate):
        ended = invoke(
            "check",
            "small.toml",
            "--baseline",
            small_baseline,
            "--engine",
            "damaged_solvers:Crashing",
            exit_code=REGRESSED,
        )
    assert "exit code 7" in ended.output, ended.output


def test_budget_of_the_campaign_leaves_rows_that_say_so(folder):
    longer = SMALL.replace("rtol = [1e-9]", "rtol = [1e-6, 1e-9]")
    (folder / "long.toml").write_text(longer + "[budget]\ntotal = 1e-9\n")
    invoke("nightly", "long.toml", "--baseline", "empty.toml", exit_code=COULD_NOT_RUN)
    frame = pd.read_sql(
        "SELECT * FROM history", sqlite3.connect(folder / "nightly" / HISTORY)
    ).drop_duplicates("key")
    assert (
        list(frame["status"]) == ["ok", "not run", "not run"]
        and "1e-09 s" in frame["reason"].iloc[-1]
    )


def test_nights_add_up(folder, small_baseline):
    for _ in range(3):
        invoke("nightly", "small.toml", "--baseline", small_baseline, "--out", "nights")
    frame = pd.read_sql("SELECT * FROM history", sqlite3.connect(folder / "nights" / HISTORY))
    assert frame["night"].nunique() == 3 and (frame.groupby(["key", "metric"]).size() == 3).all()
    assert len([path for path in (folder / "nights").iterdir() if path.is_dir()]) == 3
    invoke(
        f"baseline update small.toml --file of-nights.toml --reason night --night nights/{HISTORY}"
    )
    assert load_baseline("of-nights.toml").runs.keys() == load_baseline(small_baseline).runs.keys()


class TestWithoutABaseline:
    def night(self, *more: str, exit_code: int):
        return invoke(
            "nightly small.toml --baseline empty.toml --out nights", *more, exit_code=exit_code
        )

    def test_what_compared_nothing_says_so_and_fails(self, folder):
        check = invoke("check small.toml --baseline empty.toml", exit_code=NOT_COMPARED)
        for ended in (check, self.night(exit_code=NOT_COMPARED)):
            assert "**nothing was compared" in ended.output and "0 compared" in ended.output, (
                ended.output
            )
        [summary] = (folder / "nights").glob("*/summary.json")
        assert json.loads(summary.read_text())["compared"] == 0

    def test_the_second_night_is_held_to_the_first(self, folder):
        self.night(exit_code=NOT_COMPARED)
        second = self.night(exit_code=FINE)
        words = "1 compared with earlier results, namely with the night"
        assert words in second.output, second.output
        for _ in range(2):  # a worse night is nothing to be held to
            worse = self.night("--engine", "damaged_solvers:Slippery", exit_code=REGRESSED)
            assert quantity_of("position_error").head in worse.output, worse.output

    def test_a_first_night_without_a_run_holds_nobody(self, folder):
        """What failed in every night is no fine night."""
        (folder / "failing.toml").write_text(
            SMALL.replace('engine = "reference"', 'engine = "damaged_solvers:Failing"').replace(
                'settings = { stabilization = "projection" }', ""
            )
        )
        for _ in range(2):
            invoke(
                "nightly",
                "failing.toml",
                "--baseline",
                "empty.toml",
                "--out",
                "nights",
                exit_code=COULD_NOT_RUN,
            )


def test_an_update_measures_what_rounding_does(folder, small_baseline):
    [run] = [run for run in load_baseline(small_baseline).runs.values() if run.counter]
    assert all(
        number.rounding is not None
        for number in (
            *run.accuracy.values(),
            *run.drift.values(),
            *run.event.values(),
            *run.counter.values(),
        )
    )
    assert all(number.rounding is None for number in run.time.values())
    assert any(number.rounding for number in run.accuracy.values())
    invoke(
        "baseline update small.toml --file b.toml --reason x --whole --night h", exit_code=BAD_INPUT
    )


def test_an_update_of_the_whole_campaign(folder):
    both = SMALL.replace('"slider-bar-case-1"', '"block-on-incline", "pendulum"')
    (folder / "parts.toml").write_text(
        both + '[check]\nscenes = ["pendulum"]\nvariants = ["reference"]\n'
    )
    for option, scenes in ((), {"pendulum"}), (("--whole",), {"pendulum", "block-on-incline"}):
        invoke("baseline", "update", "parts.toml", "--file", "p.toml", "--reason", "x", *option)
        assert {key.partition("/")[0] for key in load_baseline("p.toml").runs} == scenes


CASE = '"slider-bar-case-1"'


@pytest.mark.parametrize(
    ("line", "culprits"),
    [
        ("nightly nosuch.toml", ["nosuch.toml", "No such file"]),
        (
            "nightly small.toml --baseline empty.toml --out small.toml",
            ["small.toml", "expected a folder"],
        ),
        ("check small.toml --baseline nosuch", ["nosuch", "git says", "COMMIT:PATH"]),
        ("check small.toml --baseline --help=x", ["--help=x", "git says"]),
        ("check small.toml --baseline small.toml", ["small.toml", "scenes"]),
        ("check small.toml --engine pymnk", ["pymnk", "did you mean 'pymunk'"]),
        ("check small.toml --history small.toml", ["--history", "small.toml"]),
        (
            "check small.toml --scenes nosuch",
            ["stiction: nosuch: 1 problem", "expected a TOML file"],
        ),
        ("baseline update small.toml", ["--reason"]),
        ("baseline update small.toml --file b.toml --reason=", ["--reason", "why"]),
        (
            "baseline update small.toml --file b.toml --reason x --night small.toml",
            ["--night", "small.toml"],
        ),
    ],
)
def test_bad_command(line, culprits, folder):
    ended = invoke(*line.split(), exit_code=BAD_INPUT)
    assert ended.stdout == "" and "Traceback" not in ended.output, ended.output
    for culprit in culprits:
        assert culprit in ended.output


def test_engine_that_is_not_installed_could_not_run(folder):
    command = "check small.toml --baseline empty.toml --engine no_such_package_anywhere:Solver"
    ended = invoke(command, exit_code=COULD_NOT_RUN)
    assert "no_such_package_anywhere" in ended.stderr


def test_campaign_of_the_suite_and_its_baseline_belong_together():
    campaign, expected = (
        load_campaign(),
        {key: run.identity for key, run in load_baseline().runs.items()},
    )
    # a scene, a setting or an engine that is another than in the baseline would go uncompared; extras do, until a night
    # where they are installed is taken into the baseline
    planned = {run.key: run.identity for run in campaign.runs}
    extras = {
        run.key
        for run in campaign.runs
        if run.variant is not None and run.variant.engine in ("mujoco", "drake", "dart", "newton")
    }
    assert planned.keys() - expected.keys() <= extras and expected.items() <= planned.items()


def test_a_check_has_a_run_of_every_engine_that_is_followed():
    campaign = load_campaign()
    runs = campaign.check_runs
    assert {run.key for run in runs} < {run.key for run in campaign.runs}
    engines = {run.variant.engine for run in runs if run.variant}
    assert (
        engines
        == {variant.engine for variant in campaign.variants}
        == {entry.name for entry in ENGINES if not entry.run_by_system}
    )
    [scene] = campaign.every
    assert all(
        run.followed == (run.scene.name == scene) for run in [*runs, *campaign.runs] if run.variant
    )
    brief = [
        run for run in runs if run.variant and run.variant.label not in campaign.check.variants
    ]
    assert {run.scene.name for run in brief} == {scene} and all(
        run.step == run.variant.ladder[0] for run in brief
    )


def test_an_engine_whose_friction_is_one_percent_off_is_found(folder, monkeypatch):
    (folder / "pymunk.toml").write_text(
        f'scenes = [{CASE}]\n[variants.pymunk]\nengine = "pymunk"\ndt = [1e-2]\n'
        f"[check]\nscenes = [{CASE}]\nvariants = []\nevery = [{CASE}]\n"
    )
    invoke("baseline", "update", "pymunk.toml", "--file", "b.toml", "--reason", "first")
    invoke("check", "pymunk.toml", "--baseline", "b.toml")
    kept = FrictionBound.__init__

    def damaged(self, mechanism, *others, **options):
        scene, guide = mechanism.scene, mechanism.scene.guides["guide"]
        kept(
            self,
            Mechanism(
                vary(scene, {"guide.mu": 1.01 * guide.mu, "guide.mus": 1.01 * guide.mus}), "none"
            ),
            *others,
            **options,
        )

    monkeypatch.setattr(FrictionBound, "__init__", damaged)
    ended = invoke("check", "pymunk.toml", "--baseline", "b.toml", exit_code=REGRESSED)
    assert ("regression", PATH) in lines(ended.output), ended.output


EULER = """
import numpy as np
from stiction.engines.pymunk.engine import PymunkEngine
from stiction.engines import Capabilities, Engine
from stiction import Trajectory, recover_columns
from stiction.scenes.columns import BODY_COLUMNS


class Euler(Engine):
    '''A block that slides down an incline: the end of a step moves it, or its beginning (`explicit`).'''

    name, version, explicit = "euler", "1", False
    capabilities = Capabilities(fidelities=("joint",), static_coefficient={"joint": True}, friction_law={"joint": "Coulomb"}, reactions="momentum balance", order="1")

    def refusal(self, scene, fidelity):
        return None

    def run(self, scene, *, t_end, dt, rtol, fidelity, output_step, settings):
        [guide], [body] = scene.guides.values(), scene.bodies.values()
        (dx, dy), g = guide.direction, scene.gravity[1]
        a = g * dy - guide.mu * abs(g * dx)
        n = round(t_end / dt)
        s = v = 0.0
        way, speed = [0.0], [0.0]
        for _ in range(n):
            old, v = v, v + dt * a
            s += dt * (old if self.explicit else v)
            way.append(s), speed.append(v)
        motion = [np.outer(values, [dx, dy, 0.0]) for values in (way, speed, np.full(n + 1, a))]
        motion[0] += [*body.position, body.angle]
        t = dt * np.arange(n + 1)
        return Trajectory(scene.name, self.name, self.version, fidelity, t, recover_columns(scene, t, *motion), settings={"dt": dt})


class Explicit(Euler):
    explicit = True
"""


def test_a_step_that_ends_on_the_other_side_of_the_truth_is_found(folder, monkeypatch):
    """Errors of explicit and semi-implicit Euler have one size, and velocities are equal: only positions tell."""
    (folder / "euler_solvers.py").write_text(EULER)
    monkeypatch.syspath_prepend(folder)
    campaign = 'scenes = ["block-on-incline"]\n[variants.mine]\nengine = "euler_solvers:Euler"\ndt = [1e-2]\n'
    (folder / "mine.toml").write_text(campaign)
    invoke("baseline", "update", "mine.toml", "--file", "b.toml", "--reason", "first")
    invoke("check", "mine.toml", "--baseline", "b.toml")
    ended = invoke(
        "check",
        "mine.toml",
        "--baseline",
        "b.toml",
        "--engine",
        "euler_solvers:Explicit",
        exit_code=REGRESSED,
    )
    assert ("regression", "end:slider.x") in lines(ended.output), ended.output


def test_a_baseline_without_end_positions_is_accepted_with_a_note(folder, small_baseline):
    text = Path(small_baseline).read_text().splitlines()
    (folder / "old.toml").write_text(
        "\n".join(line for line in text if not line.startswith("motion.")) + "\n"
    )
    ended = invoke("check", "small.toml", "--baseline", "old.toml", exit_code=FINE)
    assert (
        "1 runs or numbers are not in the baseline: nights hold them to the first night"
        in ended.output
    ), ended.output


def test_a_campaign_of_ones_own_is_not_held_to_the_baseline_of_the_suite(folder):
    """Though the run has the identity of one of the suite's."""
    (folder / "a.toml").write_text(
        f'scenes = [{CASE}]\nmeasure = ["accuracy", "motion"]\n[variants.pymunk]\nengine = "pymunk"\ndt = [1e-2]\n'
    )
    assert "0 compared" in invoke("nightly", "a.toml", "--out", "n", exit_code=NOT_COMPARED).output
    assert "1 compared" in invoke("nightly", "a.toml", "--out", "n", exit_code=FINE).output
    assert "0 compared" in invoke("check", "a.toml", exit_code=NOT_COMPARED).output
