"""Truths whose uncertainty is that of an enclosure, read from certificates."""

import subprocess
import sys
from collections import Counter
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from stiction.comparisons.bench.variants import Record, Variant
from stiction.comparisons.measures.accuracy import TORQUE_ERROR, errors
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.comparisons.regression.measurement import _errors
from stiction.engines import Outcome
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import catalogue, load_scene, vary
from stiction.truths import Tier, slider_bar_truth
from stiction.truths.physics import physics_of
from stiction.truths.proof.truth import Contradiction, certificates, motion_digest, with_proof

NO_FLINT = """
import sys
sys.modules["flint"] = None
"""
ROWS = """
from stiction.comparisons.bench.campaign import load_campaign
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.regression.measurement import task_of

variant = Variant("reference", "reference", "rtol", (1e-6,), settings={"stabilization": "projection"})
campaign = load_campaign().model_copy(update={"variants": (variant,)})
for run in campaign.runs:
    if run.scene.name in ("slider-bar-case-1", "slider-bar-case-1-frictionless", "mass-on-belt", "pendulum"):
        task = task_of(run, ("accuracy", "event"), 1)
        print(run.key, task.function(*task.args).metrics)
"""


@pytest.fixture(scope="module")
def scene():
    return load_scene("slider-bar-case-1", {"t_end": 6})


@pytest.fixture(scope="module")
def truth(scene):
    return ground_truth(scene)


def python(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True
    ).stdout


def test_rows_are_the_same_with_and_without_ball_arithmetic(compiled):
    without = python(NO_FLINT + ROWS)
    with redirect_stdout(StringIO()) as printed:
        exec(ROWS, {})
    assert without == printed.getvalue()
    assert without.count(f"tier={Tier.PROVEN!r}") > 20 and without.count("/truth") == 4


def digest_of(scene):
    return motion_digest(scene.to_toml())


def test_every_certificate_is_of_a_scene_as_it_is():
    """A changed scene of the catalogue needs a new one: `python -m stiction.truths.proof.truth_certificate`."""
    current = {
        digest_of(physics_of(load_scene(name), static))
        for name in catalogue()
        for static in (True, False)
    }
    stale = [file.name for file in certificates() if file.name.split(".")[1] not in current]
    assert stale == [] and sum(file.stat().st_size for file in certificates()) < 2e6


@pytest.mark.parametrize(
    "name",
    [
        "block-on-incline",
        "coulomb-oscillator",
        "elliptic-trammel",
        "mass-on-belt",
        "pendulum",
        "slider-on-moving-guide",
        *(
            f"slider-bar-case-{case}{kind}"
            for case in (1, 2, 3)
            for kind in ("", "-frictionless", "-mus-equals-mu")
        ),
    ],
)
def test_every_scene_that_is_proven_has_a_certificate(name):
    digests = {file.name.split(".")[1] for file in certificates()}
    assert digest_of(load_scene(name)) in digests
    if name != "mass-on-belt":  # undecided with one coefficient
        assert digest_of(physics_of(load_scene(name), False)) in digests


def test_a_digest_is_of_the_motion_alone(scene):
    digest, text = digest_of(scene), scene.to_toml()
    assert motion_digest(text.replace('title = "', 'title = "another ')) == digest
    assert digest_of(vary(scene, {"t_end": 3, "stabilization.alpha": 5})) == digest
    assert motion_digest(text.replace("Omega", "om")) == digest  # a parameter's name
    assert digest_of(vary(scene, {"g": 9.8100000000000005})) == digest  # the same double as 9.81
    for changed in (
        {"mus": 0.041},
        {"g": 9.81000000000001},
        {"slider.position": [0.26, 0]},
        {"guide.width": 0.4},
    ):
        assert digest_of(vary(scene, changed)) != digest, changed


def test_a_changed_scene_has_the_tier_below(scene):
    assert ground_truth(vary(scene, {"F0": 3.0001})).tier == Tier.HIGH_PRECISION
    longer = load_scene("slider-bar-case-1", {"t_end": 25})  # the certificate ends at 24 s
    assert ground_truth(longer).tier == Tier.HIGH_PRECISION
    assert ground_truth(load_scene("slider-crank", {"t_end": 0.1})).tier == Tier.CLOSED_FORM


def test_a_part_of_a_proven_motion_is_proven(scene, truth):
    """Columns and events of a truth that ends earlier are those of the whole one."""
    whole, t = ground_truth(load_scene("slider-bar-case-1")), np.linspace(0, 6, 100)
    assert truth.tier == whole.tier == Tier.PROVEN
    assert truth.effort_tier == Tier.HIGH_PRECISION  # no proof encloses the motor's torque
    assert [event.time for event in truth.events] == [
        event.time for event in whole.events if event.time < 6
    ]
    assert all(
        np.array_equal(truth(t)[name], whole(t)[name]) for name in ("bar.x", "bar.vy", "slider.vx")
    )
    assert truth.uncertainty["motor.effort"] == slider_bar_truth(scene).uncertainty["motor.effort"]


def test_each_number_of_a_run_says_its_own_tier(truth):
    """Errors and jumps of the torque are measured against the tier below: a proof does not enclose it."""
    run = ReferenceEngine().simulate(load_scene("slider-bar-case-1"), t_end=6.0, rtol=1e-9)
    tiers = {metric.name: metric.tier for metric in _errors(errors(run, truth, 1.0), truth)}
    assert (
        tiers.pop(TORQUE_ERROR) == Tier.HIGH_PRECISION
        and len(tiers) > 3
        and set(tiers.values()) == {Tier.PROVEN}
    )
    variant = Variant("reference", "reference", "rtol", (1e-9,))
    record = Record("key", "slider-bar-case-1", variant, 1e-9, Outcome("key", "ok", run))
    jumps = torque_table([record], {"key": truth})
    assert len(jumps) and set(jumps["truth_tier"]) == {Tier.HIGH_PRECISION}


@pytest.mark.parametrize("overrides", [{}, {"guide.mu": 0.0, "guide.mus": 0.0}])
def test_a_guide_without_friction_has_no_events_in_any_tier(overrides, compiled):
    """Corner forces and velocities that pass zero change nothing there: neither truth nor run counts them."""
    name = "slider-bar-case-1" if overrides else "slider-bar-case-1-frictionless"
    scene = load_scene(name, {**overrides, "t_end": 8.0})
    below = slider_bar_truth(scene)
    assert Counter(event.kind for event in below.events)["corner"] > 0
    assert ground_truth(scene).tier == (Tier.HIGH_PRECISION if overrides else Tier.PROVEN)
    found = errors(ReferenceEngine().simulate(scene, rtol=1e-9), ground_truth(scene))
    assert found["position_error"] < 1e-8
    assert not any(found.get(f"events {what}") for what in ("matched", "missed", "spurious"))


def test_zero_coefficients_contradict_no_truth(compiled):
    assert ground_truth(load_scene("hard/zero-coefficients")).events == ()


def test_what_differs_from_the_proof_is_a_contradiction(scene):
    before = slider_bar_truth(scene)

    def columns(t, side):
        found = before.columns(t, side)
        return found | {"bar.y": found["bar.y"] * (1 + 1e-9)}

    for changes, what in (
        ({"events": before.events[1:]}, "proven are"),
        ({"columns": columns}, "bar.y"),
    ):
        with pytest.raises(Contradiction, match=what):
            with_proof(scene, replace(before, **changes))


def test_certificates_come_with_an_installation():
    text = (Path(__file__).parents[3] / "pyproject.toml").read_text()
    assert '"data/*.json.gz"' in text and all(
        file.name.endswith(".json.gz") for file in certificates()
    )
