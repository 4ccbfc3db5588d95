"""Open mechanisms: they are drawn with a remark, and closed by `--assemble`, in Python and as a file."""

import numpy as np
import pytest
from conftest import invoke

import stiction
from stiction.reference_impl.multibody.initial_state import with_consistent_start
from stiction.scenes import SceneError

OPEN = "--set rod.angle=0.2"


def crank(folder):
    file = folder / "crank.toml"
    invoke("new", str(file), "--like", "slider-crank")
    return file


def test_an_open_loop_is_drawn_and_named(tmp_path):
    file, picture = crank(tmp_path), tmp_path / "open.svg"
    drawn = invoke("draw", str(file), *OPEN.split(), "-o", str(picture))
    assert picture.is_file()
    assert "start.crankpin.fy: found position residual" in drawn.stderr
    # What is closed, or is closed by the option, has no remark.
    for options in ([], [*OPEN.split(), "--assemble"]):
        assert "residual" not in invoke("draw", str(file), *options, "-o", str(picture)).stderr


def test_a_closed_scene_is_written(tmp_path):
    file, closed = crank(tmp_path), tmp_path / "closed.toml"
    text = file.read_text().replace('position = ["r/2", 0]', 'position = ["r/2", 0.01]')
    file.write_text(text)
    with pytest.raises(SceneError, match="position residual"):
        with_consistent_start(stiction.load_scene(file))
    invoke("new", str(closed), "--assemble", str(file))
    written = stiction.load_scene(closed)
    assert with_consistent_start(written) == written
    assembled = stiction.load_scene(file, assemble=True)
    for name, body in assembled.bodies.items():
        assert np.array_equal(written.bodies[name].position, body.position)
    # Without the option the scene is returned as it is.
    assert stiction.load_scene(file).bodies["crank"].position[1] == 0.01


def test_an_existing_scene_and_an_assembled_one_exclude_each_other(tmp_path):
    ended = invoke(
        "new", str(tmp_path / "x.toml"), "--like", "pendulum", "--assemble", "four-bar", exit_code=2
    )
    assert "expected at most one of them" in ended.output
    assert not (tmp_path / "x.toml").exists()


def test_explain_takes_an_open_scene(tmp_path):
    file = crank(tmp_path)
    assert "Degrees of freedom" in invoke("explain", str(file), *OPEN.split(), "--assemble").output
