"""Proven motions: closed forms, truths and the reference lie inside; a wrong equation, rounding or file is noticed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import invoke

pytest.importorskip("flint", reason="python-flint is not installed: the extra stiction[proof]")

from flint import acb, arb, fmpq
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from stiction.cli import prove as command
from stiction.cli.exit_codes import BAD_INPUT, FAILED
from stiction.engines import load_engine
from stiction.scenes import catalogue, load_scene, scene_from_dict, vary
from stiction.truths import (
    NotThisMechanism,
    moving_guide_truth,
    oscillator_truth,
    pendulum_truth,
    slider_bar_truth,
    trammel_truth,
)
from stiction.truths.proof.certificate import (
    NotACertificate,
    exact_text,
    read_ball,
    read_ball_within,
    read_certificate,
    read_number,
)
from stiction.truths.proof.enclosures import arc
from stiction.truths.proof.enclosures.exact import (
    NotComparable,
    exact,
    exact_parameters,
    exact_scene,
)
from stiction.truths.proof.enclosures.series import working
from stiction.truths.proof.enclosures.zeros import Undecided
from stiction.truths.proof.mechanisms.one_slider import Contact, OneSlider
from stiction.truths.proof.mechanisms.pendulum import Pendulum
from stiction.truths.proof.mechanisms.sliding_mass import SlidingMass
from stiction.truths.proof.mechanisms.trammel import Trammel
from stiction.truths.proof.motion import provable_mechanism, prove, prove_scene
from stiction.truths.proof.motion_certificate import FORMAT, motion_certificate
from stiction.truths.proof.step import Precision, StateSet, Step, identity

DIGITS = 20
SLIDER_BARS = [name for name in catalogue() if name.startswith("slider-bar-case")]
CASES = [f"slider-bar-case-{case}" for case in (1, 2, 3)]


def bits(digits=DIGITS):
    return Precision.of(digits).working()


ESTIMATED = 3
"""Ratio up to which the error of a truth may exceed its uncertainty where that is a difference of two
discretizations: an estimate."""


def close(ball, value, doubt):
    """Return whether a float is in a ball, up to its own error."""
    return abs(float(ball.mid()) - value) <= float(ball.rad()) + doubt


def assert_agreement(truth, motion, times, estimated=ESTIMATED):
    """Compare events in order, and the columns of the motion at some times, up to the truth's own error."""
    mechanism = motion.mechanism
    with motion.precision.working():
        assert [(e.kind, e.joint) for e in motion.events] == [
            (e.kind, e.joint) for e in truth.events
        ]
        for proven, event in zip(motion.events, truth.events):
            assert close(proven.time, event.time, estimated * truth.uncertainty["event time"])
        for t in times:
            for name, ball in mechanism.columns(arb(float(t)), *motion.at(arb(float(t)))).items():
                assert close(ball, truth(t)[name][0], estimated * truth.uncertainty[name]), (
                    name,
                    t,
                )


@pytest.fixture(scope="module")
def short():
    """Two periods' worth of events of case 1: reversals, corners, stick and slip."""
    scene = vary(load_scene("slider-bar-case-1"), {"t_end": 9})
    return scene, prove_scene(scene, DIGITS)


@pytest.fixture
def short_claims(short):
    scene, motion = short
    return json.loads(json.dumps(motion_certificate(motion, scene, DIGITS)))


# numbers


def test_numbers_are_what_is_written():
    with bits():
        names = {"w": exact("pi/4", {}), "m": exact(0.1, {})}
        assert exact(0.1, {}).factors == (fmpq(1, 10), 0)
        assert exact("1e-3", {}).factors == (fmpq(1, 1000), 0)
        assert exact("0.1+0.2", {}).equals(exact(0.3, {}))  # not so in floats
        assert (exact("pi/2", {}) / names["w"]).factors == (fmpq(2), 0)
        assert exact("deg(180)", {}).equals(exact("pi", {}))
        assert exact("-2^2", {}).factors == (fmpq(-4), 0)
        assert exact("sqrt(k/m)", {"k": exact(4, {}), "m": exact(9, {})}).factors == (fmpq(2, 3), 0)
        assert not exact("sin(1)", {}).equals(exact("cos(1)", {}))
        assert exact("2*sin(pi/9)*cos(1)/3", {}).equals(exact("cos(2/2)*2/3*sin(deg(20))", {}))
        assert exact("sin(1) - 2*sin(1)/2", {}).is_zero and exact("sin(1)*pi", {}).factors is None
        with pytest.raises(NotComparable):
            exact("sin(1)^2+cos(1)^2", {}).equals(exact(1, {}))
        with pytest.raises(ValueError, match="unknown name"):
            exact("2*k", names)


@pytest.mark.parametrize("name", catalogue())
def test_numbers_of_the_catalogue_are_those_that_floats_round(name):
    scene = load_scene(name)
    with bits():
        numbers, parameters = exact_scene(scene), exact_parameters(scene)
        pairs = [(parameters[key], value) for key, value in scene.parameters.items()]
        for key, body in scene.bodies.items():
            found = numbers.bodies[key]
            pairs += [
                (found[field], getattr(body, field)) for field in ("mass", "inertia", "angle")
            ]
            pairs += zip(found.position, body.position)
        for number, value in pairs:
            assert close(number.ball, value, 4e-16 * (1 + abs(value)))


# closed forms


def pulled_block(direction, force=3):
    pull = {
        "type": "force",
        "body": "slider",
        "direction": direction,
        "law": {"type": "constant", "value": force},
    }
    return scene_from_dict(
        {**load_scene("block-on-incline")._raw, "forces": {"pull": pull}}, "pulled"
    )


@pytest.mark.parametrize(
    "direction, force",
    [
        (["cos(incline)", "-sin(incline)"], 0),
        (["cos(incline)", "-sin(incline)"], 3),  # as the guide's is written
        (["2*cos(deg(20))", "-sin(pi/9)*2"], 3),
    ],
)  # of the same value
def test_block_on_incline_is_the_parabola(direction, force):
    motion = prove_scene(pulled_block(direction, force), 30)
    with bits(30):
        slope = arb.pi() / 9
        a = arb(fmpq(981, 100)) * (slope.sin() - arb(fmpq(1, 5)) * slope.cos()) + force
        q, v = motion.at(arb(2))
        assert q[0].overlaps(2 * a) and v[0].overlaps(2 * a)
        assert float(q[0].rad()) < 1e-30
    assert not motion.events


@pytest.mark.parametrize(
    "direction",
    [
        ["cos(incline)", "sin(incline)"],
        ["-cos(incline)", "sin(incline)"],
        ["cos(incline)", "-sin(0.349)"],
        [1, 0],
    ],
)
def test_a_load_that_is_not_along_the_guide_is_refused(direction):
    with pytest.raises(NotThisMechanism, match="along the guide"):
        prove_scene(pulled_block(direction), 30)


def test_pendulum_returns_after_its_period():
    """T = 4 K(sin^2(a/2)) / w (E. T. Whittaker, Analytical Dynamics, sect. 44)."""
    scene = load_scene("pendulum")
    motion = prove_scene(scene, 30)
    with bits(30):
        w = arb(fmpq(981, 100)).sqrt()
        quarter = acb(arb(1) / 2).elliptic_k().real / w
        q, v = motion.at(4 * quarter)
        assert q[0].overlaps(-arb.pi() / 2) and v[0].contains(0)
        assert max(float(q[0].rad()), float(v[0].rad())) < 1e-29
        assert motion.at(quarter)[0][0].contains(0)
    assert_agreement(pendulum_truth(scene), motion, (0.3, 3.1, 7.7), estimated=1)


def test_belt_sticks_and_slips_as_long_as_its_closed_forms_say():
    motion = prove_scene(load_scene("mass-on-belt"), 30)
    with bits(30):
        D, k, v0 = arb(fmpq(981, 1000)), arb(10), arb(fmpq(1, 10))
        w = k.sqrt()
        slip, stick = 2 / w * (arb.pi() - (w * D / (k * v0)).atan()), 2 * D / (k * v0)
        times = [(event.kind, event.time) for event in motion.events]
        assert [kind for kind, _ in times[:4]] == ["slip", "stick", "slip", "stick"]
        for (kind, start), (_, end) in zip(times, times[1:]):
            assert (end - start).overlaps(slip if kind == "slip" else stick)
            assert float(end.rad()) < 1e-30


# truths and the reference


DRIVE = {
    "drives.motor": {
        "type": "angle",
        "bodies": ["arm", "ground"],
        "law": {"type": "linear", "offset": "phi", "rate": "w"},
    }
}
UNLIKE = {
    "joints.pin-x.points": [[0.3, 0], [0, 0]],
    "joints.pin-y.points": [[-0.7, 0], [0, 0]],
    "bodies.bar.position": ["0.7*cos(phi)", "0.3*sin(phi)"],
    "joints.guide-y.mu": 0.02,
    "bodies.bar.velocity": ["0.7*w*sin(phi)", "-0.3*w*cos(phi)"],
    "bodies.slider-y.mass": 2.5,
    "gravity": [1.5, "-g"],
    "forces.torque.law": {
        "type": "sine",
        "amplitude": 4,
        "frequency": 9,
        "offset": 2,
        "phase": 0.5,
    },
}
"""A trammel whose parameters all differ."""


@pytest.mark.parametrize(
    "name, truth, t_end, overrides, events",
    [
        *(
            (name, slider_bar_truth, 24 if name in CASES else 8, {}, events)
            for name, events in zip(SLIDER_BARS, (4, 9, 25, 4, 8, 23, 32, 38, 110), strict=True)
        ),
        ("mass-on-belt", oscillator_truth, 20, {}, 12),
        ("coulomb-oscillator", oscillator_truth, 20, {}, 6),
        ("slider-on-moving-guide", moving_guide_truth, 0.5, {}, 2),
        ("slider-on-moving-guide", moving_guide_truth, 0.5, DRIVE, 1),  # the arm's angle is given
        (
            "elliptic-trammel",
            trammel_truth,
            0.45,
            {},
            5,
        ),  # half a turn: a dead point of each slider, and corners
        ("elliptic-trammel", trammel_truth, 0.2, UNLIKE, 2),
        pytest.param("elliptic-trammel", trammel_truth, 10, {}, 88, marks=pytest.mark.long),
        pytest.param(
            "slider-on-moving-guide", moving_guide_truth, 10, {}, 17, marks=pytest.mark.long
        ),
    ],
)
def test_truths_are_inside(name, truth, t_end, overrides, events):
    """Truths and proofs are derived from different balances. With friction the reference finds as many events."""
    scene = vary(load_scene(name), {"t_end": t_end, **overrides})
    motion = prove_scene(scene, 12)
    assert float(motion.width().upper()) <= 1e-12 and len(motion.events) == events
    estimated = 1 if truth is oscillator_truth else ESTIMATED
    assert_agreement(truth(scene), motion, np.linspace(0.013, 0.99, 40) * t_end, estimated)


def test_reference_of_the_pendulum_errs_in_proportion_to_its_tolerance(compiled):
    """The remaining error is its own: the closed form is within 1e-14 of the proof, at numbers rounded to floats."""
    scene = load_scene("pendulum")
    motion = prove_scene(scene, 15)
    with motion.precision.working():
        proven = float(motion.mechanism.columns(arb(10), *motion.at(arb(10)))["mass.x"].mid())
    assert abs(pendulum_truth(scene)(10.0)["mass.x"][0] - proven) < 1e-14
    runs = (
        load_engine("reference").simulate(scene, rtol=rtol, output_step=10)
        for rtol in (1e-10, 1e-11, 1e-12)
    )
    errors = [abs(run["mass.x"][-1] - proven) for run in runs]
    assert (
        all(finer < coarser / 5 for coarser, finer in zip(errors, errors[1:])) and errors[-1] < 1e-9
    )


# mutations: of the equation, of rounding, of the remainder


def test_a_certificate_is_proven_again(short_claims):
    assert FORMAT.check(short_claims) == []


def test_a_term_of_the_wrong_sign_is_noticed(short_claims, monkeypatch):
    normal = SlidingMass._normal
    monkeypatch.setattr(SlidingMass, "_normal", lambda self, t: 2 * self.weight - normal(self, t))
    assert FORMAT.check(short_claims)


def test_a_remainder_left_out_is_noticed(monkeypatch):
    """At a low order the remainder is what the enclosure lives of."""
    scene, rough = load_scene("pendulum", {"t_end": 2}), Precision(80, 6, 1e-7)

    def end():
        with rough.working():
            return prove(Pendulum.from_scene(scene), rough).end.hull()[0]

    with bits(25):
        true = prove_scene(scene, 25).at(arb(2))[0][0]
    assert end().contains(true)
    monkeypatch.setattr(arc, "_closed", lambda fine, wide: fine[:-1])
    monkeypatch.setattr(Precision, "margin", 0.0)
    assert not end().overlaps(true)


def test_rounding_left_out_is_noticed(monkeypatch):
    scene = load_scene("pendulum", {"t_end": 2})
    with bits(25):
        true = prove_scene(scene, 25).at(arb(2))[0][0]
    image = StateSet.image

    def thin(self, *arguments):
        found = image(self, *arguments)
        return StateSet(found.centre, found.frame, tuple(arb(0) for _ in found.size))

    coarse = Precision(60, 20, 1e-14)
    with coarse.working():
        assert prove(Pendulum.from_scene(scene), coarse).end.hull()[0].contains(true)
        monkeypatch.setattr(StateSet, "image", thin)
        monkeypatch.setattr(Precision, "margin", 0.0)
        assert not prove(Pendulum.from_scene(scene), coarse).end.hull()[0].overlaps(true)


def with_events(claims):
    return next(step for step in claims["steps"] if step["events"])


def in_file(claims, old, new):
    assert old in claims["file"]
    claims["file"] = claims["file"].replace(old, new)


@pytest.mark.parametrize(
    "damage",
    [
        lambda claims: in_file(claims, "mu = 0.03", "mu = 0.03000000000000001"),  # another equation
        lambda claims: in_file(claims, "g = 9.81", "g = 9.810000000000002"),
        lambda claims: in_file(claims, "F0 = 3\n", "F0 = -3\n"),
        lambda claims: claims["steps"][5]["start"]["size"].__setitem__(0, ["0*2^0", "1*2^-400"]),
        lambda claims: with_events(claims)["events"].pop(),
        lambda claims: with_events(claims)["events"][0].update(time=["1*2^0", "1*2^-90"]),
        lambda claims: claims["steps"].remove(with_events(claims)),
        lambda claims: claims["steps"].pop(0),
        lambda claims: claims["steps"][9].update(mode=[-1, 1, 1]),
        lambda claims: claims["steps"][9].update(t0=claims["steps"][3]["t0"]),
        lambda claims: claims["events"][0].update({"time [s]": "0.5 +/- 1e-15"}),
        lambda claims: claims["events"].pop(),
        lambda claims: claims["state at t_end"].update({"slider.x": "0.1 +/- 1e-9"}),
    ],
)
def test_a_damaged_certificate_is_noticed(short_claims, damage):
    damage(short_claims)
    assert FORMAT.check(short_claims)


def test_a_moved_set_is_noticed(short, short_claims):
    _, motion = short
    with bits():
        moved = (motion.steps[5].start.centre[0] + arb(10) ** (2 - DIGITS)).mid()
    short_claims["steps"][5]["start"]["centre"][0] = exact_text(moved)
    assert FORMAT.check(short_claims)


@pytest.mark.parametrize(
    "damage",
    [
        lambda step: step.pop("start"),
        lambda step: step["start"]["size"].__setitem__(0, ["0*2^0", "-1*2^-90"]),
        lambda step: step.update(t0="soon"),
    ],
)
def test_a_file_that_is_no_certificate(short_claims, damage):
    damage(short_claims["steps"][3])
    with pytest.raises(NotACertificate):
        FORMAT.check(short_claims)


@pytest.mark.parametrize(
    "name, t_end, digits",
    [
        (
            "elliptic-trammel",
            0.15,
            12,
        ),  # past a dead point, where a coordinate's ball contains zero
        ("coulomb-oscillator", 4, 14),
        ("mass-on-belt", 5, 12),
    ],
)  # a step has no enclosure as a whole
def test_certificates_of_other_mechanisms_are_proven_again(name, t_end, digits):
    scene = load_scene(name, {"t_end": t_end})
    claims = motion_certificate(prove_scene(scene, digits), scene, digits)
    assert claims["events"] and FORMAT.check(claims) == []


# attacks: any slider-bar, a set of starts, wrong laws, derivatives and roundings


def proves(scene, truth):
    """Return whether a proof goes through and has the truth inside."""
    try:
        assert_agreement(truth, prove_scene(scene, 12), np.linspace(0, truth.t_end, 9)[1:-1])
    except (Undecided, AssertionError):
        return False
    return True


@settings(max_examples=6, deadline=None)
@given(
    mu=st.floats(0.001, 0.2),
    extra=st.sampled_from([0.0, 0.01, 0.1]),
    F0=st.floats(0.5, 8),
    Omega=st.floats(0.5, 3),
    w0=st.floats(-1.5, 1.5),
    m1=st.floats(0.5, 3),
    width=st.floats(0.01, 0.6),
)
def test_any_slider_bar(mu, extra, F0, Omega, w0, m1, width):
    """Two derivations and two arithmetics of one motion; what the proof cannot decide would be an error here."""
    assume(abs(w0) > 0.1)
    scene = vary(
        load_scene(CASES[0]),
        {
            "mu": mu,
            "mus": mu + extra,
            "F0": F0,
            "Omega": Omega,
            "w0": w0,
            "m1": m1,
            "guide.width": width,
            "t_end": 3,
        },
    )
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
    monkeypatch.setattr(Step, "_jump", lambda *arguments: identity(2))
    with Precision.of(20).working():
        assert not set_of_starts().contains(thin)


# laws


@pytest.fixture(scope="module")
def bar():
    scene = load_scene(CASES[0], {"t_end": 4})
    return scene, slider_bar_truth(scene)


def test_the_bar_is_proven(bar):
    assert proves(*bar)


@pytest.mark.parametrize(
    "owner, name, wrong",
    [
        (Contact, "friction", lambda self, slip: -slip * self.mu),  # drives the slip
        (Contact, "friction", lambda self, slip: slip * self.mus),
        (
            Contact,
            "difference",  # surfaces exchanged
            lambda self, R, M, friction: (M - R * (friction * self.width / 2)) * (2 / self.length),
        ),
        (
            OneSlider,
            "_margins",
            lambda self, R, M, P, s: [R * self.contact.mus - P * s],
        ),  # no corners at rest
        (SlidingMass, "_moment", lambda self, t, a: self._theta(t).cos() * self.c * self.g),
    ],
)  # a bar without inertia
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
    monkeypatch.setattr(
        Trammel,
        "_coefficients",
        lambda self, mode: tuple(s * c for s, c in zip(sign, right(self, mode))),
    )
    assert proves(*trammel) == (sign == (1, 1))


# rounding of what is claimed


def test_a_ball_that_is_read_contains_what_is_written_and_a_target_lies_within():
    with working(200, 10):
        for radius in ("1*2^-40", "1073741823*2^-90", "715827883*2^-70"):
            pair = ["5*2^-3", radius]
            outer, inner, exact = read_ball(pair), read_ball_within(pair), read_number(radius)
            assert inner.rad() <= exact <= outer.rad() and outer.mid() == inner.mid()
            assert inner.rad() > exact * 0.999


# what cannot be decided


@pytest.mark.parametrize(
    "name, overrides, when, reason",
    [
        ("hard/painleve-sweep", {}, 1.0847, "friction gain"),
        ("existence-lost", {}, 0.0, "friction gain"),
        ("hard/can-jam", {}, 1.2278, "jam"),
        ("hard/trammel-at-rest", {}, 0.0, "direction"),
        ("elliptic-trammel", {"T": -60, "w": 2, "t_end": 1}, 0.07, "bar stops"),
        (
            "elliptic-trammel",
            {"mu": 0.9, "mus": 0.9, "bodies.slider-y.mass": 40, "bodies.bar.inertia": 0.01},
            0.0,
            "friction gain",
        ),
        # P sin(r t) reaches mus N at its peak and no more: t = pi/2/0.7
        ("coulomb-oscillator", {"b": 1, "load.phase": 0}, np.pi / 1.4, "grazing"),
    ],
)
def test_undecided_says_when_and_why(name, overrides, when, reason):
    with pytest.raises(Undecided, match=reason) as caught:
        prove_scene(load_scene(name, overrides), 12)
    assert abs(float(caught.value.time.mid()) - when) < 0.1


@pytest.mark.parametrize(
    "name",
    [
        "four-bar",
        "slider-crank",
        "painleve-rod",
        "hard/inconsistent-position",
        "hard/inconsistent-velocity",
    ],
)
def test_other_mechanisms_are_refused(name):
    with pytest.raises(NotThisMechanism), bits():
        provable_mechanism(load_scene(name))


@pytest.mark.parametrize("name", ["pendulum-dry-pin", "vertical-slider", "held-arm"])
def test_friction_with_constant_bounds_is_refused(name):
    with pytest.raises(NotThisMechanism), bits():
        provable_mechanism(load_scene(name))


def test_a_constant_bound_is_named_in_one_line():
    """The mechanism is one that can be proven; what it must not have is the first reason."""
    output = invoke("prove slider-bar-case-1 --set guide.friction=1", exit_code=BAD_INPUT).output
    assert "guide.friction: found 1.0; expected none" in output.splitlines()[1]


def test_at_the_edge_of_static_friction():
    """P = mus N (1 -+ 1e-20): rests for ever, or breaks away at the peak; floats cannot tell."""
    for b, moves in (("1 + 1/10^20", False), ("1 - 1/10^20", True)):
        motion = prove_scene(
            load_scene("coulomb-oscillator", {"b": b, "load.phase": 0, "t_end": 4}), 60
        )
        assert [event.kind for event in motion.events] == (["slip", "stick"] if moves else [])


# the command


def test_command_writes_what_it_checks(tmp_path):
    file = tmp_path / "proof.json"
    ended = invoke("prove mass-on-belt --digits 25 --set t_end=3 --out", file)
    assert "proven" in ended.output and ended.output.count("slip") >= 1
    claims = read_certificate(file, (FORMAT.name,))
    assert claims["digits"] == 25 and float(claims["largest width"]) <= 1e-25
    invoke("prove", file, "--check")
    assert invoke("prove mass-on-belt --digits 25 --t-end 12/4").output == ended.output
    claims["steps"][2]["start"]["size"][0] = ["0*2^0", "1*2^-500"]
    file.write_text(json.dumps(claims))
    assert "step 1" in invoke("prove", file, "--check", exit_code=FAILED).output


@pytest.mark.parametrize(
    "arguments, code, culprit",
    [
        ("four-bar", BAD_INPUT, "four-bar"),
        ("nothing", BAD_INPUT, "nothing"),
        ("pendulum --digits 0", BAD_INPUT, "--digits"),
        ("pendulum --out x.csv", BAD_INPUT, "--out"),
        ("pendulum --check", BAD_INPUT, "certificate"),
        ("existence-lost", FAILED, "friction gain"),
    ],
)
def test_command_refuses(arguments, code, culprit):
    assert culprit in invoke(f"prove {arguments}", exit_code=code).output


def test_command_without_the_library(monkeypatch):
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    assert "stiction[proof]" in invoke("prove pendulum", exit_code=FAILED).output
