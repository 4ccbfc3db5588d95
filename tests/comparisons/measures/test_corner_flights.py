"""The law of free flight through a clearance: closed forms, exponents, and the first impacts of Moreau's method."""

import math

import numpy as np
import pytest

from stiction.comparisons.measures.corner_flights import Release, corner_flights, crossing_time
from stiction.engines import load_engine
from stiction.scenes import InputError, load_scene, scene_from_dict, vary

MASS, INERTIA, LENGTH, WIDTH, GRAVITY, TORQUE_RATE = 2.0, 0.08, 0.6, 0.5, 9.81, 4.0


def tilted_box(mu=None, speed=0.0, **changes):
    """Return a box on a horizontal guide, on which a growing torque lifts the rear end.

    With the torque -k t and the front end held, the rear force n of the ideal joint follows from the balance of moments
    about the centre: k t = a/2 (m g - 2 n) - mu d b/2 m g (d: direction of slip, b: width, a: length).
    """
    guide = {"type": "translational", "slider": "slider", "length": LENGTH, "width": WIDTH}
    if mu is not None:
        guide["mu"] = mu
    tables = {
        "t_end": 3.0,
        "gravity": [0, -GRAVITY],
        "bodies": {"slider": {"mass": MASS, "inertia": INERTIA, "velocity": [speed, 0.0]}},
        "joints": {"guide": guide},
        "forces": {
            "torque": {
                "type": "torque",
                "body": "slider",
                "law": {"type": "linear", "rate": -TORQUE_RATE},
            }
        },
    }
    return scene_from_dict(tables, overrides=changes)


def expected_flight(mu, direction, gap):
    """Return time of release, rate of force, effective mass and time of flight of the tilted box in closed form.

    With the front end held, y'' = -(a/2) angle'' and the force on it is m (g + y''), which turns the box by the lever
    a/2 - mu d b/2 of normal force and friction: (I + m a/2 lever) angle'' = -k t + m g lever. The rear end rises by
    -a angle.
    """
    lever = LENGTH / 2 - mu * direction * WIDTH / 2
    release = MASS * GRAVITY * lever / TORQUE_RATE
    rate = TORQUE_RATE / LENGTH
    mass = (INERTIA + MASS * LENGTH / 2 * lever) / LENGTH**2
    return release, rate, mass, (12 * mass * gap / rate) ** (1 / 3)


@pytest.mark.parametrize(
    ("mu", "speed"), [(None, 0.0), (None, 1.0), (0.0, 1.0), (0.2, 20.0), (0.2, -20.0), (0.4, 20.0)]
)
@pytest.mark.parametrize("gap", [1e-3, 1e-6])
def test_flight_of_a_box_in_closed_form(mu, speed, gap):
    scene = tilted_box(mu, speed)
    ideal = load_engine("reference").simulate(scene, t_end=2.5)
    (flight,) = corner_flights(scene, ideal, gap)
    release, rate, mass, time = expected_flight(mu or 0.0, np.sign(speed), gap)
    assert (flight.corner, flight.opposite_corner, flight.release) == (1, 4, Release.ZERO)
    assert flight.time == pytest.approx(release, rel=1e-8)
    assert flight.rate == pytest.approx(rate, rel=1e-6)
    assert flight.mass == pytest.approx(mass, rel=1e-6)
    assert flight.flight_time == pytest.approx(time, rel=1e-6)
    assert flight.impact_speed == pytest.approx(rate / (2 * mass) * time**2, rel=1e-6)


def test_a_box_at_rest_turns_about_the_corner_that_holds_it():
    """Friction at rest holds the front corner at the lower surface, so that the centre moves on a circle about it."""
    scene = tilted_box(0.9)
    ideal = load_engine("reference").simulate(scene, t_end=2.5)
    assert not [event for event in ideal.events if event.kind == "corner"]
    flight = corner_flights(scene, ideal, 1e-4)[0]
    about_corner = INERTIA + MASS * (LENGTH**2 + WIDTH**2) / 4
    assert flight.corner == 1
    assert flight.mass == pytest.approx(about_corner / LENGTH**2, rel=1e-6)
    assert flight.time == pytest.approx(MASS * GRAVITY * LENGTH / 2 / TORQUE_RATE, rel=1e-8)


def test_both_ends_that_are_released_together_fly_with_half_of_the_mass_each():
    """A load through the centre that passes the weight: the box is lifted, each end carries half of m y''."""
    lift = {
        "type": "force",
        "body": "slider",
        "direction": [0, 1],
        "law": {"type": "linear", "rate": 10.0},
    }
    scene = tilted_box(
        0.1, 20.0, **{"forces.torque": None, "forces.lift": lift, "guide.width": 0.0}
    )
    ideal = load_engine("reference").simulate(scene, t_end=2.5)
    flights = corner_flights(scene, ideal, 1e-4)
    assert [flight.corner for flight in flights] == [1, 2]
    for flight in flights:
        assert flight.time == pytest.approx(MASS * GRAVITY / 10.0, rel=1e-6)
        assert flight.rate == pytest.approx(5.0, rel=1e-6)
        assert flight.mass == pytest.approx(MASS / 2, rel=1e-6)


def test_each_guide_has_its_own_gap():
    scene = tilted_box(0.2, 20.0, **{"guide.clearance": 1e-3})
    ideal = load_engine("reference").simulate(scene, t_end=2.5)
    declared = corner_flights(scene, ideal)
    assert declared == corner_flights(scene, ideal, 1e-3)
    doubled = corner_flights(scene, ideal, 2e-3)
    assert doubled[0].flight_time / declared[0].flight_time == pytest.approx(2 ** (1 / 3))
    assert corner_flights(tilted_box(0.2, 20.0), ideal) == []
    for wrong in (0.0, -1e-3, math.nan, math.inf):
        with pytest.raises(InputError, match="clearance"):
            corner_flights(scene, ideal, wrong)


def test_the_crossing_time_satisfies_its_equation():
    dice = np.random.default_rng(50)
    for _ in range(300):
        acceleration = dice.choice([0.0, dice.uniform(0.0, 50.0)])
        jerk = dice.uniform(-30.0, 30.0)
        distance = 10.0 ** dice.uniform(-7, -2)
        time = crossing_time(acceleration, jerk, distance)
        instants = np.linspace(0.0, 1.0 if math.isnan(time) else time, 1001)[:-1]
        path = acceleration * instants**2 / 2 + jerk * instants**3 / 6
        assert path.max() < distance * (1 + 1e-9)
        if not math.isnan(time):
            assert acceleration * time**2 / 2 + jerk * time**3 / 6 == pytest.approx(distance)


def first_impact(scene, flight, dt):
    """Return the time after the release at which the opposite corner hits in Moreau's method, and its speed."""
    changed = vary(scene, {f"{flight.guide}.clearance": flight.clearance})
    t_end = flight.time + 2 * flight.flight_time
    run = load_engine("moreau").simulate(
        changed, fidelity="contact", dt=dt, output_step=dt, t_end=t_end
    )
    force = run[f"{flight.guide}.F{flight.opposite_corner}"]
    begin = np.searchsorted(run.t, flight.time)
    hit = begin + np.argmax(force[begin:] > 0)
    assert force[hit] > 0
    guide = scene.guides[flight.guide]
    along = {1: -0.5, 2: 0.5, 3: 0.5, 4: -0.5}[flight.opposite_corner] * guide.length
    across = {1: -0.5, 2: -0.5, 3: 0.5, 4: 0.5}[flight.opposite_corner] * guide.width
    angle = run["slider.angle"][hit]
    lever = math.cos(angle) * along - math.sin(angle) * across
    speed = run["slider.vy"][hit] + lever * run["slider.omega"][hit]
    return run.t[hit] - flight.time, abs(speed)


def flights_at(scene, gap, t_end, time):
    """Return the predicted flights that begin within 0.01 s of a time."""
    ideal = load_engine("reference").simulate(scene, t_end=t_end)
    flights = corner_flights(scene, ideal, gap)
    return [flight for flight in flights if abs(flight.time - time) < 0.01]


@pytest.mark.parametrize(
    ("name", "time", "tolerance"),
    [
        # the largest of the deviations at 1e-4 m, which vanish with the gap: docs/theory/clearance.md
        ("slider-bar-case-1-mus-equals-mu", 1.3625, 0.015),
        ("slider-bar-case-2-mus-equals-mu", 1.2887, 0.015),
        ("slider-bar-case-3-mus-equals-mu", 1.4226, 0.015),
    ],
)
def test_first_impacts_of_moreaus_method(name, time, tolerance):
    """Times and speeds fall with the exponents 1/3 and 2/3 of the gap, and are as predicted without a simulation."""
    scene = load_scene(name)
    gaps = (1e-4, 1e-5)
    measured = []
    for gap in gaps:
        (flight,) = flights_at(scene, gap, 2.0, time)
        impact = first_impact(scene, flight, 1e-5)
        assert impact == pytest.approx((flight.flight_time, flight.impact_speed), rel=tolerance)
        measured.append(impact)
    exponents = np.log10(np.array(measured[0]) / measured[1])
    assert exponents == pytest.approx((1 / 3, 2 / 3), abs=0.01)


def test_moreaus_method_with_a_box_in_closed_form():
    scene = tilted_box(0.2, 20.0)
    _, _, _, time = expected_flight(0.2, 1.0, 1e-4)
    (flight,) = flights_at(scene, 1e-4, 2.5, expected_flight(0.2, 1.0, 1e-4)[0])
    measured, speed = first_impact(scene, flight, 2e-5)
    assert measured == pytest.approx(time, rel=5e-3)
    assert speed == pytest.approx(flight.impact_speed, rel=5e-3)


def test_a_corner_that_friction_cannot_hold_is_reported():
    """A slider-bar at rest, at 99.6 % of its bound: the corner about which it turns needs more, and slips.

    The law then does not fit. With a larger coefficient of friction it does.
    """
    changes = {"F0": 1.59, "L": 3.032, "w0": 1.7063, "m1": 2.6408, "m2": 2.9877, "k": 3.6589}
    changes |= {"Omega": 1.9096, "guide.length": 0.7332, "guide.width": 0.3964}
    ratios = {}
    mobilizations = {}
    for mu in (0.136, 0.25):
        scene = load_scene("slider-bar-case-1", changes | {"guide.mu": mu, "guide.mus": mu})
        ideal = load_engine("reference").simulate(scene, t_end=1.0)
        assert not ideal.events
        flight = corner_flights(scene, ideal, 1e-5)[0]
        time, speed = first_impact(scene, flight, 1e-5)
        mobilizations[mu] = flight.mobilization
        ratios[mu] = np.array([flight.flight_time / time, flight.impact_speed / speed])
    assert mobilizations[0.136] > 1.0
    assert abs(ratios[0.136] - 1.0).min() > 0.05
    assert 0.3 < mobilizations[0.25] < 0.9
    assert ratios[0.25] == pytest.approx((1.0, 1.0), abs=0.02)


def test_friction_of_pins_by_their_force_is_refused():
    scene = load_scene("slider-bar-case-1-mus-equals-mu")
    ideal = load_engine("reference").simulate(scene, t_end=0.5)
    loaded = vary(scene, {"pin.mu": 0.1, "pin.radius": 0.02})
    with pytest.raises(InputError, match="joints.pin.mu"):
        corner_flights(loaded, ideal, 1e-4)


RULE_CROWDING = 0.1
RULE_ERROR = 0.05
"""Deviation up to which the rule holds: twice that of the law at this crowding, of the order of its third power."""


def drawn_slider_bar(dice):
    """Return a slider-bar with lengths, masses, spring, load, speed, size and friction drawn at random."""
    changes = {
        "F0": dice.uniform(0, 6),
        "L": dice.uniform(0.5, 4),
        "w0": dice.uniform(0.3, 2),
        "m1": dice.uniform(0.5, 4),
        "m2": dice.uniform(0.3, 3),
        "k": dice.uniform(0.3, 4),
        "Omega": dice.uniform(0.5, 4),
        "guide.length": dice.uniform(0.2, 1),
        "guide.width": dice.uniform(0.1, 0.8),
    }
    mu = dice.uniform(0, 0.15)
    changes |= {"guide.mu": mu, "guide.mus": mu}
    return load_scene("slider-bar-case-1", {key: float(value) for key, value in changes.items()})


def test_an_end_that_turns_back_has_no_impact():
    """A slider-bar of `drawn_slider_bar` whose force jumps, and falls again before the end has crossed the gap."""
    dice = np.random.default_rng(50)
    for _ in range(32):
        scene = drawn_slider_bar(dice)
    ideal = load_engine("reference").simulate(scene, t_end=8.0)
    flights = corner_flights(scene, ideal, 1e-5)
    returning = [flight for flight in flights if math.isnan(flight.flight_time)]
    assert returning and all(flight.release == Release.JUMP for flight in returning)
    for flight in returning:
        assert math.isnan(flight.impact_speed) and math.isfinite(flight.mobilization)


@pytest.mark.long
def test_the_rule_for_designers_in_50_random_slider_bars():
    """Where crowding < 0.1 and mobilization < 1, the first impact is as predicted without a simulation."""
    dice = np.random.default_rng(50)
    deviations = {True: [], False: []}
    while sum(map(len, deviations.values())) < 50:
        scene = drawn_slider_bar(dice)
        ideal = load_engine("reference").simulate(scene, t_end=8.0)
        flights = [
            flight
            for flight in corner_flights(scene, ideal, 1e-5)
            if flight.crowding < RULE_CROWDING and flight.time + 3 * flight.flight_time < 8.0
        ]
        if ideal.termination != "end" or not flights:
            continue
        flight = flights[0]
        time, speed = first_impact(scene, flight, 1e-5)
        deviation = max(abs(flight.flight_time / time - 1), abs(flight.impact_speed / speed - 1))
        deviations[flight.mobilization < 1].append(deviation)
    applies = np.array(deviations[True])
    print(
        f"rule applies to {len(applies)} of 50; holds within {RULE_ERROR:.0%} in "
        f"{np.sum(applies < RULE_ERROR)}, largest deviation {applies.max():.3f}; "
        f"others: {np.round(deviations[False], 3)}"
    )
    assert len(applies) > 40
    assert np.all(applies < RULE_ERROR)
