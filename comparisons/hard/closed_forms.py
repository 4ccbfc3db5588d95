"""Closed forms of hard cases: formulas of the catalogue, and functions for what takes more than a formula."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from stiction.scenes import InputError, Scene
from stiction.truths.closed_form.pendulum import pendulum_angle
from stiction.truths.reduced.slider_bar import SliderBar


def value(
    formula: str,
    scene: Scene,
    t: np.ndarray | float = 0.0,
    definitions: Mapping[str, str] | None = None,
) -> np.ndarray:
    """Evaluate a formula of ``cases.toml`` at times t (s); `definitions` are formulas by their names in later ones.

    It is Python's arithmetic with ``^`` for powers, as in scene files, of `t`, `scene`, its parameters and `FUNCTIONS`.
    """
    names: dict[str, Any] = {**FUNCTIONS, **scene.parameters, "scene": scene, "t": t}
    for name, definition in {
        **(definitions or {}),
        "": formula,
    }.items():  # they come with the suite
        names[name] = eval(definition.replace("^", "**"), {"__builtins__": {}}, names)
    return names[""]


def lifted_position(scene: Scene, t: np.ndarray) -> np.ndarray:
    """x of `weightless-instants`: v' = (P - mu |m g - A sin W t|)/m, integrated between zeros of the normal force."""
    p = scene.parameters
    m, g, A, W, P, mu = (p[key] for key in ("m", "g", "A", "W", "P", "mu"))

    def first(s: Any) -> Any:  # integral of the normal force, and the one of that
        return m * g * s + A / W * np.cos(W * s)

    def second(s: Any) -> Any:
        return m * g * s**2 / 2 + A / W**2 * np.sin(W * s)

    root = np.arcsin(m * g / A)
    zeros = np.sort(
        np.concatenate(
            [
                (np.array([root, np.pi - root]) + 2 * np.pi * k) / W
                for k in range(int(scene.t_end * W / (2 * np.pi)) + 1)
            ]
        )
    )
    x, v, start, sign = 0.0, p["v0"], 0.0, 1.0
    out = np.empty_like(t)
    for end in [*zeros, np.inf]:
        inside = (t >= start) & (t <= end)

        def state(
            s: Any, start: float = start, sign: float = sign, x: float = x, v: float = v
        ) -> tuple[Any, Any]:
            h = s - start
            return (
                x
                + v * h
                + P / m * h**2 / 2
                - mu * sign / m * (second(s) - second(start) - first(start) * h),
                v + P / m * h - mu * sign / m * (first(s) - first(start)),
            )

        out[inside] = state(t[inside])[0]
        if np.isfinite(end):
            x, v = state(end)
        start, sign = end, -sign
    return out


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
    m2, mu, s, c = (
        m * p["r"] / (1 - p["r"]),
        p["critical"] * (1 + p["excess"]),
        np.sin(th),
        np.cos(th),
    )
    found = []
    for sign in (1, -1):
        k = mu * sign
        A = [
            [m + m2, -m * l * s, -k],
            [0, m * l * c, -1],
            [m2 * l * s, m * l**2 / 3, l * c - l * s * k],
        ]
        N = np.linalg.solve(A, [m * l * w**2 * c, m * l * w**2 * s - (m + m2) * g, l * c * m2 * g])[
            2
        ]
        found += [float(N)] if N * sign > 0 else []
    return tuple(found)


def first_break_away(scene: Scene) -> float:
    """First time (s) at which a slider-bar that starts at rest exceeds full mobilization of static friction."""
    bar = SliderBar.from_scene(scene)
    t = np.linspace(0.0, scene.t_end, 10_001)
    after = next((i for i, instant in enumerate(t) if bar.break_away_margin(instant, bar.x) > 0), 0)
    if not after:
        start = bar.break_away_margin(0.0, bar.x)
        raise InputError(
            f"{scene.name}: starts at {start:.3g} N above full mobilization, or never exceeds it; "
            "expected a break-away after the start"
        )
    return float(brentq(bar.break_away_margin, t[after - 1], t[after], args=(bar.x,), xtol=1e-15))


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
"""Functions in the formulas of ``cases.toml``."""
