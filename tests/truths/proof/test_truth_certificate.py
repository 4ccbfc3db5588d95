"""Certificates of truths are proven again, and what is false in one is found."""

import copy

import numpy as np
import pytest
from conftest import invoke

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from flint import arb

from stiction.scenes import load_scene
from stiction.truths.proof.certificate import read_certificate, write_certificate
from stiction.truths.proof.motion import prove_scene
from stiction.truths.proof.truth import ProvenTruth, certificates
from stiction.truths.proof.truth_certificate import FORMAT, truth_certificate


@pytest.fixture(scope="module")
def claims():
    return truth_certificate(load_scene("slider-bar-case-1", {"t_end": 3}))


@pytest.mark.parametrize(
    "name, t_end",
    [
        ("block-on-incline", 2),
        ("mass-on-belt", 3),
        ("coulomb-oscillator", 4),
        ("pendulum", 1),
        ("slider-bar-case-3", 1),
        ("elliptic-trammel", 0.125),
        ("slider-on-moving-guide", 0.5),
    ],
)
def test_all_positions_and_velocities_are_within_their_bounds(name, t_end):
    """Columns in floats against balls of 25 digits at instants between those of steps, for every mechanism."""
    scene = load_scene(name, {"t_end": t_end})
    motion, proven = prove_scene(scene, 25), ProvenTruth.of(truth_certificate(scene))
    with motion.precision.working():
        for t in np.linspace(0.0, t_end, 23):
            found, instant = proven.columns(np.array([t]), "after"), arb(float(t))
            balls = motion.mechanism.bodies(instant, *motion.at(instant))
            assert set(found) == set(balls)
            for column, ball in balls.items():
                assert abs(ball - float(found[column][0])) <= proven.errors[column] < 1e-12, column


def test_a_certificate_is_proven_again(claims, tmp_path):
    assert FORMAT.check(claims) == []
    path = tmp_path / "truth.json.gz"
    write_certificate(claims, path)
    ended = invoke("prove", "--check", path)
    assert "all 9 columns were proven again" in ended.output


@pytest.mark.parametrize(
    "damage",
    [
        lambda claims: claims["coefficients"]["slider.x"].__setitem__(
            3,
            [
                c * (1 + 1e-12 * (k == 1))
                for k, c in enumerate(claims["coefficients"]["slider.x"][3])
            ],
        ),
        lambda claims: claims["errors"].update({"bar.y": claims["errors"]["bar.y"] / 10}),
        lambda claims: claims["events"].pop(),
        lambda claims: claims["events"][0].__setitem__(2, claims["events"][0][2] + 1e-13),
        lambda claims: claims.update(file=claims["file"].replace("mus = 0.04", "mus = 0.05")),
    ],
    ids=["coefficient", "error", "event", "time", "digest"],
)
def test_a_false_claim_is_found(claims, damage):
    false = copy.deepcopy(claims)
    damage(false)
    assert FORMAT.check(false)


def test_a_file_that_is_none_is_refused(tmp_path):
    (tmp_path / "truth.json.gz").write_bytes(b"no gzip")
    ended = invoke("prove", "--check", tmp_path / "truth.json.gz", exit_code=2)
    assert "expected a certificate" in ended.output


@pytest.mark.long
@pytest.mark.parametrize("file", certificates(), ids=lambda file: file.name)
def test_certificates_of_the_suite_are_proven_again(file):
    assert FORMAT.check(read_certificate(file, [FORMAT.name])) == []
