"""Bands of the reference against closed forms, the return map's numbers, and an independent integration."""

import numpy as np
import pytest

from stiction.comparisons.measures.reference_bands import (
    USUAL_VALUES,
    ReferenceProbe,
    bands_from_own_start,
    bands_of_reference,
    variation_of,
)
from stiction.scenes import InputError, load_scene, scene_from_dict, vary
from stiction.truths.bands import BandKind
from stiction.truths.reduced.stick_bands import examined_bands, mechanism_at

REST, STICK, SLIP = BandKind.REST, BandKind.STICK, BandKind.SLIP
CASE_1 = load_scene("slider-bar-case-1")
MASS, GRAVITY, MU, MUS = 2.0, 9.81, 0.2, 0.3


def shaken_block(P=5.0, mu=MU, mus=MUS):
    """A block on a level floor that a load P sin(2 t) shakes."""
    return scene_from_dict(
        {
            "t_end": 20.0,
            "gravity": [0, -GRAVITY],
            "parameters": {"P": P, "mu": mu, "mus": mus},
            "bodies": {"block": {"mass": MASS, "inertia": 1.0}},
            "joints": {
                "floor": {
                    "type": "translational",
                    "slider": "block",
                    "direction": [1, 0],
                    "mu": "mu",
                    "mus": "mus",
                }
            },
            "forces": {
                "load": {
                    "type": "force",
                    "body": "block",
                    "direction": [1, 0],
                    "law": {"type": "sine", "amplitude": "P", "frequency": 2.0},
                }
            },
        },
        "shaken-block",
    )


def test_a_shaken_block_in_closed_form():
    """It rests for P <= mus N, and never sticks for P >= N sqrt(mus^2 + (pi mu / 2)^2).

    In a steady state without stick each half period T/2 begins with velocity zero at the phase p of the load, and
    changes the velocity by nothing: 2 P cos p = mu N pi. There P sin p must be at least mus N (Den Hartog 1931).
    """
    scene = shaken_block()
    normal = MASS * GRAVITY
    ends = MUS * normal, normal * np.hypot(MUS, np.pi * MU / 2)
    found = bands_from_own_start(scene, variation_of(scene, "P", "floor", (1.0, 14.0), 0.5)).bands
    assert [band.kind for band in found] == [REST, STICK, SLIP]
    for band, end in zip(found, ends):
        assert abs(band.high - end) <= band.high_uncertainty + 1e-9 <= 1e-4


def test_a_coefficient_of_friction_as_the_parameter():
    """The same block at P = 8 N: rest for mus >= P/N; values of mu above mus have no scene."""
    scene = shaken_block(P=8.0, mus=0.5)
    limit = 8.0 / (MASS * GRAVITY)
    found = bands_from_own_start(scene, variation_of(scene, "mus", None, (0.1, 0.6), 0.05)).bands
    assert [band.kind for band in found] == [BandKind.UNKNOWN, SLIP, STICK, REST]
    assert abs(found[-1].low - limit) <= found[-1].low_uncertainty
    assert abs(found[1].low - MU) <= 0.05


@pytest.mark.parametrize(
    ("mu", "ends"), [(0.015, [3.237187, 3.768778, 4.548424]), (0.01, [2.305014, 4.3, 4.723933])]
)
def test_the_slider_sticks_again_above_a_threshold(mu, ends):
    """The ends are those of an independent fixed-step integration of the equation of motion.

    Its step is 2 ms, of fourth order, and it locates stops within a step. At mu = 0.01 the motions
    from 4.2806 to 4.324 N have no steady state, or subharmonic ones: those bands are narrower than the resolution.
    """
    scene = vary(CASE_1, {"mu": mu, "mus": 0.04})
    found = bands_of_reference(scene, variation_of(scene, ends=(2.0, 6.0), resolution=0.1)).bands
    wide = [band for band in found if band.high - band.low > 0.1]
    assert [band.kind for band in wide] == [STICK, SLIP, STICK, SLIP]
    for band, end in zip(wide, ends):
        is_sharp = mu > 0.01 or end != 4.3
        assert abs(band.high - end) <= (max(band.high_uncertainty, 2e-6) if is_sharp else 0.03)


@pytest.mark.long
def test_the_return_map_confirms_and_refines_a_lower_end():
    """Between slip and stick at mu = 0.015, where the sliding motion loses its stability: by halving alone."""
    scene = vary(CASE_1, {"mu": 0.015, "mus": 0.04})
    rough = bands_from_own_start(scene, variation_of(scene, ends=(3.6, 4.0), resolution=0.1)).bands
    slip, stick = examined_bands(mechanism_at(scene, "F0"), rough)
    assert slip.kind == SLIP and stick.kind == STICK and slip.is_confirmed and stick.is_confirmed
    assert slip.high == stick.low
    assert abs(slip.high - 3.7687779) < slip.high_uncertainty < 3e-4


def test_the_end_of_rest_is_where_the_load_exceeds_static_friction():
    """At 0.8106325 N in case 1, whatever mu; just above it the slider creeps for hundreds of periods."""
    variation = variation_of(CASE_1, ends=(0.4, 1.6), resolution=0.2)
    rough = bands_from_own_start(CASE_1, variation).bands
    rest, stick = examined_bands(mechanism_at(CASE_1, "F0"), rough)
    assert rest.kind == REST and stick.kind == STICK and rest.is_confirmed
    assert abs(rest.high - rough[0].high) <= rough[0].high_uncertainty
    assert abs(rest.high - 0.810632474) < 1e-8


def test_a_band_says_that_another_start_leads_elsewhere():
    """Of the catalogue's two attractors: rest up to 1.9946 N, and a sliding motion down to 1.781 N."""
    scene = load_scene("hard/threshold-of-two-attractors")
    variation = variation_of(scene, ends=(1.5, 2.3), resolution=0.05)
    found = bands_of_reference(scene, variation).bands
    assert [band.kind for band in found] == [REST, SLIP]
    rest, slip = found
    assert abs(rest.high - 1.9945997) < 1e-5
    assert SLIP in rest.coexisting and rest.depends_on_start


def test_no_kind_depends_on_the_start_above_a_range_of_subharmonics():
    """Of the other scene of the catalogue about a threshold: 9.039113413 N, from the return map; one band, one kind."""
    scene = load_scene("hard/threshold-after-subharmonics")
    found = bands_of_reference(scene, variation_of(scene, ends=(8.6, 9.4), resolution=0.1)).bands
    assert [band.kind for band in found] == [STICK, SLIP]
    assert not any(band.depends_on_start for band in found)
    assert abs(found[0].high - 9.039113413) <= found[0].high_uncertainty < 2e-5


@pytest.mark.parametrize("F0", [0.5, 3.0, 3.5, 4.1, 6.0, 9.0])
def test_a_motion_that_goes_on_from_its_last_state_is_the_same_as_one_run(F0, monkeypatch):
    """The kind, and the state after whole periods, of a first run that is too short and of one that is long enough."""
    scene = vary(CASE_1, {"mu": 0.015, "t_end": 4.0})
    probe = ReferenceProbe(scene, variation_of(scene), 1e-9)
    whole = probe.motion(F0)
    monkeypatch.setattr("stiction.comparisons.measures.reference_bands.FIRST_PERIODS", 3)
    monkeypatch.setattr("stiction.comparisons.measures.reference_bands.LONGEST", 160)
    in_parts = probe.motion(F0)
    assert in_parts.kind == whole.kind
    for key, value in whole.end.items():
        np.testing.assert_allclose(in_parts.end[key], value, atol=2e-5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (dict(joint="pin"), "joint: found 'pin'; expected one of guide"),
        (dict(parameter="nonsense", ends=(0.0, 1.0)), "parameter: found 'nonsense'"),
        (dict(parameter="guide.mu"), "range: found none for guide.mu"),
        (dict(ends=(3.0, 1.0)), "LOW < HIGH"),
        (dict(resolution=100.0), "at most the width"),
    ],
)
def test_bad_input(options, words):
    with pytest.raises(InputError, match=words):
        variation_of(CASE_1, **options)


def test_scenes_without_friction_or_without_the_parameter():
    with pytest.raises(InputError, match="no joint with friction in pendulum"):
        variation_of(load_scene("pendulum"))
    with pytest.raises(InputError, match="expected --parameter"):
        variation_of(shaken_block())


def test_no_motion_at_any_value():
    scene = shaken_block()
    with pytest.raises(InputError, match="mu"):
        bands_from_own_start(scene, variation_of(scene, "mu", None, (0.4, 0.6), 0.1))


def test_defaults_are_derived_from_the_scene():
    found = variation_of(CASE_1)
    assert (found.parameter, found.joint, found.own) == ("F0", "guide", 3.0)
    assert (found.searched.low, found.searched.high) == (0.0, 12.0)
    assert len(found.searched.values()) == USUAL_VALUES + 1


def test_pin_under_a_periodic_torque():
    """An arm under F0 sin(w t) moves without a rest from F0 = tau sqrt(1 + pi^2/4) on, Den Hartog's case without a spring.

    Its speed is zero at instants half a period apart, so that the impulse of torque and friction between them is zero:
    F0 cos(phase) = pi tau/2. It does not rest there if F0 sin(phase) >= tau.
    """
    tau = 2.0
    scene = scene_from_dict(
        {
            "t_end": 10.0,
            "parameters": {"F0": 3.0},
            "bodies": {"arm": {"mass": 1.0, "inertia": 0.1}},
            "joints": {"pin": {"type": "revolute", "bodies": ["arm", "ground"], "friction": tau}},
            "forces": {
                "motor": {
                    "type": "torque",
                    "body": "arm",
                    "law": {"type": "sine", "amplitude": "F0", "frequency": 6.0},
                }
            },
        }
    )
    variation = variation_of(scene, ends=(3.2, 4.2), resolution=0.1)
    assert variation.joint == "pin"
    stick, slip = bands_of_reference(scene, variation).bands
    assert (stick.kind, slip.kind) == (STICK, SLIP)
    assert stick.high == pytest.approx(tau * np.sqrt(1 + np.pi**2 / 4), abs=1e-5)
