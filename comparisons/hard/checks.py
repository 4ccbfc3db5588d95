"""Measures of hard cases: closed forms, invariances and independent solutions, as errors relative to a size.

A check takes a case, its scenes and their runs, and returns errors by the name of the measure. Keys of ``cases.toml``:

===============  ===========================================================================================
``rests``        bodies that stay where they are
``follows``      formula by column, see `closed_forms.value`; ``let``: definitions in it
``truth``        the truth ``of`` a mechanism: ``columns`` (``slider.x``), ``events`` (true), ``time_at_rest`` (false)
``same_motion``  the run in other units is the first one
``checks``       names of the checks of single cases below
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
FIRST_STEPS = 10
"""Steps in which contacts build up their forces; as many steps' error of a method of first order is right."""
STATE = ("x", "y", "angle", "vx", "vy", "omega")


def measures(case: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Return all errors that a case asks for."""
    keyed = {
        "rests": at_rest,
        "follows": follows,
        "truth": follows_truth,
        "same_motion": same_motion,
    }
    checks = [check for key, check in keyed.items() if getattr(case, key)] + [
        NAMED[name] for name in case.checks
    ]
    return {name: error for check in checks for name, error in check(case, scenes, runs).items()}


def gap(
    found: np.ndarray | float, expected: np.ndarray | float, size: float | None = None
) -> float:
    """Largest difference, relative to `size` (the largest expected value where None); infinite if one is not finite."""
    size = float(np.max(np.abs(expected))) if size is None else size
    worst = float(np.max(np.abs(np.asarray(found) - expected))) if np.size(found) else np.inf
    return worst / size if np.isfinite(worst) else np.inf


def at_rest(case: HardCase, _: Scenes, runs: Runs) -> dict[str, float]:
    """Measure by how much (m, rad) bodies of the first run leave their places."""
    return {
        f"creep of {body}": max(
            gap(column, column[0], 1.0)
            for column in (runs[0][f"{body}.{key}"] for key in STATE[:3])
        )
        for body in case.rests
    }


def follows(case: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare columns of the first run with formulas, forces of contacts once they are `carried`."""
    [run, *_], found = runs, {}
    for name, formula in case.follows.items():
        expected, seen = value(formula, scenes[0], run.t, case.let), carried(run, name)
        found[name] = gap(run[name][seen], expected[seen], float(np.max(np.abs(expected))))
    return found


def carried(run: Trajectory, column: str) -> np.ndarray:
    """Instants at which a column counts: of normal force and friction at contact fidelity those from the tenth step on.

    A box between two surfaces begins without overlap, so without load; contacts take some steps to carry it. A method
    without a step has none to wait for.
    """
    waits = run.fidelity == Fidelity.CONTACT and column.endswith((".normal_force", ".friction"))
    return run.t >= (FIRST_STEPS * run.settings.get("dt", 0.0) if waits else 0.0)


def follows_truth(case: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare columns of the first run with a truth, by their range; of a method that locates events, those as well."""
    [run, *_], wanted = (
        runs,
        {"columns": ["slider.x"], "events": True, "time_at_rest": False, **case.truth},
    )
    t_end = float(run.t[-1])
    true: Truth = _known(getattr(truths, f"{wanted['of']}_truth"), pickle.dumps(scenes[0]), t_end)
    expected = true(np.minimum(run.t, true.t_end))
    found = {}
    for name in wanted["columns"]:
        seen = carried(run, name)
        found[name] = gap(
            run[name][seen], expected[name][seen], float(np.ptp(expected[name])) or None
        )
    if run.events and wanted["events"]:
        kinds = {event.kind for event in run.events} | {
            "slip",
            "stick",
            "reversal",
        }  # not all locate corners
        found |= _other_events(
            [event for event in true.events if event.kind in kinds], run.events, true.t_end
        )
    if run.events and wanted["time_at_rest"]:
        found["time at rest"] = abs(time_at_rest(run.events) - time_at_rest(true.events)) / t_end
    return found


def _other_events(
    expected: Sequence[Event | Instant], found: Sequence[Event], t_end: float
) -> dict[str, float]:
    matched = match_events(expected, found, 0.01 * t_end)
    return {"events missed or invented": float(len(matched.missed) + len(matched.spurious))}


@lru_cache(maxsize=4)
def _known(solve: Callable[[Scene, float], Any], scene: bytes, t_end: float) -> Any:
    """Solve a pickled scene once: all variants of a case follow each other, and it often takes longer than a run."""
    return solve(pickle.loads(scene), t_end)


def time_at_rest(events: Iterable[Event]) -> float:
    """Seconds between each stick and the next slip."""
    total, since = 0.0, None
    for event in events:
        if event.kind == "slip" and since is not None:
            total, since = total + event.time - since, None
        elif event.kind == "stick":
            since = event.time
    return total


def same_motion(case: HardCase, _: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the second run, of the scene in other units, with the first: the same numbers in those units."""
    (one, other), units = runs, case.units
    n = min(len(one.t), len(other.t))
    size = float(np.ptp(one["slider.x"]))
    found = {
        "motion in other units": gap(
            other["slider.x"][:n] / units.length, one["slider.x"][:n], size
        )
    }
    if one.events or other.events:
        same = [event.kind for event in one.events] == [event.kind for event in other.events]
        times, expected = (np.array([event.time for event in run.events]) for run in (other, one))
        found["events in other units"] = (
            gap(times / units.time, expected, one.t[-1]) if same else np.inf
        )
    return found


def friction_excess(scene: Scene, columns: Mapping[str, np.ndarray]) -> float:
    """Distance of accepted forces from Coulomb's law: slip off -mu N sgn(g_T'), stick past mus N.

    It is relative to the largest load of any guide, as all forces come from one linear system. Infinite where a corner
    is pressed to both surfaces, or pulled, or a force is not finite.
    """
    worst, size = 0.0, 1e-6
    for name, guide in scene.frictional_guides.items():
        f, mode = columns[f"{name}.friction"], columns[f"{name}.mode"]
        if guide.length is None:
            load = np.abs(columns[f"{name}.normal_force"])
        else:
            F = np.array([columns[f"{name}.F{i}"] for i in (1, 2, 3, 4)])
            if not (np.all(F >= 0) and np.all(F[0] * F[3] == 0) and np.all(F[1] * F[2] == 0)):
                return np.inf
            load = F.sum(axis=0)
        size = max(size, float(np.max(load)))
        excess = np.where(
            mode != 0,
            np.abs(f + guide.mu * mode * load),
            np.abs(f) - guide.static_coefficient * load,
        )
        worst = max(worst, float(np.max(excess))) if np.isfinite(excess).all() else np.inf
    return worst / size


def settled(run: Trajectory, column: str) -> np.ndarray:
    """Force in the second half of a run: before that, methods with clearance or compliance may build it up."""
    return run[column][run.t >= run.t[-1] / 2]


def shared(force: np.ndarray) -> np.ndarray:
    """Sum of forces that guides at rest share, at the instants at which an engine states it: elsewhere it is nan."""
    return force[~np.isnan(force)]


def accepted_start(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Measure a run from an inconsistent start: the residual it began with, and how far it moved the start silently."""
    scene, run = scenes[0], runs[0]
    moved = [
        abs(run[f"{name}.{column}"][0] - declared)
        for name, body in scene.bodies.items()
        for column, declared in zip(
            STATE, (*body.position, body.angle, *body.velocity, body.angular_velocity)
        )
    ]
    return {
        "start accepted off its constraints": float(
            max(run["drift.position"][0], run["drift.velocity"][0])
        ),
        "start moved silently": float(max(moved)),
    }


def comes_to_rest(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the rest of a mechanism of one freedom with its independent motion: place, no slip, balance of forces.

    How guides share the load is not determined, the virtual power of their frictions is.
    """
    scene, run = scenes[0], runs[0]
    motion: Motion = _known(simulate, pickle.dumps(scene), float(run.t[-1]))
    if motion.rest is None:
        raise truths.Undecided(
            f"{scene.name}: found {motion.breakdown or 'a motion'} up to {motion.t[-1]:g} s; "
            "expected a mechanism of one freedom that comes to rest"
        )
    equations, names, q = motion.contact.equations, motion.contact.names, motion.q[-1]
    slips = [run[f"{name}.slip_velocity"] for name in names]
    terms = equations.at(motion.rest, q, np.zeros_like(q))
    # the direction that the constraints leave, J N = 0 with N^T M N = 1, in which reactions have no power
    root = np.sqrt(equations.mass)
    way = np.linalg.svd(terms.J / root)[2][-1] / root
    power = shared(np.array([way @ terms.W.T @ [run[f"{name}.friction"][-1] for name in names]]))
    place = [run[f"{name}.{key}"][-1] for name in scene.bodies for key in STATE[:3]]
    found = {
        "place of rest": gap(np.array(place), q),
        "virtual power of friction": gap(power, -way @ terms.Q) if power.size else 0.0,
        "slip at rest": max(gap(slip[-1], 0.0, float(np.max(np.abs(slip)))) for slip in slips),
    }
    if run.events:
        located = [event for event in run.events if event.kind != "corner"]
        expected = [event for event in motion.events if event.kind != "corner"]
        found |= _other_events(expected, located, run.t[-1])
    return found


def rod_force_at_start(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the normal force at t = 0 with the one that the balances of `sliding-rod` have."""
    expected = rod_normal_force(scenes[0])
    found = float(runs[0]["guide.normal_force"][0])
    return {
        "normal force at t = 0": min(gap(found, one) for one in expected)
        if expected
        else abs(found)
    }


def periodic(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare with the slider-bar's steady motion: state at the end, change over the last period, drift, events."""
    run, bar = runs[0], SliderBar.from_scene(scenes[0])
    period, (x, v) = bar.period(), steady_state(bar).state
    size = float(np.ptp(run["slider.x"]))
    whole = int(np.floor(run.t[-1] / period * (1 + 1e-12))) * period
    last, before = (int(np.argmin(np.abs(run.t - t))) for t in (whole, whole - period))
    found = {
        "position after the last period": gap(run["slider.x"][last], x, size),
        "velocity after the last period": gap(run["slider.vx"][last], v, size * 2 * np.pi / period),
        "change over the last period": gap(run["slider.x"][last], run["slider.x"][before], size),
        "drift": float(run["drift.position"][-1]) / bar.L,
    }
    if run.events:
        times = np.array([event.time for event in run.events])
        counts = np.histogram(times, np.arange(20 * period, whole + period / 2, period))[0]
        found["events of a period"] = float(np.ptp(counts)) if len(counts) else 0.0
    return found


def sums_of_three_guides(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the sums of the forces of `three-guides-at-rest` with the weight, in any order and units."""
    incline, found = np.deg2rad(15), dict[str, float]()
    for scene, run in zip(scenes, runs):
        weight = -(scene.gravity or (0.0, 0.0))[1] * scene.bodies["slider"].mass
        for name, total in (
            ("friction", -weight * np.sin(incline)),
            ("normal_force", weight * np.cos(incline)),
        ):
            first, second, third = (settled(run, f"guide-{i}.{name}") for i in (1, 2, 3))
            sums = shared(first + second + third)
            if len(sums):
                found[f"sum of {name}"] = max(gap(sums, total), found.get(f"sum of {name}", 0.0))
    return found


def normal_force_of_two_guides(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the normal forces of `two-guides-sliding` with the weight across the incline, and with each other."""
    total = 9.81 * np.cos(scenes[0].parameters["incline"])
    each = [settled(runs[0], f"guide-{i}.normal_force") for i in (1, 2)]
    found = {"sum of normal_force": gap(sum(each), total)}
    if runs[0].engine == "reference":  # no other says how it shares them
        found["minimum-norm normal forces"] = max(gap(one, total / 2) for one in each)
    return found


def virtual_power_of_friction(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the virtual power of the frictions of `trammel-at-rest` with that of torque and weight.

    The guides' directions are +x and +y; slider x moves with -L sin p, slider y with L cos p.
    """
    p, run = scenes[0].parameters, runs[0]
    weight = (p["m"] / 2 + p["m1"]) * p["g"] * p["L"] * np.cos(p["phi"])
    fx, fy = (settled(run, f"guide-{axis}.friction") for axis in "xy")
    power = shared(p["L"] * (np.cos(p["phi"]) * fy - np.sin(p["phi"]) * fx))
    return {"virtual power of friction": gap(power, p["T"] + weight, weight)} if len(power) else {}


def friction_balances_the_pull(_: HardCase, scenes: Scenes, runs: Runs) -> dict[str, float]:
    """Compare the friction of `wedged-slider` with its load until that breaks it away."""
    p, run = scenes[0].parameters, runs[0]
    start = p["mus"] * 2 * p["T"] / p["a"] / p["rate"]
    held = (run.t < 0.95 * start) & carried(run, "guide.friction")
    return {
        "friction before it breaks away": gap(run["guide.friction"][held], -p["rate"] * run.t[held])
    }


def drift_accepted(_: HardCase, __: Scenes, runs: Runs) -> dict[str, float]:
    """Residual of the constraints at the end of a run that there should not be."""
    return {"drift accepted": float(runs[0]["drift.position"][-1])}


NAMED = {
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
