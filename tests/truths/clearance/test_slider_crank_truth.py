"""The truth of the slider-crank with clearance: columns against the motion, derivatives, balances, and its use."""

import numpy as np
import pytest

from stiction.comparisons.bench.participants import variant
from stiction.comparisons.bench.variants import Record
from stiction.comparisons.measures.scene_truth import ground_truth, truths_for
from stiction.engines import Outcome, load_engine
from stiction.scenes import load_scene, vary
from stiction.scenes.fidelity import Fidelity
from stiction.truths import NotThisMechanism, Tier, clearance_slider_crank_truth

SCENE = load_scene("slider-crank-clearance")
T_END = 0.02
"""End of the truths, s: after the first two impacts of the upper corners, at 2.7 and 5.6 ms."""
FIRST_IMPACT = 2.692e-3
G = 9.81


@pytest.fixture(scope="module")
def truth():
    return ground_truth(SCENE, T_END)


def smooth_instants():
    """Instants of the two flights, away from impacts, s."""
    return np.concatenate([np.linspace(1e-4, 2.6e-3, 20), np.linspace(2.8e-3, 5.5e-3, 20)])


def test_it_is_independent_and_precise(truth):
    assert truth.tier == Tier.HIGH_PRECISION and truth.has_gaps
    for body in SCENE.bodies:
        assert truth.uncertainty[f"{body}.x"] < 1e-12


def test_velocities_and_accelerations_are_derivatives(truth):
    t, h = smooth_instants(), 1e-6
    before, at, after = truth(t - h), truth(t), truth(t + h)
    for body in SCENE.bodies:
        for position, velocity, acceleration in (
            ("x", "vx", "ax"),
            ("y", "vy", "ay"),
            ("angle", "omega", "alpha"),
        ):
            place, speed = f"{body}.{position}", f"{body}.{velocity}"
            rate = (after[place] - before[place]) / (2 * h)
            np.testing.assert_allclose(rate, at[speed], rtol=1e-5, atol=1e-3)
            change = (after[speed] - before[speed]) / (2 * h)
            np.testing.assert_allclose(change, at[f"{body}.{acceleration}"], rtol=1e-5, atol=1e-2)


def test_energy_is_kept_in_flight_and_lost_in_impacts(truth):
    def energy(t, side="after"):
        values = truth(t, side)
        total = 0.0
        for name, body in SCENE.bodies.items():
            speeds = values[f"{name}.vx"] ** 2 + values[f"{name}.vy"] ** 2
            total = total + 0.5 * body.mass * speeds + body.mass * G * values[f"{name}.y"]
            total = total + 0.5 * body.inertia * values[f"{name}.omega"] ** 2
        return total

    first, second = np.split(energy(smooth_instants()), 2)
    np.testing.assert_allclose(first, first[0], rtol=1e-11)
    np.testing.assert_allclose(second, second[0], rtol=1e-11)
    assert second[0] < first[0]


def test_pins_hold_and_corners_stay_within_their_gap(truth):
    values = truth(np.linspace(0, T_END, 200))
    tip_x = values["crank.x"] * 2
    rod_x = values["rod.x"] - 0.153 * np.cos(values["rod.angle"])
    np.testing.assert_allclose(tip_x, rod_x, atol=1e-13)
    assert np.abs(values["slider.y"]).max() <= 1e-3 * (1 + 1e-9)
    for corner in range(1, 5):
        assert (values[f"guide.F{corner}"] >= -1e-9).all()


def test_joint_runs_are_compared_with_ideal_joints_and_contact_runs_with_impacts():
    ideal = ground_truth(SCENE, T_END, Fidelity.JOINT)
    assert not ideal.has_gaps and "joints.guide.clearance" in ideal.note
    assert np.abs(ideal(np.array([T_END]))["slider.y"]).max() < 1e-9
    records = []
    for label, settings in (("reference", {"rtol": 1e-9}), ("Moreau, contact", {"dt": 1e-5})):
        one = variant(label)
        run = load_engine(one.engine).simulate(
            SCENE, fidelity=one.fidelity, t_end=T_END, output_step=1e-3, **settings
        )
        records.append(Record(label, SCENE.name, one, 1.0, Outcome(label, "ok", run)))
    truths = truths_for(SCENE, records, T_END)
    joint, contact = truths["reference"], truths["Moreau, contact"]
    assert (joint.has_gaps, contact.has_gaps) == (False, True)
    assert joint.scene != contact.scene
    for record, own, other in zip(records, (joint, contact), (contact, joint)):
        run = record.run
        error = np.abs(run["crank.angle"] - own(run.t)["crank.angle"]).max()
        wrong = np.abs(run["crank.angle"] - other(run.t)["crank.angle"]).max()
        assert error < 0.02 * wrong


def test_other_scenes():
    """Without a truth with impacts, the truth of a scene with clearance is that of ideal joints."""
    with pytest.raises(NotThisMechanism):
        clearance_slider_crank_truth(load_scene("slider-bar-case-1"))
    driven = vary(load_scene("slider-bar-case-3-mus-equals-mu"), {"guide.clearance": 1e-3})
    assert not ground_truth(driven, 0.5).has_gaps
    # one coefficient of friction is the law of the truth with impacts
    static = vary(SCENE, {"guide.mus": 0.02})
    assert not ground_truth(static, T_END).has_gaps
