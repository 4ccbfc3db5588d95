"""Steady states and the stick threshold as theorems."""

import json
from dataclasses import replace
from fractions import Fraction

import pytest
from conftest import invoke

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from stiction.cli.exit_codes import FAILED
from stiction.scenes import load_scene
from stiction.truths import NotThisMechanism
from stiction.truths.physics import physics_of
from stiction.truths.proof import threshold as module
from stiction.truths.proof import threshold_certificate
from stiction.truths.proof.certificate import NotACertificate, read_certificate, write_certificate
from stiction.truths.proof.enclosures import NotProven
from stiction.truths.proof.motion import ProvenMotion
from stiction.truths.proof.threshold import (
    ProvenThreshold,
    decimal,
    proven_steady_state,
    proven_threshold,
)
from stiction.truths.proof.threshold_certificate import FORMAT
from stiction.truths.proof.truth import DATA, threshold_of_theorem
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import StickThreshold, steady_state

CASE = "slider-bar-case-1"


@pytest.fixture(scope="module", autouse=True)
def fewer_digits():
    """14 instead of 24: half the time; the end of a theorem of the suite is proven with all of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_DIGITS", 14)
        yield


@pytest.fixture(scope="module")
def sliding(fewer_digits):
    return proven_steady_state(load_scene(CASE), Fraction(9, 2))


def test_steady_state_is_the_one_that_is_found_in_floats(sliding):
    near = steady_state(SliderBar.from_scene(load_scene(CASE, {"F0": 4.5})))
    for proven, value in zip(sliding.state, near.state):
        assert (
            abs(float(proven.mid()) - value) < 1e-10 and float(proven.rad()) < 1e-14
        )  # the digits asked for
    assert not sliding.sticks and not near.sticks
    assert abs(float(sliding.period.mid()) - 8) < 1e-15
    # the multipliers are bounded by any norm of the map's derivative
    assert max(abs(value) for value in near.multipliers) <= sliding.contraction + 1e-6 < 1


@pytest.fixture(scope="module")
def sticking(fewer_digits):
    """Just below the threshold a stick phase of some microseconds."""
    return proven_steady_state(load_scene(CASE), Fraction(42119, 10000))


def test_a_steady_state_with_a_stick_phase(sticking):
    assert sticking.sticks and sticking.contraction < 1
    kinds = [event.kind for event in sticking.events]
    i = kinds.index("stick")
    assert kinds[i + 1] == "slip"
    assert 0 < float((sticking.events[i + 1].time - sticking.events[i].time).mid()) < 1e-4


def test_a_map_that_does_not_contract_proves_nothing(monkeypatch):
    derivative = ProvenMotion.derivative
    monkeypatch.setattr(ProvenMotion, "derivative", lambda self: derivative(self) * 50)
    with pytest.raises(NotProven, match="no contraction"):
        proven_steady_state(load_scene(CASE), Fraction(9, 2))


def test_ends_that_do_not_differ_are_no_threshold(monkeypatch, sliding):
    monkeypatch.setattr(
        module, "stick_threshold", lambda scene: StickThreshold(4.5, 1e-9, (4.4, 4.6))
    )
    monkeypatch.setattr(module, "proven_steady_state", lambda scene, F0: replace(sliding, F0=F0))
    with pytest.raises(NotProven, match="stick phase at"):
        proven_threshold(load_scene(CASE), 3)


def test_other_mechanisms():
    with pytest.raises(NotThisMechanism):
        proven_threshold(load_scene("pendulum"))


@pytest.fixture(scope="module")
def certificate(sticking, sliding, tmp_path_factory):
    """A theorem on a wide interval, as a file."""
    path = tmp_path_factory.mktemp("theorem") / "threshold.json"
    found = ProvenThreshold(sticking, sliding)
    write_certificate(threshold_certificate.threshold_certificate(found, load_scene(CASE)), path)
    return path


@pytest.fixture
def claims(certificate):
    return read_certificate(certificate, [FORMAT.name])


@pytest.fixture
def proven_before(monkeypatch, sticking, sliding):
    """Proofs of both ends without doing them again."""
    monkeypatch.setattr(
        threshold_certificate,
        "proven_on",
        lambda scene, F0, *rest: sticking if F0 == sticking.F0 else sliding,
    )


@pytest.mark.long  # in every run: an end of a theorem of the suite
def test_the_theorem_is_checked_by_its_file_alone(certificate):
    ended = invoke("prove", certificate, "--check")
    assert "all 2 ends were proven again" in ended.output


def changed(decimals):
    """A ball in decimals with another eighth digit."""
    centre, _, radius = decimals.partition(" +/- ")
    place = centre.index(".") + 8
    return f"{centre[:place]}{(int(centre[place]) + 5) % 10}{centre[place + 1 :]} +/- {radius}"


@pytest.mark.parametrize(
    "damage, reason",
    [
        (lambda low: low.update({"stick phase": False}), "changes of mode"),
        (lambda low: low["events"].pop(), "changes of mode"),
        (lambda low: low.update(contraction=low["contraction"] / 2), "factor"),
        (lambda low: low.update(periods=1), "from the start"),
        (lambda low: low["state"].reverse(), "state at t = 0"),
        (lambda low: low.update({"F0, decimal": "4.2118"}), "decimals"),
        (
            lambda low: low["state, decimal [m, m/s]"].__setitem__(
                0, changed(low["state, decimal [m, m/s]"][0])
            ),
            "decimals",
        ),
        (
            lambda low: low["events"][-1].update(
                {"time [s]": changed(low["events"][-1]["time [s]"])}
            ),
            "decimals",
        ),
    ],
)
def test_claims_that_differ_from_what_is_proven(claims, sticking, proven_before, damage, reason):
    assert threshold_certificate._proven_again(claims["low"], load_scene(CASE), sticking.F0).sticks
    damage(claims["low"])
    with pytest.raises(NotProven, match=reason):
        threshold_certificate._proven_again(claims["low"], load_scene(CASE), sticking.F0)


def test_sentences_that_differ_from_the_tables(claims, proven_before):
    assert FORMAT.check(claims) == []
    claims["theorem"][-1] = claims["theorem"][-1].replace("4.2119", "4.2118")
    assert [failure.part for failure in FORMAT.check(claims)] == [-1]


def test_ends_that_do_not_bracket(claims, proven_before):
    claims["low"], claims["high"] = claims["high"], claims["low"]
    assert "the ends are none" in FORMAT.check(claims)[0].reason


@pytest.mark.parametrize(
    "damage",
    [
        lambda low: low.update(radius="1*2^-2"),  # of motions with other changes of mode
        lambda low: low.update(radius="1*2^-300"),  # within the error of the centre
        lambda low: low["centre"].__setitem__(0, "-3*2^-3"),
    ],
)
def test_another_set_proves_nothing(claims, damage):
    damage(claims["low"])
    with pytest.raises(NotProven):
        threshold_certificate._proven_again(claims["low"], load_scene(CASE), Fraction(42119, 10000))


@pytest.mark.long
def test_another_friction_is_noticed(claims):
    assert "mu = 0.03\n" in claims["file"]
    claims["file"] = claims["file"].replace("mu = 0.03\n", "mu = 0.0300001\n")
    assert [failure.part for failure in FORMAT.check(claims)] == [0, 1]


@pytest.mark.parametrize(
    "damage",
    [
        lambda claims: claims.pop("high"),
        lambda claims: claims["low"].pop("frame"),
        lambda claims: claims["low"].update(radius="small"),
        lambda claims: claims["low"].update(count=0),
        lambda claims: claims["low"].update({"F0 [N]": "1/0"}),
    ],
)
def test_a_file_that_is_no_theorem(claims, damage):
    damage(claims)
    with pytest.raises(NotACertificate):
        FORMAT.check(claims)


def test_a_refuted_file_ends_the_command(certificate, sliding, tmp_path, monkeypatch):
    def proven_again(end, scene, F0):
        if end["stick phase"]:
            raise NotProven("why")
        return sliding

    monkeypatch.setattr(threshold_certificate, "_proven_again", proven_again)
    ended = invoke("prove", certificate, "--check", exit_code=FAILED)
    assert "end 0: why" in ended.output and "1 of 2 ends" in ended.output
    other = tmp_path / "other.json"
    other.write_text(json.dumps({"format": "stiction proof 0"}))
    assert (
        "expected 'stiction proof 1' or" in invoke("prove", other, "--check", exit_code=None).output
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "name, low", [(CASE, "4.211956266"), ("slider-bar-case-1-mus-equals-mu", "3.894203464")]
)
def test_threshold_to_a_nano_newton(name, low):
    """About 4.2119563 and 3.894203 by bisection; the figure 3.8942063 that was handed down is too high."""
    found = proven_threshold(load_scene(name), 9)
    assert decimal(found.low.F0) == low
    assert found.high.F0 - found.low.F0 == Fraction(1, 10**9)
    assert found.low.sticks and not found.high.sticks


# the theorems that come with the suite


@pytest.mark.parametrize("has_mus, F0", [(True, 4.2119562663), (False, 3.8942034641)])
def test_a_threshold_of_the_suite_is_proven(has_mus, F0):
    found = threshold_of_theorem(physics_of(load_scene(CASE, {"F0": 1}), has_mus))
    assert (
        abs(found.F0 - F0) < 1e-9
        and 0 < found.uncertainty <= 5.1e-11
        and "Hypotheses" in found.theorem
    )


@pytest.mark.parametrize("overrides", [{"mu": 0.031}, {"m1": 2.5}, {"L0": 0.3}])
def test_another_scene_has_no_theorem(overrides):
    assert threshold_of_theorem(load_scene(CASE, overrides)) is None


def test_an_end_of_a_theorem_of_the_suite_is_proven_anew():
    [file] = DATA.glob("threshold-*mus-equals*")
    claims = read_certificate(file, [FORMAT.name])
    high = Fraction(claims["high"]["F0 [N]"])
    again = threshold_certificate._proven_again(claims["high"], load_scene(claims["scene"]), high)
    assert again.F0 == high and not again.sticks


@pytest.mark.long
@pytest.mark.parametrize("file", sorted(DATA.glob("threshold-*")), ids=lambda file: file.name)
def test_the_theorems_of_the_suite_are_proven_anew(file):
    assert FORMAT.check(read_certificate(file, [FORMAT.name])) == []
