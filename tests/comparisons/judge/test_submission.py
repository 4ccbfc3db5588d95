"""Submissions to the friction benchmark: right ones are within bounds, and wrong ones get the sentence that says why."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import invoke

from stiction.comparisons.judge.benchmark import FOLDER, benchmark_scenes
from stiction.comparisons.judge.submission import Verdict, judge_submission, read_submission
from stiction.engines import load_engine
from stiction.scenes import FileError, vary
from stiction.scenes.resolved import load_resolved

DESCRIPTION = """\
benchmark = "friction-benchmark 1"
who = "a test"
engine = "solver"
version = "1"
fidelity = "joint"
machine = "this one"
command = "none"
"""
SUBMISSIONS = Path(__file__).parents[3] / "submissions"
SCENES = {scene.name: scene for scene in benchmark_scenes()}
STATES = ("x", "y", "angle", "vx", "vy", "omega")


def scene_of(name):
    return load_resolved((SCENES[name].folder / "scene.json").read_text())


def states(scene):
    return ["t", *(f"{body}.{label}" for body in scene.bodies for label in STATES)]


def solved(name, changes=None):
    """The states of a scene with other values, by the reference."""
    scene = vary(scene_of(name), changes or {})
    run = load_engine("reference").simulate(scene, rtol=1e-9, output_step=SCENES[name].max_step)
    return run.to_frame()[states(scene)]


@pytest.fixture
def submit(compiled, tmp_path):
    """Judges tables, by scene, as a submission; returns the rows with a table by scene."""

    def judged(tables, description=DESCRIPTION):
        for name, table in tables.items():
            table.to_csv(tmp_path / f"{name}.csv", index=False)
        (tmp_path / "submission.toml").write_text(description)
        table = judge_submission(tmp_path).table.set_index("scene")
        return table.loc[list(tables)]

    return judged


def truth(name):
    return pd.read_parquet(SCENES[name].folder / "truth.parquet")


def test_the_truths_are_within_bounds(submit):
    rows = submit({name: truth(name) for name in SCENES})
    # the rows of a truth may be further from each other than those of a result
    assert set(rows["verdict"]) <= {Verdict.WITHIN, Verdict.TOO_COARSE}
    assert (rows["position_error"] <= 1e-9).all()
    assert (rows["stick_missed"] == 0).all() and (rows["stick_invented"] == 0).all()


ONE_PER_CENT = {
    "slider-bar-case-1": Verdict.OTHER_PARAMETERS,
    "mass-on-belt": Verdict.BEYOND,
    "block-on-incline": Verdict.BEYOND,
    "ramp-level": Verdict.BEYOND,
    "stop-level": Verdict.BEYOND,
    "elliptic-trammel": Verdict.BEYOND,
}


@pytest.mark.parametrize("name", ONE_PER_CENT)
def test_mu_one_per_cent_off(submit, name):
    changes = {}
    for guide, joint in scene_of(name).frictional_guides.items():
        changes[f"{guide}.mu"] = 1.01 * joint.mu
        changes[f"{guide}.mus"] = 1.01 * joint.static_coefficient
    row = submit({name: solved(name, changes)}).loc[name]
    assert row["verdict"] == ONE_PER_CENT[name]
    assert row["position_error"] > 2 * row["position_bound"]
    if row["verdict"] == Verdict.OTHER_PARAMETERS:
        assert row["other_parameter"] == "another mu and mus"
        assert row["other_value"] == pytest.approx(0.0303, rel=1e-4)
        assert "another mu and mus (0.0303)" in row["reason"]


def without_events(name, dt=1e-3):
    """A block under friction mu m g sign(v), by Heun's method with a fixed step: it neither sticks nor locates events."""
    scene = scene_of(name)
    [(slider, body)] = scene.bodies.items()
    [guide] = scene.guides.values()
    pull = scene.forces["pull"].law
    direction = np.array(guide.direction)
    weight = np.array(scene.gravity) * body.mass
    load = abs(weight @ [-direction[1], direction[0]])

    def acceleration(t, v):
        driving = pull.offset + pull.rate * t + weight @ direction
        return (driving - guide.mu * load * np.sign(v)) / body.mass

    times = np.arange(round(scene.t_end / dt) + 1) * dt
    x, v = 0.0, float(np.array(body.velocity) @ direction)
    rows = []
    for t in times:
        rows.append((t, *(direction * x), *(direction * v)))
        first = acceleration(t, v)
        second = acceleration(t + dt, v + dt * first)
        x += dt * v + dt**2 / 2 * first
        v += dt / 2 * (first + second)
    return pd.DataFrame(
        rows, columns=["t", *(f"{slider}.{label}" for label in ("x", "y", "vx", "vy"))]
    )


@pytest.mark.parametrize("name", ["hold-level", "ramp-level", "stop-level", "stop-incline"])
def test_events_ignored(submit, name):
    row = submit({name: without_events(name)}).loc[name]
    # Under the growing pull the motion is that without a static coefficient, which is named.
    expected = Verdict.OTHER_PARAMETERS if name == "ramp-level" else Verdict.BEYOND
    assert row["verdict"] == expected
    assert row["stick_missed"] == 1
    assert "1 of 1 stick phases missed: a joint moves that is at rest in the truth" in row["reason"]


def test_millimetres_and_degrees(submit):
    names = ["slider-bar-case-1", "block-on-incline", "stop-level"]
    tables = {}
    for name in names:
        table = solved(name)
        lengths = [column for column in table if column.endswith((".x", ".y", ".vx", ".vy"))]
        tables[name] = table.assign(**{column: 1e3 * table[column] for column in lengths})
    degrees = solved("pendulum-dry-pin")
    turns = [column for column in degrees if column.endswith((".angle", ".omega"))]
    tables["pendulum-dry-pin"] = degrees.assign(
        **{column: np.rad2deg(degrees[column]) for column in turns}
    )
    rows = submit(tables)
    assert (rows["verdict"] == Verdict.OTHER_UNITS).all()
    assert rows.loc[names, "off_factor"].tolist() == [1e3] * 3
    assert rows.loc["pendulum-dry-pin", "off_factor"] == pytest.approx(180 / np.pi)
    assert "millimetres in place of metres" in rows.loc["stop-level", "reason"]
    assert "degrees in place of radians" in rows.loc["pendulum-dry-pin", "reason"]


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        (lambda table: table, Verdict.WITHIN),
        (lambda table: table[["t", "slider.x"]], Verdict.WITHIN),
        (lambda table: table.iloc[::2], Verdict.TOO_COARSE),
        (lambda table: table[table["t"] < 0.3], Verdict.INCOMPLETE),
        (lambda table: table[["t", "slider.y"]], Verdict.NOT_JUDGED),
        (lambda table: table.rename(columns={"slider.x": "slider.pos"}), Verdict.NOT_A_TABLE),
        (lambda table: table.assign(**{"slider.x": np.nan}), Verdict.NOT_A_TABLE),
        (lambda table: table.drop(columns="t"), Verdict.NOT_A_TABLE),
        (lambda table: table.assign(**{"slider.x": -table["slider.x"]}), Verdict.OTHER_UNITS),
    ],
)
def test_tables(submit, change, verdict):
    row = submit({"stop-level": change(solved("stop-level"))}).loc["stop-level"]
    assert row["verdict"] == verdict
    assert bool(row["reason"]) == (verdict != Verdict.WITHIN)
    # Options belong to the judgement of a single table.
    assert "--" not in row["reason"]


def test_prescribed_motion_counts_by_its_efforts(submit):
    name = "slider-crank-dry-pins"
    scene = scene_of(name)
    run = load_engine("reference").simulate(scene, rtol=1e-9, output_step=0.02).to_frame()
    table = run[[*states(scene), "motor.effort"]]
    assert submit({name: table}).loc[name, "verdict"] == Verdict.WITHIN
    row = submit({name: table.drop(columns="motor.effort")}).loc[name]
    assert row["verdict"] == Verdict.NOT_JUDGED and "motor.effort" in row["reason"]
    # the effort of the mechanism without friction
    [smooth] = [
        load_engine("reference").simulate(scene_of("slider-crank"), rtol=1e-9, output_step=0.02)
    ]
    wrong = table.assign(**{"motor.effort": smooth.to_frame()["motor.effort"]})
    assert submit({name: wrong}).loc[name, "verdict"] == Verdict.BEYOND


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('benchmark = "friction-benchmark 1"', 'benchmark = "friction-benchmark 2"', "benchmark"),
        ('who = "a test"\n', "", "who"),
        ('who = "a test"', 'who = ""', "who"),
        ('fidelity = "joint"', 'fidelity = "joints"', "fidelity"),
        ("version", "versoin", "versoin"),
        ('version = "1"', "version = 1", "version"),
        (
            'command = "none"\n',
            'command = "none"\n[declined]\nfourbar = "no"\n',
            "declined.fourbar",
        ),
        ('command = "none"\n', 'command = "none"\n[settings]\ndt = [1]\n', "settings.dt"),
    ],
)
def test_descriptions(tmp_path, old, new, key):
    truth("hold-level").to_csv(tmp_path / "hold-level.csv", index=False)
    (tmp_path / "submission.toml").write_text(DESCRIPTION.replace(old, new, 1))
    with pytest.raises(FileError) as error:
        read_submission(tmp_path)
    assert "submission.toml" in str(error.value)
    assert key in [problem.key for problem in error.value.problems]


@pytest.mark.parametrize(
    ("files", "description", "key"),
    [
        (["hold-levle.csv"], DESCRIPTION, "hold-levle.csv"),
        (["hold-level.csv", "hold-level.parquet"], DESCRIPTION, "hold-level.parquet"),
        (["hold-level.csv"], DESCRIPTION + '[declined]\nhold-level = "no"\n', "hold-level.csv"),
        ([], DESCRIPTION, "tables"),
        (["hold-level.csv"], None, "submission.toml"),
    ],
)
def test_folders(tmp_path, files, description, key):
    for name in files:
        (tmp_path / name).write_text("t\n")
    if description:
        (tmp_path / "submission.toml").write_text(description)
    with pytest.raises(FileError) as error:
        read_submission(tmp_path)
    assert key in [problem.key for problem in error.value.problems]


def test_command(compiled, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    invoke("judge", folder, exit_code=2)
    (folder / "submission.toml").write_text(DESCRIPTION + '[declined]\nfour-bar = "no loops"\n')
    solved("hold-level").to_csv(folder / "hold-level.csv", index=False)
    right = invoke("judge", folder, "--out", tmp_path / "judged", exit_code=0)
    assert "1 of 1 results within bounds; 1 of 20 scenes submitted" in right.stdout
    written = pd.read_parquet(tmp_path / "judged" / "data" / "scenes.parquet")
    assert list(written["scene"]) == list(SCENES)
    assert written.set_index("scene").loc["four-bar", "reason"] == "no loops"
    assert (tmp_path / "judged" / "scenes" / "hold-level" / "judgement.md").is_file()
    assert "(scenes/hold-level/judgement.md)" in (tmp_path / "judged" / "submission.md").read_text()
    invoke("judge", folder, "--units", "mm", exit_code=2)
    without_events("stop-level").to_csv(folder / "stop-level.csv", index=False)
    invoke("judge", folder, exit_code=3)
    solved("stop-level").iloc[::2].to_csv(folder / "stop-level.csv", index=False)
    invoke("judge", folder, exit_code=2)


INCLINE = """\
    if name != "block-on-incline":
        raise Declined("other scenes follow")
    [body] = scene["bodies"].values()
    guide, g = scene["joints"]["guide"], scene["gravity"]
    d = guide["direction"]
    a = g[0] * d[0] + g[1] * d[1] - guide["mu"] * abs(g[0] * d[1] - g[1] * d[0])
    times = [k * step for k in range(round(scene["t_end"] / step) + 1)]
    way = [a * t * t / 2 for t in times]
    return {
        "t": times,
        "slider.x": [body["position"][0] + d[0] * s for s in way],
        "slider.y": [body["position"][1] + d[1] * s for s in way],
    }
"""
INCLINE_IN_C = """\
    if (strcmp(name, "block-on-incline") != 0) return "other scenes follow";
    const Json *guide = json_get(json_get(scene, "joints"), "guide");
    const Json *d = json_get(guide, "direction"), *g = json_get(scene, "gravity");
    double dx = json_item(d, 0), dy = json_item(d, 1), gx = json_item(g, 0), gy = json_item(g, 1);
    double a = gx * dx + gy * dy - json_number(guide, "mu", 0) * fabs(gx * dy - gy * dx);
    double end = json_number(scene, "t_end", NAN);
    long rows = lround(end / step);
    fprintf(table, "t,slider.x,slider.y\\n");
    for (long k = 0; k <= rows; k++) {
        double t = k * step, way = a * t * t / 2;
        fprintf(table, "%.17g,%.17g,%.17g\\n", t, way * dx, way * dy);
    }
    return 0;
"""


def run_template(name, tmp_path, solver=""):
    """Run a template, with the body of its solver replaced, in a folder of its own; return the submission."""
    text = (FOLDER / name).read_text()
    stub = re.search(
        r'^ *(?:raise Declined|\(void\)name)[^}]*?implemented yet".*?\n', text, re.M | re.S
    )
    if solver:
        text = text.replace(stub[0], solver)
    (tmp_path / name).write_text(text)
    submission = tmp_path / "out"
    submission.mkdir(exist_ok=True)
    command = [sys.executable, "-I", name]
    if name.endswith(".c"):
        compiler = shutil.which("cc")
        if compiler is None:
            pytest.skip("no C compiler")
        build = [compiler, "-std=c99", "-O2", "-o", "runner", name, "-lm"]
        subprocess.run(build, cwd=tmp_path, check=True)
        command = ["./runner"]
    subprocess.run([*command, str(FOLDER), "out"], cwd=tmp_path, check=True, capture_output=True)
    return submission


@pytest.mark.parametrize(
    ("template", "solver"), [("runner.py", INCLINE), ("runner.c", INCLINE_IN_C)]
)
def test_templates(compiled, tmp_path, template, solver):
    empty = judge_submission(run_template(template, tmp_path))
    assert empty.count(Verdict.DECLINED) == 20
    judged = judge_submission(run_template(template, tmp_path, solver))
    assert judged.count(Verdict.WITHIN) == 1 and judged.count(Verdict.DECLINED) == 19
    row = judged.table.set_index("scene").loc["block-on-incline"]
    assert row["position_error"] < 1e-9


def test_stored_submissions(compiled):
    within = {"c-example": 15, "octave-example": 13}
    for name, count in within.items():
        judged = judge_submission(SUBMISSIONS / name)
        assert judged.submitted == 16 and judged.count(Verdict.WITHIN) == count
