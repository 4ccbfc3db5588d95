"""Submissions to the friction benchmark: right ones are within bounds, and wrong ones get the sentence that says why."""

import json
import runpy
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import invoke

from stiction.comparisons.judge import submission
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


def run_template(name, tmp_path, edit=str):
    """Run a template, whose text `edit` may change, in a folder of its own; return the submission."""
    (tmp_path / name).write_text(edit((FOLDER / name).read_text()), encoding="utf-8")
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


@pytest.mark.parametrize("template", ["runner.py", "runner.c"])
def test_templates(compiled, tmp_path, template):
    judged = judge_submission(run_template(template, tmp_path))
    assert judged.count(Verdict.WITHIN) == 1 and judged.count(Verdict.DECLINED) == 19
    row = judged.table.set_index("scene").loc["block-on-incline"]
    assert row["position_error"] < 1e-9


@pytest.mark.parametrize(("mus", "is_at_rest"), [(0.37, True), (0.36, False)])
def test_the_templates_know_static_friction(tmp_path, mus, is_at_rest):
    """The incline is at 20 degrees, so that the block is at rest with mus above tan(20 degrees) = 0.364."""
    runner = runpy.run_path(str(FOLDER / "runner.py"))
    scene = json.loads((SCENES["block-on-incline"].folder / "scene.json").read_text())["scene"]
    scene["joints"]["guide"]["mus"] = mus
    columns = runner["simulate"]("block-on-incline", scene, 0.02)
    assert (columns["slider.x"][-1] == 0.0) == is_at_rest


AWKWARD = {
    "dt": 0.001,
    "step size": 1,
    'a "quoted" key': "a \\ backslash",
    "lines\nand\ttabs": "\x7f and \x01",
    "größe.µ": "é \U0001f600",
    "": "empty",
    "#": "",
}
"""Settings that are no bare keys of TOML, or whose values need escapes."""


def random_texts(count):
    """Random texts, mostly of characters that have a meaning in TOML, C or Python, without a null character."""
    rng = np.random.default_rng(7)
    letters = list("ab =.#[]{}'\"\\\n\t\r\x0b\x1f\x7f\x85\u2028µ日\U0001f600,-_0")
    return ["".join(rng.choice(letters, rng.integers(1, 9))) for _ in range(count)]


def c_text(text):
    """A text as a literal of C; octal escapes end after three digits."""
    return '"' + "".join(f"\\{byte:03o}" for byte in text.encode()) + '"'


@pytest.mark.parametrize("template", ["runner.py", "runner.c"])
def test_templates_write_any_settings(tmp_path, template):
    texts = random_texts(400)
    settings = AWKWARD | dict(zip(texts[:200], texts[200:]))
    if template == "runner.py":
        settings |= {"is it": True, "infinite": float("inf")}

    def with_settings(text):
        if template == "runner.py":
            return text.replace(
                'SETTINGS = {"dt": 0.001}', f"SETTINGS = {ascii(settings)}"
            ).replace("import csv", 'import csv\ninf = float("inf")', 1)
        lines = [
            f"{{{c_text(key)}, {c_text(value)}, 0}},"
            if isinstance(value, str)
            else f"{{{c_text(key)}, 0, {value!r}}},"
            for key, value in settings.items()
        ]
        start = text.index('    {"dt", 0, 0.001},')
        return text[:start] + "\n".join(lines) + text[text.index("\n", start) :]

    folder = run_template(template, tmp_path, with_settings)
    written = tomllib.loads((folder / "submission.toml").read_text(encoding="utf-8"))
    assert written["settings"] == settings
    del settings[""]
    text = (folder / "submission.toml").read_text(encoding="utf-8")
    without_empty = [line for line in text.split("\n") if not line.startswith('"" =')]
    (folder / "submission.toml").write_text("\n".join(without_empty), encoding="utf-8")
    submission, _ = read_submission(folder)
    assert submission.settings == settings


def test_the_line_of_invalid_toml_is_shown(tmp_path):
    (tmp_path / "submission.toml").write_text(DESCRIPTION + "[settings]\nstep size = 0.1\n")
    with pytest.raises(FileError) as error:
        read_submission(tmp_path)
    assert "'step size = 0.1'" in str(error.value) and "quotes" in str(error.value)
    # A key that reads like a place in the message is no place.
    twice = '[settings."a (at line 99, column 1)"]\n'
    (tmp_path / "submission.toml").write_text(DESCRIPTION + twice + twice)
    with pytest.raises(FileError) as error:
        read_submission(tmp_path)
    assert f"in the line '{twice.strip()}'" in str(error.value)


def test_the_example_of_a_description_is_valid(tmp_path):
    shutil.copy(FOLDER / "submission.toml", tmp_path)
    truth("hold-level").to_csv(tmp_path / "hold-level.csv", index=False)
    submission, tables = read_submission(tmp_path)
    assert set(tables) == {"hold-level"} and len(submission.settings) == 2


def test_a_table_of_an_unknown_scene_does_not_block_the_others(compiled, tmp_path):
    (tmp_path / "submission.toml").write_text(DESCRIPTION)
    solved("stop-level").to_csv(tmp_path / "stop-level.csv", index=False)
    solved("stop-level").to_csv(tmp_path / "stop-levl.csv", index=False)
    judged = judge_submission(tmp_path)
    rows = judged.table.set_index("scene")
    assert len(rows) == 21
    assert rows.loc["stop-level", "verdict"] == Verdict.WITHIN
    assert rows.loc["stop-levl", "verdict"] == Verdict.UNKNOWN_SCENE
    assert "did you mean 'stop-level'?" in rows.loc["stop-levl", "reason"]
    assert judged.submitted == 2 and judged.submitted_scenes == 1
    result = invoke("judge", tmp_path, "--out", tmp_path / "judged", exit_code=2)
    assert "1 of 2 results within bounds; 1 of 20 scenes submitted" in result.stdout
    assert "1 of 2 results: unknown scene" in result.stderr
    # A submission of nothing but unknown scenes is judged, too.
    (tmp_path / "stop-level.csv").unlink()
    assert judge_submission(tmp_path).submitted_scenes == 0


@pytest.mark.parametrize(
    ("columns", "verdict", "suggestion"),
    [
        (
            {"slider.y": "slider.y", "slider.x": "x"},
            Verdict.NOT_JUDGED,
            "x: did you mean 'slider.x'",
        ),
        ({"slider.x": "x"}, Verdict.NOT_A_TABLE, "x: did you mean 'slider.x'"),
        (
            {"slider.x": "pos_x", "slider.y": "y"},
            Verdict.NOT_A_TABLE,
            "pos_x: did you mean 'slider.x'",
        ),
        ({"slider.x": "slider_x"}, Verdict.NOT_A_TABLE, "did you mean 'slider.x'"),
        ({"slider.y": "slider.y", "slider.x": "qq"}, Verdict.NOT_JUDGED, "no column qq"),
    ],
)
def test_unknown_columns_are_named(submit, columns, verdict, suggestion):
    table = solved("stop-level")[["t", *columns]].rename(columns=columns)
    row = submit({"stop-level": table}).loc["stop-level"]
    assert row["verdict"] == verdict and suggestion in row["reason"]


def test_unknown_columns_of_a_right_table_are_a_finding(compiled, tmp_path):
    (tmp_path / "submission.toml").write_text(DESCRIPTION)
    # A column that the table has already is not what the heading y means.
    table = solved("stop-level").assign(power=1.0, y=0.0)
    table.to_csv(tmp_path / "stop-level.csv", index=False)
    row = judge_submission(tmp_path).table.set_index("scene").loc["stop-level"]
    assert row["verdict"] == Verdict.WITHIN and row["unknown_columns"] == "power, y"
    result = invoke("judge", tmp_path, exit_code=0)
    assert "stop-level: the scene has no column power, y." in result.stdout


def test_jumps_are_counted_only_of_submitted_efforts(submit):
    name = "slider-bar-case-1"
    run = load_engine("reference").simulate(scene_of(name), rtol=1e-9, output_step=0.05).to_frame()
    with_effort = submit({name: run[[*states(scene_of(name)), "motor.effort"]]}).loc[name]
    without = submit({name: run[states(scene_of(name))]}).loc[name]
    assert with_effort["jumps"] > 0 and with_effort["jumps_read"] >= 0
    assert pd.isna(without["jumps"]) and pd.isna(without["jumps_read"])


def test_declined_scenes_are_grouped_by_reason(compiled, tmp_path):
    reasons = {"four-bar": "no loops", "slider-crank": "no loops", "hold-bar": "no bars."}
    lines = "".join(f'{scene} = "{reason}"\n' for scene, reason in reasons.items())
    (tmp_path / "submission.toml").write_text(DESCRIPTION + "[declined]\n" + lines)
    # Without any table no scene is judged, which is no success.
    nothing = invoke("judge", tmp_path, exit_code=2)
    assert "no scene was judged; 0 of 20 scenes submitted" in nothing.stdout
    assert "no scene was judged" in nothing.stderr
    table = solved("stop-level")
    mirrored = table.assign(**{"slider.x": -table["slider.x"]})
    mirrored.to_csv(tmp_path / "stop-level.csv", index=False)
    result = invoke("judge", tmp_path, exit_code=2)
    assert "2 declined: no loops (slider-crank, four-bar)." in result.stdout
    assert "1 declined: no bars (hold-bar)." in result.stdout
    assert "16 missing: neither a table nor a reason in submission.toml (" in result.stdout
    assert "?." not in result.stdout and ".." not in result.stdout
    assert "1 of 1 results: other units" in result.stderr


def test_what_is_no_submission_is_named(tmp_path):
    (tmp_path / "stop-level.csv").write_text("t\n")
    (tmp_path / "mine.toml").write_text("")
    cases = {
        tmp_path: "no submission.toml in the folder",
        tmp_path / "stop-level.csv": "is a file",
        tmp_path / "mine.toml": "is a scene",
        tmp_path / "absent": "neither a folder nor a scene",
        "mass-on-belt": "mass-on-belt is a scene",
        SCENES["hold-level"].folder: "is a scene",
    }
    for path, words in cases.items():
        result = invoke("judge", path, exit_code=2)
        assert words in " ".join(result.stderr.split())


def test_stored_submissions(compiled):
    within = {"c-example": 15, "octave-example": 13}
    for name, count in within.items():
        judged = judge_submission(SUBMISSIONS / name)
        assert judged.submitted == 16 and judged.count(Verdict.WITHIN) == count


@pytest.mark.parametrize("excess", [1e-2, 1e-3, 1e-6, 1e-12])
def test_an_error_beyond_its_bound_is_printed_as_larger(excess):
    bound = 1e-3
    text = submission._above(bound * (1 + excess), bound)
    assert float(text) > bound and float(text) == pytest.approx(bound * (1 + excess), rel=excess)
