"""Measures of hard cases: relative errors against closed forms, invariances and independent solutions.

A measure takes a case, its scenes and their runs, and returns errors by name. These keys of ``cases.toml`` select
measures:

===============  ===========================================================================================
``rests``        bodies that must stay at rest
``follows``      a formula by column, see `closed_forms.value`; ``let``: definitions that it uses
``truth``        the truth ``of`` a mechanism, which is compared in ``columns`` (by default ``slider.x``), in
                 ``events`` (by default true) and in ``time_at_rest`` (by default false)
``same_motion``  true if the run in other units must agree with the first run
``checks``       names of measures of single cases, `NAMED`
===============  ===========================================================================================
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from stiction import truths
from stiction.comparisons.hard.case import HardCase
from stiction.comparisons.hard.closed_forms import rod_normal_force, value
from stiction.comparisons.measures.distances import match_events
from stiction.scenes import Event, Scene, Trajectory
from stiction.scenes.fidelity import Fidelity
from stiction.truths import Truth
from stiction.truths.enumerated_motion import Instant, Motion, simulate
from stiction.truths.reduced.slider_bar import SliderBar
from stiction.truths.reduced.steady_state import steady_state

Scenes = Sequence[Scene]
Runs = Sequence[Trajectory]
Measure = Callable[[HardCase, Scenes, Runs], dict[str, float]]
"""Returns errors by name, from a case, its scenes and their runs."""
FIRST_STEPS = 10
"""Steps in which contacts build up their forces, which are not measured. The error of as many steps of a first-order
method is right, too."""
EVENT_WINDOW = 0.01
"""Largest distance of an event from the true one, as a fraction of the run."""
LEAST_LOAD = 1e-6
"""Smallest load by which excesses of friction are divided, N: a guide may carry none."""
TRANSIENT_PERIODS = 20
"""Periods after which a slider-bar moves periodically."""
BEFORE_BREAK_AWAY = 0.95
"""Fraction of the time until the break-away in which friction is measured: methods with steps may break away early."""
STEADY_SAMPLES = 1001
"""Samples of a steady motion, of which the range is taken. Between samples, a turning point exceeds them by about 1e-5
of the range, which does not matter for a scale."""
POSITIONS = ("x", "y", "angle")
VELOCITIES = ("vx", "vy", "omega")


def measures(case: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return all errors that a case asks for, by name."""
    selected: list[Measure] = []
    if case.rests:
        selected.append(at_rest)
    if case.follows:
        selected.append(follows)
    if case.truth:
        selected.append(follows_truth)
    if case.same_motion:
        selected.append(same_motion)
    selected += [NAMED[name] for name in case.checks]
    errors: dict[str, float] = {}
    for measure in selected:
        errors |= measure(case, scenes, runs)
    return errors


def relative_error(
    values: np.ndarray | float, expected: np.ndarray | float, scale: float | None = None
) -> float:
    """Return the largest difference of values from the expected ones, divided by a scale.

    Parameters
    ----------
    values, expected
        Numbers of the same unit; arrays have the same shape, or one of the two is a single number.
    scale
        Number in the same unit, whose sign does not matter; the largest absolute expected value if None.

    Returns
    -------
    float
        Zero if all values are equal to the expected ones, whatever the scale. Infinite if there is no value, since
        nothing has been compared then, if a number is not finite, and if values differ although the scale is zero:
        such a difference cannot be expressed as a fraction.
    """
    if np.size(values) == 0:
        return np.inf
    largest = float(np.max(np.abs(np.asarray(values) - expected)))
    if largest == 0.0:
        return 0.0
    if scale is None:
        scale = largest_size(expected)
    if scale == 0.0 or not np.isfinite([largest, scale]).all():
        return np.inf
    return largest / abs(scale)


def largest_size(values: np.ndarray | float) -> float:
    """Return the largest absolute value; 0 if there are no values."""
    return float(np.max(np.abs(values), initial=0.0))


def range_scale(column: np.ndarray) -> float:
    """Return the scale of a column, shape (n,): its range, or the largest absolute value of a constant column."""
    if len(column) == 0:
        return 0.0
    value_range = float(np.ptp(column))
    return value_range if value_range > 0.0 else largest_size(column)


def at_rest(case: HardCase, _: Scenes, runs: Runs) -> dict[str, float]:
    """Return how far (m, rad) bodies of the first run move that must stay at rest."""
    run = runs[0]
    errors = {}
    for body in case.rests:
        columns = [run[f"{body}.{label}"] for label in POSITIONS]
        errors[f"creep of {body}"] = max(
            relative_error(column, column[0], 1.0) for column in columns
        )
    return errors


def follows(case: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the errors of columns of the first run against formulas, at their `loaded_instants`."""
    scene, run = scenes[0], runs[0]
    errors = {}
    for name, formula in case.follows.items():
        expected = value(formula, scene, run.t, case.let)
        is_loaded = loaded_instants(scene, run, name)
        errors[name] = relative_error(
            run[name][is_loaded], expected[is_loaded], largest_size(expected)
        )
    return errors


def loaded_instants(scene: Scene, run: Trajectory, column: str) -> np.ndarray:
    """Return at which instants a column is measured, bool, shape (n,).

    With contacts, a box between two surfaces begins without overlap, and therefore without load. Normal force and
    friction are measured only after the `FIRST_STEPS` in which the contacts build up their forces. All other columns
    are measured at all instants.
    """
    forces = [
        f"{guide}.{label}" for guide in scene.guides for label in ("normal_force", "friction")
    ]
    begin = 0.0
    if run.fidelity == Fidelity.CONTACT and column in forces:
        # A method without a step has none to wait for.
        begin = FIRST_STEPS * run.settings.get("dt", 0.0)
    return run.t >= begin


def follows_truth(case: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the errors of columns of the first run against a truth, relative to their range, and of its events.

    Events are compared only if the method locates them.
    """
    scene, run = scenes[0], runs[0]
    solve = getattr(truths, f"{case.truth['of']}_truth")
    t_end = float(run.t[-1])
    truth: Truth = _cached_solution(solve, pickle.dumps(scene), t_end)
    true = truth(np.minimum(run.t, truth.t_end))
    errors = {}
    for name in case.truth.get("columns", ["slider.x"]):
        is_loaded = loaded_instants(scene, run, name)
        errors[name] = relative_error(
            run[name][is_loaded], true[name][is_loaded], range_scale(true[name])
        )
    if not run.events:
        return errors
    if case.truth.get("events", True):
        # Not all methods locate changes of corners.
        kinds = {"slip", "stick", "reversal", *(event.kind for event in run.events)}
        expected = [event for event in truth.events if event.kind in kinds]
        errors |= _event_errors(expected, run.events, truth.t_end)
    if case.truth.get("time_at_rest", False):
        # Both motions are compared over the time for which both exist.
        common_end = min(t_end, truth.t_end)
        rest_of_run = time_at_rest(run.events, common_end)
        rest_of_truth = time_at_rest(truth.events, common_end)
        errors["time at rest"] = abs(rest_of_run - rest_of_truth) / t_end
    return errors


def _event_errors(
    expected: Sequence[Event | Instant], events: Sequence[Event], t_end: float
) -> dict[str, float]:
    """Return the number of events that are missed or have no counterpart in the expected ones."""
    matched = match_events(expected, events, EVENT_WINDOW * t_end)
    return {"events missed or invented": float(len(matched.missed) + len(matched.spurious))}


@lru_cache(maxsize=4)
def _cached_solution(solve: Callable[[Scene, float], Any], scene: bytes, t_end: float) -> Any:
    """Return ``solve(scene, t_end)`` for a pickled scene.

    The last solutions are cached, because all variants of a case follow each other and a solution often takes longer
    than a run. Scenes are passed as their pickles, because the arguments of a cached function must be hashable.
    """
    return solve(pickle.loads(scene), t_end)


def time_at_rest(events: Iterable[Event], t_end: float) -> float:
    """Return how long joints are at rest from t = 0 to `t_end`, s, summed over all joints.

    A joint whose first event is a slip rests from t = 0, and a rest that no slip ends lasts to `t_end`. A joint without
    events does not contribute, because events alone do not tell whether it slips or rests.

    Parameters
    ----------
    events
        Events of all joints, in ascending order of time.
    t_end
        End of the motion, s; later events do not count.
    """
    total = 0.0
    joints: set[str] = set()
    rest_begins: dict[str, float] = {}
    for event in events:
        if event.time > t_end:
            break
        if event.joint not in joints and event.kind == "slip":
            rest_begins[event.joint] = 0.0
        joints.add(event.joint)
        if event.kind == "stick":
            rest_begins.setdefault(event.joint, event.time)
        elif event.kind == "slip" and event.joint in rest_begins:
            total += event.time - rest_begins.pop(event.joint)
    return total + sum(t_end - begin for begin in rest_begins.values())


def same_motion(case: HardCase, _: Scenes, runs: Runs) -> dict[str, float]:
    """Return the differences of the second run, whose scene has other units, from the first run.

    Both runs have their output at the same instants, except for the unit of time. If the numbers of instants differ, a
    part of one motion has no counterpart, and the difference of the motions is infinite.
    """
    first, second = runs
    units = case.units
    motion_error = np.inf
    if len(first.t) == len(second.t):
        converted = second["slider.x"] / units.length
        scale = range_scale(first["slider.x"])
        motion_error = relative_error(converted, first["slider.x"], scale)
    errors = {"motion in other units": motion_error}
    if not first.events and not second.events:
        return errors
    event_error = np.inf
    if [event.kind for event in first.events] == [event.kind for event in second.events]:
        times = np.array([event.time for event in first.events])
        converted_times = np.array([event.time for event in second.events]) / units.time
        event_error = relative_error(converted_times, times, first.t[-1])
    errors["events in other units"] = event_error
    return errors


def friction_excess(scene: Scene, columns: Mapping[str, np.ndarray]) -> float:
    """Return how far forces are from Coulomb's law, relative to the largest load of any guide.

    A guide that slips must have the friction -mu N sgn(g_T'), one that sticks a friction of at most mus N. All forces
    are relative to the same load, because they are solutions of one linear system.

    Returns
    -------
    float
        Infinite if a corner is pressed against both surfaces or pulled, or if a force is not finite.
    """
    largest_excess, largest_load = 0.0, LEAST_LOAD
    for name, guide in scene.frictional_guides.items():
        friction, mode = columns[f"{name}.friction"], columns[f"{name}.mode"]
        if guide.length is None:
            load = np.abs(columns[f"{name}.normal_force"])
        else:
            corners = np.array([columns[f"{name}.F{corner}"] for corner in (1, 2, 3, 4)])
            lower_rear, lower_front, upper_front, upper_rear = corners
            is_pressed_once = np.all(lower_rear * upper_rear == 0) and np.all(
                lower_front * upper_front == 0
            )
            if not np.all(corners >= 0) or not is_pressed_once:
                return np.inf
            load = corners.sum(axis=0)
        slip_excess = np.abs(friction + guide.mu * mode * load)
        stick_excess = np.abs(friction) - guide.static_coefficient * load
        excess = np.where(mode != 0, slip_excess, stick_excess)
        if not np.isfinite(excess).all():
            return np.inf
        largest_excess = max(largest_excess, float(np.max(excess)))
        largest_load = max(largest_load, float(np.max(load)))
    return largest_excess / largest_load


def second_half(run: Trajectory, column: str) -> np.ndarray:
    """Return a column in the second half of a run; in the first half, contacts may still build up the force."""
    return run[column][run.t >= run.t[-1] / 2]


def without_nan(force: np.ndarray) -> np.ndarray:
    """Return the values of a force that are not NaN.

    A force is NaN where guides at rest share a load in a way that the motion does not determine.
    """
    return force[~np.isnan(force)]


def accepted_start(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the residual with which a run from an inconsistent start begins, and how far it has changed the start."""
    scene, run = scenes[0], runs[0]
    changes = []
    for name, body in scene.bodies.items():
        declared = [*body.position, body.angle, *body.velocity, body.angular_velocity]
        for label, number in zip([*POSITIONS, *VELOCITIES], declared, strict=True):
            changes.append(abs(run[f"{name}.{label}"][0] - number))
    residual = max(run["drift.position"][0], run["drift.velocity"][0])
    return {
        "start accepted off its constraints": float(residual),
        "start moved silently": float(max(changes)),
    }


def comes_to_rest(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the errors of the rest of a mechanism of one degree of freedom: its place, slip and forces.

    The motion is compared with an independent one (`enumerated_motion`). How guides at rest share the load is not
    determined. The virtual power of their frictions is, and must balance that of the other forces.

    Raises
    ------
    Undecided
        If the independent motion does not come to rest.
    """
    scene, run = scenes[0], runs[0]
    motion: Motion = _cached_solution(simulate, pickle.dumps(scene), float(run.t[-1]))
    if motion.rest is None:
        raise truths.Undecided(
            f"{scene.name}: found {motion.breakdown or 'a motion'} up to {motion.t[-1]:g} s; "
            "expected a mechanism of one freedom that comes to rest"
        )
    equations, guides, q = motion.contact.equations, motion.contact.names, motion.q[-1]

    # The direction d of the free motion satisfies J d = 0 and d^T M d = 1. Reactions have no power in it.
    terms = equations.at(motion.rest, q, np.zeros_like(q))
    root_mass = np.sqrt(equations.mass)
    right_vectors = np.linalg.svd(terms.J / root_mass)[2]
    direction = right_vectors[-1] / root_mass
    frictions = np.array([run[f"{name}.friction"][-1] for name in guides])
    power = without_nan(np.array([direction @ terms.W.T @ frictions]))
    power_of_loads = direction @ terms.Q
    # If the loads balance each other, their sizes are the scale.
    power_scale = power_of_loads if power_of_loads != 0.0 else np.abs(direction) @ np.abs(terms.Q)

    place = [run[f"{body}.{label}"][-1] for body in scene.bodies for label in POSITIONS]
    # A mechanism that comes to rest at the origin has no coordinate that is a scale there.
    place_scale = largest_size(q) if q.any() else largest_size(motion.q)
    slip_errors = [
        relative_error(run[f"{name}.slip_velocity"][-1], 0.0, scale)
        for name, scale in zip(guides, _largest_slip_velocities(motion), strict=True)
    ]
    power_error = 0.0
    if power.size:
        power_error = relative_error(power, -power_of_loads, power_scale)
    errors = {
        "place of rest": relative_error(np.array(place), q, place_scale),
        "virtual power of friction": power_error,
        "slip at rest": max(slip_errors),
    }
    if run.events:
        located = [event for event in run.events if event.kind != "corner"]
        expected = [event for event in motion.events if event.kind != "corner"]
        errors |= _event_errors(expected, located, run.t[-1])
    return errors


def _largest_slip_velocities(motion: Motion) -> np.ndarray:
    """Return the largest slip velocity of each guide of a motion, m/s, shape (guides,)."""
    terms = motion.contact.equations.at(motion.t, motion.q, motion.v)
    return np.max(np.abs(terms.slip_speed), axis=0)


def rod_force_at_start(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the error of the normal force of `sliding-rod` at t = 0; if no force is consistent, the force itself."""
    force = float(runs[0]["guide.normal_force"][0])
    consistent = rod_normal_force(scenes[0])
    error = abs(force)
    if consistent:
        error = min(relative_error(force, expected) for expected in consistent)
    return {"normal force at t = 0": error}


def periodic(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the errors of a slider-bar against its steady motion.

    These are the state at the end of the last complete period, the change over this period, the drift, and changes of
    the number of events per period.
    """
    run = runs[0]
    bar = SliderBar.from_scene(scenes[0])
    period = bar.period()
    steady = steady_state(bar)
    x, v = steady.state
    # The scale is the range of the true motion: that of the run would hide the error of one that swings too far.
    sample_times = np.linspace(0.0, steady.periods * period, STEADY_SAMPLES)
    segments = steady.motion.owner(sample_times, "after")
    [positions], _velocities = steady.motion.state(sample_times, segments)
    scale = range_scale(positions)
    # The end of the last period, up to rounding.
    end = int(np.floor(run.t[-1] / period * (1 + 1e-12))) * period
    last = int(np.argmin(np.abs(run.t - end)))
    before = int(np.argmin(np.abs(run.t - (end - period))))
    errors = {
        "position after the last period": relative_error(run["slider.x"][last], x, scale),
        "velocity after the last period": relative_error(
            run["slider.vx"][last], v, scale * 2 * np.pi / period
        ),
        "change over the last period": relative_error(
            run["slider.x"][last], run["slider.x"][before], scale
        ),
        "drift": float(run["drift.position"][-1]) / bar.L,
    }
    if run.events:
        times = np.array([event.time for event in run.events])
        period_ends = np.arange(TRANSIENT_PERIODS * period, end + period / 2, period)
        counts = np.histogram(times, period_ends)[0]
        errors["events of a period"] = float(np.ptp(counts)) if len(counts) else 0.0
    return errors


def sums_of_three_guides(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the errors of the sums of the forces of `three-guides-at-rest`, the largest of all orders and units."""
    incline = scenes[0].parameters["incline"]
    errors: dict[str, float] = {}
    for scene, run in zip(scenes, runs):
        weight = -(scene.gravity or (0.0, 0.0))[1] * scene.bodies["slider"].mass
        expected = {"friction": -weight * np.sin(incline), "normal_force": weight * np.cos(incline)}
        for label, total in expected.items():
            forces = [second_half(run, f"guide-{number}.{label}") for number in (1, 2, 3)]
            sums = without_nan(forces[0] + forces[1] + forces[2])
            # If the sum is NaN throughout, the run makes no statement that could be wrong.
            if len(sums):
                name = f"sum of {label}"
                errors[name] = max(relative_error(sums, total), errors.get(name, 0.0))
    return errors


def normal_force_of_two_guides(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the error of the sum of the normal forces of `two-guides-sliding`, and of their distribution.

    Only the reference defines how parallel guides share a load: with the least norm, that is, equally.
    """
    p, run = scenes[0].parameters, runs[0]
    total = p["m"] * p["g"] * np.cos(p["incline"])
    first, second = (second_half(run, f"guide-{number}.normal_force") for number in (1, 2))
    errors = {"sum of normal_force": relative_error(first + second, total)}
    if run.engine == "reference":
        errors["minimum-norm normal forces"] = max(
            relative_error(first, total / 2), relative_error(second, total / 2)
        )
    return errors


def virtual_power_of_friction(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the error of the virtual power of the frictions of `trammel-at-rest` against that of torque and weight.

    The directions of the guides are +x and +y. In the free motion, slider x moves by -L sin phi and slider y by
    L cos phi. The result is empty if no friction is determined.
    """
    p, run = scenes[0].parameters, runs[0]
    sine, cosine = np.sin(p["phi"]), np.cos(p["phi"])
    weight = (p["m"] / 2 + p["m1"]) * p["g"] * p["L"] * cosine
    friction_x = second_half(run, "guide-x.friction")
    friction_y = second_half(run, "guide-y.friction")
    power = without_nan(p["L"] * (cosine * friction_y - sine * friction_x))
    if not len(power):
        return {}
    return {"virtual power of friction": relative_error(power, p["T"] + weight, weight)}


def friction_balances_the_pull(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return the error of the friction of `wedged-slider` against the load, which increases until it breaks away."""
    scene, run = scenes[0], runs[0]
    p = scene.parameters
    break_away = p["mus"] * 2 * p["T"] / p["a"] / p["rate"]
    is_held = (run.t < BEFORE_BREAK_AWAY * break_away) & loaded_instants(
        scene, run, "guide.friction"
    )
    error = relative_error(run["guide.friction"][is_held], -p["rate"] * run.t[is_held])
    return {"friction before it breaks away": error}


def drift_accepted(_: HardCase, __: Scenes, runs: Runs) -> dict[str, float]:
    """Return the residual of the constraints at the end of a run that should have been refused."""
    return {"drift accepted": float(runs[0]["drift.position"][-1])}


NAMED: dict[str, Measure] = {
    check.__name__: check
    for check in (
        accepted_start,
        comes_to_rest,
        drift_accepted,
        friction_balances_the_pull,
        normal_force_of_two_guides,
        periodic,
        rod_force_at_start,
        sums_of_three_guides,
        virtual_power_of_friction,
    )
}
"""Measures of single cases by name."""
