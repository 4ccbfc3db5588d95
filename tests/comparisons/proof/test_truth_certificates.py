"""Certificates of truths are proven again, and what is false in one is found."""

import json

import numpy as np
import pytest

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from flint import arb
from typer.testing import CliRunner

from stiction.cli.app import app
from stiction.comparisons.proof.certificate import read_certificate, write_certificate
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.proving import prove_scene
from stiction.comparisons.proof.truth import ProvenTruth, certificates
from stiction.comparisons.proof.truth_certificate import FORMAT, certificate_path, truth_certificate
from stiction.scenes import load_scene

SHORT = [("block-on-incline", 2), ("mass-on-belt", 3), ("coulomb-oscillator", 4), ("pendulum", 1), ("slider-bar-case-3", 1), ("elliptic-trammel", 0.125),
         ("slider-on-moving-guide", 0.5)]


@pytest.fixture(scope="module")
def told():
    return truth_certificate(load_scene("slider-bar-case-1", {"t_end": 3}))


@pytest.mark.parametrize("name, t_end", SHORT)
def test_all_positions_and_velocities_are_within_their_bounds(name, t_end):
    """Of every mechanism: columns in floats against balls of 25 digits at instants between those of steps."""
    scene = load_scene(name, {"t_end": t_end})
    told, motion = truth_certificate(scene), prove_scene(scene, 25)
    proven = ProvenTruth.of(told)
    with working(motion.precision.bits, motion.precision.order + 1):
        for t in np.linspace(0.0, t_end, 23):
            found, instant = proven.columns(np.array([t]), "after"), arb(float(t))
            balls = motion.mechanism.bodies(instant, *motion.at(instant))
            assert set(found) == set(balls)
            for column, ball in balls.items():
                assert abs(ball - float(found[column][0])) <= proven.errors[column] < 1e-12, column


def test_a_certificate_is_proven_again(told, tmp_path):
    assert FORMAT.check(told) == []
    path = tmp_path / certificate_path(told).name
    write_certificate(told, path)
    ended = CliRunner().invoke(app, ["prove", "--check", str(path)])
    assert ended.exit_code == 0 and "all 9 columns proven anew" in ended.output


@pytest.mark.parametrize("what", ["coefficient", "error", "event", "time", "digest"])
def test_what_is_false_is_found(told, what):
    false = json.loads(json.dumps(told))
    if what == "coefficient":
        false["coefficients"]["slider.x"][3][1] *= 1 + 1e-12
    elif what == "error":
        false["errors"]["bar.y"] /= 10
    elif what == "event":
        false["events"].pop()
    elif what == "time":
        false["events"][0][2] += 1e-13
    else:
        false["file"] = false["file"].replace("mus = 0.04", "mus = 0.05")
    assert FORMAT.check(false)


def test_a_file_that_is_none_is_refused(tmp_path):
    (tmp_path / "truth.json.gz").write_bytes(b"no gzip")
    ended = CliRunner().invoke(app, ["prove", "--check", str(tmp_path / "truth.json.gz")])
    assert ended.exit_code == 2 and "expected a certificate" in ended.output


@pytest.mark.long
@pytest.mark.parametrize("file", certificates(), ids=lambda file: file.name)
def test_certificates_of_the_suite_are_proven_again(file):
    assert FORMAT.check(read_certificate(file, [FORMAT.name])) == []
