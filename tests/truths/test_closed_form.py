"""Closed forms: published digits, and each against the collocation of its equation of motion or its own derivatives."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from truth_checks import between_events, check_motion, check_newton_and_euler

from stiction.engines import load_engine
from stiction.scenes import load_scene, vary
from stiction.truths import (
    four_bar_truth,
    incline_truth,
    moving_guide_truth,
    oscillator_truth,
    pendulum_truth,
    slider_crank_truth,
    trammel_truth,
)
from stiction.truths.closed_form.oscillator import first_zero
from stiction.truths.closed_form.pendulum import pendulum_angle


def den_hartog(r):
    """V and U of J. P. Den Hartog, Forced vibrations with combined Coulomb and viscous friction, Trans. ASME 53 (1931)."""
    return 1 / (1 - r * r), np.sin(np.pi / r) / (r * (1 + np.cos(np.pi / r)))


def test_den_hartog_limit():
    """No stops up to b = |V|/hypot(U, S/r^2), S the maximum of a quotient over s > 0, which is its limit 1 at r = 0.7.

    The figure handed down, 0.722090, is the formula with the maximum over s >= 1e-4.
    """
    r, (V, U), s = 0.7, den_hartog(0.7), np.linspace(1e-4, np.pi - 1e-4, 2000)
    S = np.max((r * np.sin(s / r) + U * r * r * (np.cos(s) - np.cos(s / r))) / np.sin(s))
    assert round(V / np.hypot(U, S / r**2), 6) == 0.722090 and 0 < 1 - S < 1e-3
    limit = V / np.hypot(U, 1 / r**2)
    # the motion itself decides: a stick phase in the steady state above, none below
    for b, sticks in (
        (0.995 * limit, False),
        (limit - 1e-6, False),
        (limit + 1e-6, True),
        (1.01 * limit, True),
    ):
        truth = oscillator_truth(load_scene("coulomb-oscillator", {"b": b}), 500.0)
        assert any(e.kind == "stick" for e in truth.events if e.time > 400) == sticks, b


@pytest.mark.parametrize("method", ["truth", "reference"])
def test_oscillator_reaches_the_closed_form_peak(method):
    scene = load_scene("coulomb-oscillator")
    found = (
        oscillator_truth(scene, 400.0)
        if method == "truth"
        else load_engine("reference").simulate(scene, t_end=400.0, rtol=1e-12, output_step=400.0)
    )
    turns = [abs(event.before["slider.x"]) for event in found.events if event.kind == "reversal"]
    V, U = den_hartog(0.7)
    peak = np.sqrt(V * V - 0.5**2 * U * U)
    assert abs(peak - 1.744253936249) < 0.6e-12  # digits given
    # 1e-11: what is left of the start after 400 s, from the decrease of the change from turn to turn; and ten rtol
    assert turns[-1] == pytest.approx(peak, abs=1e-11)


@pytest.mark.parametrize(
    "name, overrides",
    [("coulomb-oscillator", {}), ("coulomb-oscillator", {"b": 0.8}), ("mass-on-belt", {})],
)
def test_oscillator_obeys_coulomb(name, overrides):
    scene = load_scene(name, overrides)
    truth = oscillator_truth(scene, 30.0)
    check_newton_and_euler(scene, truth)
    c = truth(between_events(truth, 700))
    guide = scene.guides["guide"]
    assert np.all(np.abs(c["guide.friction"]) <= guide.static_coefficient * 9.81 + 1e-12)
    slip = c["guide.mode"] != 0
    coulomb = -guide.mu * 9.81 * np.sign(c["guide.slip_velocity"])
    np.testing.assert_allclose(c["guide.friction"][slip], coulomb[slip], atol=1e-12)
    assert np.max(np.abs(c["guide.slip_velocity"][~slip]), initial=0.0) == 0


def test_belt_cycle():
    scene = load_scene("mass-on-belt")
    truth = oscillator_truth(scene, 40.0)
    w, stretch, speed = np.sqrt(10), (0.3 - 0.2) * 9.81 / 10, 0.1  # (mus - mu) N / k
    times = {
        kind: np.array([e.time for e in truth.events if e.kind == kind])
        for kind in ("slip", "stick")
    }
    n = min(map(len, times.values()))
    np.testing.assert_allclose(
        times["stick"][:n] - times["slip"][:n],
        2 / w * (np.pi - np.arctan(w * stretch / speed)),
        atol=1e-12,
    )
    np.testing.assert_allclose(
        times["slip"][1:n] - times["stick"][: n - 1], 2 * stretch / speed, atol=1e-12
    )
    t = np.linspace(times["slip"][0], times["stick"][0], 20001)
    swing = np.max(np.abs(truth(t)["slider.x"] - 0.2 * 9.81 / 10))
    assert swing == pytest.approx(
        np.hypot(stretch, speed / w), abs=1e-8
    )  # the sampled maximum is flat: (6e-5 s * 3.2 / s)^2 / 2


def test_first_zero_overlooks_no_close_pair_of_roots():
    """(t - 1)^2 - 1e-10 has two roots 2e-5 apart; the bound on the third derivative is generous."""

    def function(t):
        return (t - 1) ** 2 - 1e-10, 2 * (t - 1), 2.0

    assert first_zero(function, 10.0, 0.0, 2.0) == pytest.approx(1 - 1e-5, abs=1e-10)
    assert first_zero(lambda t: (1 + t, 1.0, 0.0), 0.0, 0.0, 5.0) == np.inf


@pytest.mark.parametrize(
    "degrees, slides", [(20, True), (15, False), (16.69, False), (16.71, True)]
)
def test_incline(degrees, slides):
    """mus = 0.3: arctan 0.3 = 16.699 degrees."""
    truth = incline_truth(load_scene("block-on-incline", {"incline": f"deg({degrees})"}))
    beta = np.radians(degrees)
    expected = 9.81 * (np.sin(beta) - 0.2 * np.cos(beta)) if slides else 0.0
    c = truth(np.array([0.0, 1.0]))
    assert c["guide.displacement"][1] == pytest.approx(expected / 2, abs=1e-14)
    assert c["guide.friction"][1] == pytest.approx(
        -9.81 * (0.2 * np.cos(beta) if slides else np.sin(beta)), abs=1e-14
    )
    assert c["guide.normal_force"][1] == pytest.approx(9.81 * np.cos(beta), abs=1e-14)


@pytest.mark.parametrize("degrees, kind", [(20, "reversal"), (15, "stick")])
def test_block_thrown_uphill_stops_and_returns_or_stays(degrees, kind):
    beta = np.radians(degrees)
    scene = load_scene("block-on-incline", {"incline": f"deg({degrees})"})
    (event,) = incline_truth(
        vary(scene, {"slider.velocity": [-np.cos(beta), np.sin(beta)]}), 2.0
    ).events
    deceleration = 9.81 * (np.sin(beta) + 0.2 * np.cos(beta))
    assert event.kind == kind
    assert event.time == pytest.approx(1 / deceleration, rel=1e-14)
    assert event.before["guide.displacement"] == pytest.approx(-0.5 / deceleration, rel=1e-13)


def test_pendulum_of_the_benchmark_library():
    c = pendulum_truth(load_scene("pendulum"))(10.0)
    assert abs(c["mass.x"][0] + 0.275087463) < 0.6e-9  # half a unit of the last digit
    assert abs(c["mass.y"][0] + 0.961419205) < 0.6e-9


@pytest.mark.parametrize(
    "angle, rate", [(0.3, 1.0), (-2.0, 3.0), (2.5, -9.0), (0.0, 6.5), (3.0, 0.0), (-np.pi / 2, 0.0)]
)
def test_pendulum_moves_from_any_start_as_newton_says(angle, rate):
    sin, cos = float(np.sin(angle)), float(np.cos(angle))
    scene = vary(
        load_scene("pendulum"),
        {"mass.position": [sin, -cos], "mass.velocity": [rate * cos, rate * sin]},
    )
    truth = pendulum_truth(scene, 10.0)
    c = truth(0.0)
    assert (c["mass.x"][0], c["mass.y"][0], c["mass.vx"][0], c["mass.vy"][0]) == pytest.approx(
        (sin, -cos, rate * cos, rate * sin), abs=1e-13
    )
    check_newton_and_euler(scene, truth)
    check_motion(scene, truth, 1e-5)  # h^4/30 times the fifth derivative, at up to 11 rad/s


@pytest.mark.parametrize(
    "start", [(0.3, 1.0), (0.0, 6.5)]
)  # the second next to the separatrix, at 6.26
def test_pendulum_agrees_with_an_integration(start):
    """SciPy's DOP853 at its tightest: an error of phase would grow to more over ten swings."""
    w = np.sqrt(9.81)
    found = solve_ivp(
        lambda t, y: (y[1], -w * w * np.sin(y[0])),
        (0, 10),
        start,
        method="DOP853",
        rtol=3e-14,
        atol=1e-14,
    )
    angle, rate, _ = pendulum_angle(np.array([0.0, 10.0]), w, *start)
    assert (angle[0], rate[0]) == pytest.approx(start, abs=1e-13)
    # 1e-10: rounding of each step, which ten swings multiply by up to 1e3 close to the separatrix
    assert (angle[1], rate[1]) == pytest.approx(found.y[:, -1], abs=1e-10)


def test_pendulum_at_rest_and_on_the_separatrix():
    assert np.all(pendulum_angle(np.linspace(0, 1, 3), 2.0, 0.0, 0.0)[0] == 0)
    with pytest.raises(ValueError, match="separatrix"):
        pendulum_angle(np.zeros(1), 2.0, 0.0, 4.0)


def test_four_bar_of_the_benchmark_library():
    c = {name: value[0] for name, value in four_bar_truth(load_scene("four-bar"))(10.0).items()}
    # the published twelve digits are an integration's: 1e-11
    assert 2 * c["upright-0.x"] == pytest.approx(0.328458111533, abs=1e-11)
    assert 2 * c["upright-0.y"] == pytest.approx(0.944518538181, abs=1e-11)
    assert 2 * c["upright-0.vx"] == pytest.approx(
        1.423051470, abs=0.6e-9
    )  # half a unit of the last digit
    assert 2 * c["upright-0.vy"] == pytest.approx(-0.494868845, abs=0.6e-9)


def test_slider_crank_does_no_work_over_a_turn():
    truth = slider_crank_truth(load_scene("slider-crank"), 1.0)
    torque = truth(np.arange(256) / 256)["motor.effort"]
    assert abs(np.mean(torque)) < 1e-12  # the trapezoidal rule converges exponentially for a period


def test_refusals_name_the_scene():
    for build in (
        incline_truth,
        pendulum_truth,
        four_bar_truth,
        slider_crank_truth,
        oscillator_truth,
        trammel_truth,
        moving_guide_truth,
    ):
        with pytest.raises(ValueError, match="slider-bar-case-1"):
            build(load_scene("slider-bar-case-1"))
    with pytest.raises(ValueError, match="too short"):
        slider_crank_truth(vary(load_scene("slider-crank"), {"l": 0.4}))
    with pytest.raises(ValueError, match="resonance"):
        oscillator_truth(load_scene("coulomb-oscillator", {"r": 1.0}))
