"""`stiction judge`: exit codes for a line of CI, and a folder that stands by itself."""

import numpy as np
import pandas as pd
import pytest
from conftest import invoke

from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.scenes import load_scene

CASE = "slider-bar-case-1"


@pytest.fixture(scope="module")
def frame(compiled):
    t = np.linspace(0, 24, 2401)
    return pd.DataFrame({"t": t, **ground_truth(load_scene(CASE))(t)})


@pytest.fixture
def judge(tmp_path, monkeypatch, frame):
    monkeypatch.chdir(tmp_path)

    def call(table, *arguments):
        (frame if table is None else table).to_csv("result.csv", index=False)
        return invoke("judge", CASE, "result.csv", *arguments, exit_code=None)

    return call


def test_a_right_table(judge):
    result = judge(None, "--max-error", "1e-6")
    assert result.exit_code == 0 and "proven" in result.stdout and "15 of 15" in result.stdout


@pytest.mark.parametrize(
    ("change", "arguments", "code"),
    [
        (lambda frame: frame.assign(**{"slider.x": frame["slider.x"] + 1e-3 * frame["t"]}), [], 0),
        (
            lambda frame: frame.assign(**{"slider.x": frame["slider.x"] + 1e-3 * frame["t"]}),
            ["--max-error", "1e-4"],
            3,
        ),
        (
            lambda frame: frame.assign(**{"bar.angle": frame["bar.angle"] + 1e-3 * frame["t"]})[
                ["t", "bar.angle"]
            ],
            ["--max-error", "1e-4"],
            3,
        ),
        (lambda frame: frame[frame["t"] < 20], ["--max-error", "1"], 3),
        (lambda frame: frame[frame["t"] > 20], ["--max-error", "1"], 3),
        (lambda frame: frame[frame["t"] < 20], ["--max-error", "1", "--t-end", "20"], 0),
        (lambda frame: 1e3 * frame[["t", "slider.x"]], ["--units", "mm,ms"], 0),
        (lambda frame: 1e3 * frame[["t", "slider.x"]], ["--units", "ms"], 2),
        (
            lambda frame: frame.assign(**{"motor.effort": -frame["motor.effort"]}),
            ["--max-error", "1"],
            2,
        ),
        (lambda frame: frame.rename(columns={"t": "zeit"}), [], 2),
        (lambda frame: frame.rename(columns={"t": "zeit"}), ["--map", "zeit=t"], 0),
        (lambda frame: frame[["t", "bar.angle"]], ["--max-error", "1e-6"], 2),
        (lambda frame: frame[["t", "slider.y"]], ["--max-error", "1e-6"], 2),
        (lambda frame: frame[["t", "bar.y", "slider.y", "bar.angle"]], ["--max-error", "1e-6"], 2),
        (lambda frame: frame[["t", "slider.x"]], ["--max-error", "1e-6"], 0),
        (lambda frame: frame.iloc[[0, -1]], ["--max-error", "1e-6"], 2),
        (lambda frame: frame.iloc[::200], ["--max-error", "1e-6"], 0),
        (lambda frame: frame[["t", "motor.effort"]], ["--max-error", "1"], 2),
        (lambda frame: frame, ["--max-error", "1e-17"], 2),
        (lambda frame: frame, ["--units", "inch"], 2),
        (lambda frame: frame, ["--map", "x"], 2),
        (lambda frame: frame, ["--out", "result.csv"], 2),
    ],
)
def test_exit_codes(judge, frame, change, arguments, code):
    result = judge(change(frame), *arguments)
    assert result.exit_code == code, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)


def test_folder(judge, tmp_path):
    folder = tmp_path / "judged"
    assert judge(None, "--out", str(folder)).exit_code == 0
    page = (folder / "judgement.md").read_text(encoding="utf-8")
    for name in ("figures/judgement.svg", "figures/judgement.pdf"):
        assert name in page and (folder / name).stat().st_size > 1000
    errors = pd.read_csv(folder / "data" / "errors.csv")
    assert (errors["error"] <= errors["uncertainty"] + 1e-12).all()
    assert judge(None, "--out", str(folder)).exit_code == 0
    (folder / "notes.txt").write_text("mine")
    assert judge(None, "--out", str(folder)).exit_code == 2 and (folder / "notes.txt").exists()


@pytest.mark.parametrize(
    "content", [b"", b"\x00\x01\xff" * 1000, b"t\n0\n1\n", b"t,slider.x\n0,a\n1,b\n"]
)
def test_garbage(tmp_path, monkeypatch, content):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.csv").write_bytes(content)
    result = invoke("judge", CASE, "r.csv", exit_code=2)
    assert "r.csv" in result.stderr and len(result.stderr) < 1000
