"""How a hard case is measured: closed forms, invariances and independent solutions, as errors relative to a size."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from stiction.comparisons.hard.case import Check
from stiction.comparisons.measures.distances import match_events
from stiction.comparisons.random_scenes.one_freedom import Motion, simulate
from stiction.comparisons.truth import Truth
from stiction.comparisons.truth.closed_form.pendulum import pendulum_angle
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.comparisons.truth.reduced.steady_state import steady_state
from stiction.scenes import Event, InputError, Scene, Trajectory

Formula = Callable[[Scene, np.ndarray], np.ndarray]

FIRST_STEPS = 10
"""Steps in which contacts build up their forces; as many steps' error of a method of first order is right."""


def gap(found: np.ndarray | float, expected: np.ndarray | float, size: float | None = None) -> float:
    """Largest difference, relative to `size` (the largest expected value where None); infinite if a value is not finite."""
    size = float(np.max(np.abs(expected))) if size is None else size
    worst = float(np.max(np.abs(np.asarray(found) - expected))) if np.size(found) else np.inf
    return worst / size if np.isfinite(worst) else np.inf


def follows(**formulas: Formula) -> Check:
    """Columns of the first run follow closed forms, forces of contacts once they are `carried`; ``slider__x`` stands for the column ``slider.x``."""
    def check(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
        [run, *_], found = runs, {}
        for key, formula in formulas.items():
            name, expected = key.replace("__", "."), formula(scenes[0], run.t)
            seen = carried(run, name)
            found[name] = gap(run[name][seen], expected[seen], float(np.max(np.abs(expected))))
        return found
    return check


def carried(run: Trajectory, column: str) -> np.ndarray:
    """Instants at which a column counts: of normal force and friction at contact fidelity those from the tenth step on.

    A box between two surfaces begins without overlap, so without load; contacts take some steps to carry it. A method without a step has none to wait for.
    """
    waits = run.fidelity == "contact" and column.endswith((".normal_force", ".friction"))
    return run.t >= (FIRST_STEPS * run.settings.get("dt", 0.0) if waits else 0.0)


def follows_truth(truth: Callable[[Scene, float], Truth], *columns: str, events: bool = True) -> Check:
    """Columns of the first run, by their range, forces of contacts once they are `carried`; of a method that locates events also the events of an
    independent truth."""
    def check(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
        [run, *_] = runs
        true = _known(truth, scenes[0], float(run.t[-1]))
        expected = true(np.minimum(run.t, true.t_end))
        found = {}
        for name in columns:
            seen = carried(run, name)
            found[name] = gap(run[name][seen], expected[name][seen], float(np.ptp(expected[name])) or None)
        if run.events and events:
            window = 0.01 * true.t_end
            kinds = {event.kind for event in run.events} | {"slip", "stick", "reversal"}  # not all locate corners
            matched = match_events([event for event in true.events if event.kind in kinds], run.events, window)
            found["events missed or invented"] = float(len(matched.missed) + len(matched.spurious))
        return found
    return check


def rests_as(truth: Callable[[Scene, float], Truth]) -> Check:
    """The time at rest of a run that locates events is that of an independent truth, by the length of the run."""
    def check(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
        [run, *_], t_end = runs, float(runs[0].t[-1])
        return {"time at rest": abs(_rest(run.events) - _rest(_known(truth, scenes[0], t_end).events)) / t_end} if run.events else {}
    return check


def _known(truth: Callable[[Scene, float], Truth], scene: Scene, t_end: float) -> Truth:
    """A scene's truth. All variants of a case follow each other, and it often takes longer than their runs."""
    return _found(truth, pickle.dumps(scene), t_end)


@lru_cache(maxsize=4)
def _found(truth: Callable[[Scene, float], Truth], scene: bytes, t_end: float) -> Truth:
    return truth(pickle.loads(scene), t_end)


def _rest(events: Sequence[Event]) -> float:
    """Seconds between each stick and the next slip."""
    total, since = 0.0, None
    for event in events:
        if event.kind == "slip" and since is not None:
            total, since = total + event.time - since, None
        elif event.kind == "stick":
            since = event.time
    return total


def accepted_start(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
    """Of a run from an inconsistent start: the residual it began with, and by how much it moved the start without a word."""
    [scene, *_], [run, *_] = scenes, runs
    moved = [abs(run[f"{name}.{column}"][0] - value) for name, body in scene.bodies.items()
             for column, value in zip(("x", "y", "angle", "vx", "vy", "omega"),
                                      (*body.position, body.angle, *body.velocity, body.angular_velocity))]
    return {"start accepted off its constraints": float(max(run["drift.position"][0], run["drift.velocity"][0])),
            "start moved without a word": float(max(moved))}


def settled(run: Trajectory, column: str) -> np.ndarray:
    """A force in the second half of a run: before that, methods with clearance or compliance may build it up."""
    return run[column][run.t >= run.t[-1] / 2]


def comes_to_rest(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
    """A mechanism of one freedom rests where the independent motion does, without slip, and its frictions balance its loads there.

    How guides share the load is not determined, the virtual power of their frictions is.
    """
    [scene, *_], [run, *_] = scenes, runs
    motion: Motion = _known(simulate, scene, float(run.t[-1]))
    m, slips = motion.equations, [run[f"{name}.slip_velocity"] for name in motion.equations.guides]
    terms = m.terms(motion.q, 0.0, np.ones(len(m.guides)))
    power = shared(np.array([terms.p @ [run[f"{name}.friction"][-1] for name in m.guides]]))  # none where a recovered share is open
    place = [run[f"{name}.{key}"][-1] for name in scene.bodies for key in ("x", "y", "angle")]
    found = {"place of rest": gap(np.array(place), motion.q), "virtual power of friction": gap(power, -terms.p0) if power.size else 0.0,
             "slip at rest": max(gap(slip[-1], 0.0, float(np.max(np.abs(slip)))) for slip in slips)}
    if run.events:
        matched = match_events(motion.events, [event for event in run.events if event.kind != "corner"], 0.01 * run.t[-1])
        found["events missed or invented"] = float(len(matched.missed) + len(matched.spurious))
    return found


def shared(force: np.ndarray) -> np.ndarray:
    """A sum of forces that guides at rest share, at the instants at which an engine says how; recovered from its motion they are nan."""
    return force[~np.isnan(force)]


def at_rest(*bodies: str, size: float = 1.0) -> Check:
    """Positions of the first run stay where they were, by `size` (m, rad)."""
    def check(_: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
        return {f"creep of {body}": max(gap(runs[0][f"{body}.{key}"], runs[0][f"{body}.{key}"][0], size)
                                        for key in ("x", "y", "angle")) for body in bodies}
    return check


def both(*checks: Check) -> Check:
    """All measures of several checks."""
    return lambda scenes, runs: {name: value for check in checks for name, value in check(scenes, runs).items()}


def friction_excess(scene: Scene, columns: Mapping[str, np.ndarray]) -> float:
    """How far accepted forces are from Coulomb's law, by the largest load of any guide, as all of them come from one linear system:
    slip off -mu N sgn(g_T'), stick past mus N.

    Infinite where a corner is pressed to both surfaces, or pulled, or a force is not finite.
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
        excess = np.where(mode != 0, np.abs(f + guide.mu * mode * load), np.abs(f) - guide.static_coefficient * load)
        worst = max(worst, float(np.max(excess))) if np.isfinite(excess).all() else np.inf
    return worst / size


def sliding(scene: Scene, t: np.ndarray, coefficient: float, angle: float) -> np.ndarray:
    """Distance down an incline from rest, m."""
    return -scene.gravity[1] * (np.sin(angle) - coefficient * np.cos(angle)) * t ** 2 / 2


def lifted_position(scene: Scene, t: np.ndarray) -> np.ndarray:
    """x of `weightless-instants`: v' = (P - mu |m g - A sin W t|)/m, integrated between the zeros of the normal force."""
    p = scene.parameters
    m, g, A, W, P, mu = (p[key] for key in ("m", "g", "A", "W", "P", "mu"))
    first = lambda s: m * g * s + A / W * np.cos(W * s)
    second = lambda s: m * g * s ** 2 / 2 + A / W ** 2 * np.sin(W * s)
    root = np.arcsin(m * g / A)
    zeros = np.sort(np.concatenate([(np.array([root, np.pi - root]) + 2 * np.pi * k) / W
                                    for k in range(int(scene.t_end * W / (2 * np.pi)) + 1)]))
    x, v, start, sign = 0.0, p["v0"], 0.0, 1.0
    out = np.empty_like(t)
    for end in [*zeros, np.inf]:
        inside = (t >= start) & (t <= end)

        def state(s, start=start, sign=sign, x=x, v=v):
            h = s - start
            return (x + v * h + P / m * h ** 2 / 2 - mu * sign / m * (second(s) - second(start) - first(start) * h),
                    v + P / m * h - mu * sign / m * (first(s) - first(start)))
        out[inside] = state(t[inside])[0]
        if not np.isfinite(end):
            break
        x, v = state(end)
        start, sign = end, -sign
    return out


def pulled_free(scene: Scene, t: np.ndarray) -> np.ndarray:
    """x of `wedged-slider`."""
    p = scene.parameters
    load = 2 * p["T"] / p["a"]
    start = p["mus"] * load / p["rate"]
    h = np.maximum(t - start, 0.0)
    return ((p["mus"] - p["mu"]) * load * h ** 2 / 2 + p["rate"] * h ** 3 / 6) / p["m"]


def peak_position(scene: Scene, t: np.ndarray) -> np.ndarray:
    """x of `peak-of-the-load` with excess > 0; it slips to the end of the run."""
    p = scene.parameters
    F, W, m = (1 + p["excess"]) * p["mus"] * p["m"] * p["g"], p["W"], p["m"]
    start = np.arcsin(1 / (1 + p["excess"])) / W
    s = np.maximum(t, start)
    h = s - start
    return (F / W * (np.cos(W * start) * h - (np.sin(W * s) - np.sin(W * start)) / W) - p["mu"] * m * p["g"] * h ** 2 / 2) / m


def released_position(scene: Scene, t: np.ndarray) -> np.ndarray:
    """x of `start-on-break-away`."""
    p = scene.parameters
    return (p["mus"] - p["mu"]) * p["g"] * t ** 2 / 2 + p["c"] * t ** 3 / (6 * p["m"])


def kinked_position(scene: Scene, t: np.ndarray) -> np.ndarray:
    """x of `kink-at-break-away`."""
    p = scene.parameters
    h = np.maximum(t - 1.0, 0.0)
    return (p["mus"] - p["mu"]) * p["g"] * h ** 2 / 2 + p["slope"] / p["m"] * h ** 3 / 6


def parallel_cranks(scene: Scene, t: np.ndarray) -> np.ndarray:
    """Angle of the cranks of `parallelogram-flat` and `forty-cranks`."""
    p, n = scene.parameters, len(scene.bodies) - 1
    w = np.sqrt(p["g"] * (n / 2 * p["m"] + p["M"]) / (n / 3 * p["m"] + p["M"]))
    return pendulum_angle(t, w, p["phi"] + np.pi / 2, p["w"])[0] - np.pi / 2


def rod_normal_force(scene: Scene) -> tuple[float, ...]:
    """Normal forces of `sliding-rod` at its start that are consistent with their own friction, from the three balances.

    Unknown x'', th'', N with f = mu |N| (slip to the left):  (m + m2) x'' - m l sin th th'' = m l w^2 cos th + f ;
    m (l cos th th'' - l w^2 sin th) = N - (m + m2) g ;  I th'' = -l cos th (N - m2 g) + l sin th (f - m2 x'').
    """
    p = scene.parameters
    m, l, th, w, g = (p[key] for key in ("m", "l", "th", "w", "g"))
    m2, mu, s, c = m * p["r"] / (1 - p["r"]), p["critical"] * (1 + p["excess"]), np.sin(th), np.cos(th)
    found = []
    for sign in (1, -1):
        k = mu * sign
        A = [[m + m2, -m * l * s, -k], [0, m * l * c, -1], [m2 * l * s, m * l ** 2 / 3, l * c - l * s * k]]
        N = np.linalg.solve(A, [m * l * w ** 2 * c, m * l * w ** 2 * s - (m + m2) * g, l * c * m2 * g])[2]
        found += [float(N)] if N * sign > 0 else []
    return tuple(found)


def rod_force_at_start(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
    """The normal force at t = 0 is the one that the balances of `sliding-rod` have."""
    expected = rod_normal_force(scenes[0])
    found = float(runs[0]["guide.normal_force"][0])
    return {"normal force at t = 0": min(gap(found, one) for one in expected) if expected else abs(found)}


def slider_bar_critical_time(scene: Scene) -> float:
    """Time at which sin th = m a/(mu m1 L) is first reached, s."""
    bar = SliderBar.from_scene(scene)
    return (np.arcsin(bar.mass * bar.contact.length / (bar.contact.mu * bar.m1 * bar.L)) - bar.angle) / bar.rate


def first_break_away(scene: Scene) -> float:
    """Time at which a slider-bar that starts at rest exceeds full mobilization of static friction for the first time, s."""
    bar = SliderBar.from_scene(scene)
    t = np.linspace(0.0, scene.t_end, 10_001)
    after = next((i for i, instant in enumerate(t) if bar.break_away_margin(instant, bar.x) > 0), 0)
    if not after:
        raise InputError(f"{scene.name}: starts at {bar.break_away_margin(0.0, bar.x):.3g} N above full mobilization, or never exceeds it; expected a break-away after the start")
    return float(brentq(bar.break_away_margin, t[after - 1], t[after], args=(bar.x,), xtol=1e-15))


def can_jam_time(scene: Scene) -> float:
    """Time at which P sin t reaches what both surfaces hold at full mobilization without a moment, mus m g max(1, mus b/a), s."""
    p, guide = scene.parameters, scene.joints["guide"]
    held = p["mus"] * p["m"] * -scene.gravity[1] * max(1.0, p["mus"] * guide.width / guide.length)
    return float(np.arcsin(held / p["P"]))


def periodic(scenes: Sequence[Scene], runs: Sequence[Trajectory]) -> dict[str, float]:
    """Of the slider-bar's steady motion: state at the end, its change over the last period, drift, events per period."""
    [scene, *_], [run, *_] = scenes, runs
    bar = SliderBar.from_scene(scene)
    period, steady = bar.period(), steady_state(bar)
    x, v = steady.state
    size = float(np.ptp(run["slider.x"]))
    whole = int(np.floor(run.t[-1] / period * (1 + 1e-12))) * period

    def at(t: float) -> int:
        return int(np.argmin(np.abs(run.t - t)))
    found = {"position after the last period": gap(run["slider.x"][at(whole)], x, size),
             "velocity after the last period": gap(run["slider.vx"][at(whole)], v, size * 2 * np.pi / period),
             "change over the last period": gap(run["slider.x"][at(whole)], run["slider.x"][at(whole - period)], size),
             "drift": float(run["drift.position"][-1]) / bar.L}
    if run.events:
        times = np.array([event.time for event in run.events])
        counts = np.histogram(times, np.arange(20 * period, whole + period / 2, period))[0]
        found["events of a period"] = float(np.ptp(counts)) if len(counts) else 0.0
    return found
