"""Attacks on proofs: any slider-bar, a set of starts, and laws, derivatives and roundings that are wrong."""

from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

import numpy as np
from flint import arb
from proof_agreement import assert_agreement

from stiction.comparisons.proof import step
from stiction.comparisons.proof.certificate import read_ball, read_ball_within, read_number
from stiction.comparisons.proof.enclosures.series import working
from stiction.comparisons.proof.enclosures.zeros import Undecided
from stiction.comparisons.proof.mechanisms.one_slider import Contact, OneSlider
from stiction.comparisons.proof.mechanisms.sliding_mass import SlidingMass
from stiction.comparisons.proof.mechanisms.trammel import Trammel
from stiction.comparisons.proof.motion import prove, prove_scene
from stiction.comparisons.proof.step import Precision, StateSet
from stiction.comparisons.truth import slider_bar_truth, trammel_truth
from stiction.scenes import load_scene, vary

CASE = "slider-bar-case-1"
def proves(scene, truth):
    """Return whether a proof goes through and has the truth inside."""
    try:
        assert_agreement(truth, prove_scene(scene, 12), np.linspace(0, truth.t_end, 9)[1:-1])
    except (Undecided, AssertionError):
        return False
    return True


@settings(max_examples=6, deadline=None)
@given(mu=st.floats(0.001, 0.2), extra=st.sampled_from([0.0, 0.01, 0.1]), F0=st.floats(0.5, 8),
       Omega=st.floats(0.5, 3), w0=st.floats(-1.5, 1.5), m1=st.floats(0.5, 3), width=st.floats(0.01, 0.6))
def test_any_slider_bar(mu, extra, F0, Omega, w0, m1, width):
    """Two derivations and two arithmetics of one motion; what the proof cannot decide would be an error here."""
    assume(abs(w0) > 0.1)
    scene = vary(load_scene(CASE), {"mu": mu, "mus": mu + extra, "F0": F0, "Omega": Omega, "w0": w0, "m1": m1,
                                    "guide.width": width, "t_end": 3})
    assert proves(scene, slider_bar_truth(scene))


# a set of starts


def oscillator(speed):
    """Den Hartog's without stops, in motion at the start; called at the working precision."""
    mechanism = SlidingMass.from_scene(load_scene("coulomb-oscillator", {"t_end": 9}))
    return replace(mechanism, q=[arb(0)], v=[speed], at_rest=False)


@pytest.fixture(scope="module")
def thin():
    """The end of a motion that starts at the rim of a set."""
    precision = Precision.of(20)
    with precision.working():
        motion = prove(oscillator(arb(1) + arb(10) ** -6), precision)
        assert [event.kind for event in motion.events].count("reversal") >= 2
        return motion.end.hull()


def set_of_starts():
    precision = Precision.of(20)
    states = StateSet.box([arb(0), arb(1) + arb(10) ** -6 * arb(0, 1)])
    return prove(oscillator(states.hull()[1]), precision, states).end


def test_motions_from_a_set_end_in_its_image(thin):
    with Precision.of(20).working():
        end = set_of_starts()
        assert end.contains(thin)
        assert max(float(size.rad()) for size in end.size) < 1e-5  # nor is it merely wide


def test_a_jump_left_out_of_the_derivative_is_noticed(thin, monkeypatch):
    monkeypatch.setattr(step.Step, "_jump", lambda *arguments: step.identity(2))
    with Precision.of(20).working():
        assert not set_of_starts().contains(thin)


# laws


@pytest.fixture(scope="module")
def bar():
    scene = load_scene(CASE, {"t_end": 4})
    return scene, slider_bar_truth(scene)


def test_the_bar_is_proven(bar):
    assert proves(*bar)


@pytest.mark.parametrize("owner, name, wrong", [
    (Contact, "friction", lambda self, slip: -slip * self.mu),  # drives the slip
    (Contact, "friction", lambda self, slip: slip * self.mus),
    (Contact, "difference",  # surfaces exchanged
     lambda self, R, M, friction: (M - R * (friction * self.width / 2)) * (2 / self.length)),
    (OneSlider, "_margins", lambda self, R, M, P, s: [R * self.contact.mus - P * s]),  # no corners at rest
    (SlidingMass, "_moment", lambda self, t, a: self._theta(t).cos() * self.c * self.g)])  # a bar without inertia
def test_wrong_laws_of_contact_are_noticed(bar, monkeypatch, owner, name, wrong):
    monkeypatch.setattr(owner, name, wrong)
    assert not proves(*bar)


@pytest.fixture(scope="module")
def trammel():
    scene = load_scene("elliptic-trammel", {"t_end": 0.15})  # past a dead point
    return scene, trammel_truth(scene)


@pytest.mark.parametrize("sign", [(1, 1), (-1, 1), (1, -1)])
def test_a_wrong_sign_of_either_friction_of_the_trammel_is_noticed(trammel, monkeypatch, sign):
    right = Trammel._coefficients
    monkeypatch.setattr(Trammel, "_coefficients",
                        lambda self, mode: tuple(s * c for s, c in zip(sign, right(self, mode))))
    assert proves(*trammel) == (sign == (1, 1))


# rounding of what is claimed


def test_a_ball_that_is_read_contains_what_is_written_and_a_target_lies_within():
    with working(200, 10):
        for radius in ("1*2^-40", "1073741823*2^-90", "715827883*2^-70"):
            pair = ["5*2^-3", radius]
            outer, inner, exact = read_ball(pair), read_ball_within(pair), read_number(radius)
            assert inner.rad() <= exact <= outer.rad() and outer.mid() == inner.mid()
            assert inner.rad() > exact * 0.999
