"""Closed forms of hard cases: evaluation of formulas, and functions for solutions that are no single formula."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from stiction.scenes import InputError, Scene
from stiction.truths.closed_form.pendulum import pendulum_angle
from stiction.truths.reduced.slider_bar import SliderBar

ZERO_SEARCH_SAMPLES = 10_001
"""Instants at which a break-away margin is evaluated, to find the interval of its first zero."""
TIME_ACCURACY = 1e-15
"""Absolute accuracy of the time of a zero, s."""


def value(
    formula: str,
    scene: Scene,
    t: np.ndarray | float = 0.0,
    definitions: Mapping[str, str] | None = None,
) -> np.ndarray:
    """Return the value of a formula of ``cases.toml``.

    Parameters
    ----------
    formula
        An expression in Python's arithmetic, with ``^`` for powers as in scene files, in `t`, `scene`, the parameters
        of the scene, `FUNCTIONS` and the definitions.
    scene
        The scene.
    t
        Times, s.
    definitions
        Formulas by names that later definitions and the formula may use.
    """
    names: dict[str, Any] = {**FUNCTIONS, **scene.parameters, "scene": scene, "t": t}
    for name, definition in (definitions or {}).items():
        names[name] = _evaluated(definition, names)
    return _evaluated(formula, names)


def _evaluated(formula: str, names: dict[str, Any]) -> Any:
    """Evaluate a formula. Formulas are part of the suite; a user cannot supply them."""
    return eval(formula.replace("^", "**"), {"__builtins__": {}}, names)


def lifted_position(scene: Scene, t: np.ndarray) -> np.ndarray:
    """Return the position x (m) of the slider of `weightless-instants` at times t (s), shape (n,).

    The slider moves to the right with v' = (P - mu |R|)/m and the normal force R(t) = m g - A sin W t. Between zeros of
    R the sign of R is constant, and v' is integrated twice in closed form.
    """
    p = scene.parameters
    m, g, A, W, P, mu = (p[key] for key in ("m", "g", "A", "W", "P", "mu"))

    # The first and second integral of R.
    def first_integral(time: Any) -> Any:
        return m * g * time + A / W * np.cos(W * time)

    def second_integral(time: Any) -> Any:
        return m * g * time**2 / 2 + A / W**2 * np.sin(W * time)

    def advance(x: float, v: float, sign: float, start: float, time: Any) -> tuple[Any, Any]:
        """Return position and velocity at a time in the interval that begins at `start` with x and v."""
        h = time - start
        impulse = first_integral(time) - first_integral(start)
        impulse_integral = (
            second_integral(time) - second_integral(start) - first_integral(start) * h
        )
        position = x + v * h + P / m * h**2 / 2 - mu * sign / m * impulse_integral
        velocity = v + P / m * h - mu * sign / m * impulse
        return position, velocity

    # R is zero where sin W t = m g/A, twice in each period.
    root = np.arcsin(m * g / A)
    periods = np.arange(int(scene.t_end * W / (2 * np.pi)) + 1)
    zeros = np.sort(np.add.outer([root, np.pi - root], 2 * np.pi * periods).ravel() / W)
    x, v, start, sign = 0.0, p["v0"], 0.0, 1.0
    positions = np.empty_like(t)
    for end in zeros:
        inside = (t >= start) & (t <= end)
        positions[inside], _ = advance(x, v, sign, start, t[inside])
        x, v = advance(x, v, sign, start, end)
        start, sign = end, -sign
    behind = t >= start
    positions[behind], _ = advance(x, v, sign, start, t[behind])
    return positions


def parallel_cranks(scene: Scene, t: np.ndarray) -> np.ndarray:
    """Return the angle (rad) of the cranks of `parallelogram-flat` and `forty-cranks` at times t (s), shape (n,).

    The cranks, of mass m each, turn together, and the coupler, of mass M, translates with their ends. The mechanism is
    therefore equivalent to a single pendulum.
    """
    p = scene.parameters
    cranks = len(scene.bodies) - 1
    moment_arm = cranks / 2 * p["m"] + p["M"]
    inertia = cranks / 3 * p["m"] + p["M"]
    w = np.sqrt(p["g"] * moment_arm / inertia)
    angle, *_ = pendulum_angle(t, w, p["phi"] + np.pi / 2, p["w"])
    return angle - np.pi / 2


def rod_normal_force(scene: Scene) -> tuple[float, ...]:
    """Return the normal forces (N) of `sliding-rod` at its start that are consistent with their own friction.

    The unknowns x'', th'' and N satisfy three balances, with friction f = mu |N| while the slider slips to the left::

        (m + m2) x'' - m l sin th th'' = m l w^2 cos th + f
        m (l cos th th'' - l w^2 sin th) = N - (m + m2) g
        I th'' = -l cos th (N - m2 g) + l sin th (f - m2 x'')

    They are solved for each sign of N, and a solution with the other sign is discarded.
    """
    p = scene.parameters
    m, l, th, w, g = (p[key] for key in ("m", "l", "th", "w", "g"))
    m2 = m * p["r"] / (1 - p["r"])
    mu = p["critical"] * (1 + p["excess"])
    s, c = np.sin(th), np.cos(th)
    forces = []
    for sign in (1, -1):
        k = mu * sign
        matrix = [
            [m + m2, -m * l * s, -k],
            [0, m * l * c, -1],
            [m2 * l * s, m * l**2 / 3, l * c - l * s * k],
        ]
        right_side = [m * l * w**2 * c, m * l * w**2 * s - (m + m2) * g, l * c * m2 * g]
        _, _, N = np.linalg.solve(matrix, right_side)
        if N * sign > 0:
            forces.append(float(N))
    return tuple(forces)


def first_break_away(scene: Scene) -> float:
    """Return the first time (s) at which a slider-bar at rest exceeds full mobilization of static friction.

    Raises
    ------
    InputError
        If it exceeds it at the start, or never.
    """
    bar = SliderBar.from_scene(scene)

    def margin(time: float) -> float:
        return bar.break_away_margin(time, bar.x)

    t = np.linspace(0.0, scene.t_end, ZERO_SEARCH_SAMPLES)
    first = next((i for i, time in enumerate(t) if margin(time) > 0), 0)
    if first == 0:
        raise InputError(
            f"{scene.name}: starts at {margin(0.0):.3g} N above full mobilization, or never exceeds it; "
            "expected a break-away after the start"
        )
    return float(brentq(margin, t[first - 1], t[first], xtol=TIME_ACCURACY))


FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "arcsin": np.arcsin,
    "minimum": np.minimum,
    "maximum": np.maximum,
    "lifted_position": lifted_position,
    "parallel_cranks": parallel_cranks,
    "first_break_away": first_break_away,
}
"""Functions that the formulas of ``cases.toml`` may use."""
