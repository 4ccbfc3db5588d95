"""A rival for the reference: the slider-bar's equation of one freedom under its own event-locating DOP853, compiled.

It shows how fast an integrator can be that knows the reduced equation
(`stiction.comparisons.truth.reduced.slider_bar`) and nothing else. Same method, same tolerance, same language as the
reference. Events are found by repeating the step with its length chosen by regula falsi on the event function, so that
there is no dense output to pay for. Coefficients: Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I,
Sect. II.5, as scipy has them.

It is the calibration kernel, too: compiled arithmetic of known size as in the reference, adaptive, with events, and
nothing of the reference in it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from scipy.integrate._ivp import dop853_coefficients as dop853

from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.scenes import InputError, Scene, load_scene

A, B, C = dop853.A[:12, :12].copy(), dop853.B.copy(), dop853.C[:12].copy()
E3, E5 = dop853.E3.copy(), dop853.E5.copy()
NOISE = 1e-13
"""Event functions, of the order of 1 to 10 (N, m/s), above minus this are not negative: rounding after their event."""

CALIBRATION = 24.0, 1e-9
"""Seconds and tolerance of the integration of case 1 that is the calibration kernel."""


@cache
def calibration_kernel() -> Callable[[], Any]:
    """Return the kernel, compiled or loaded from the cache on disk."""
    p = parameters(load_scene("slider-bar-case-1"))
    integrate(p, *CALIBRATION)  # compiles
    return lambda: integrate(p, *CALIBRATION)


def parameters(scene: Scene) -> np.ndarray:
    """Parameters of the reduced equation, in the order in which `_acceleration` reads them.

    Raises
    ------
    InputError
        If the scene is not a slider-bar whose guide has a length, or its motion does not start from rest.
    """
    bar = SliderBar.from_scene(scene)
    if bar.contact.length is None or bar.v != 0.0:
        raise InputError(f"{scene.name}: expected a guide with a length and a slider at rest")
    return np.array([bar.mass, bar.c, bar.angle, bar.rate, bar.g, bar.stiffness, bar.damping, bar.L0, bar.force_offset,
                     bar.F0, bar.frequency, bar.phase, bar.contact.length, bar.contact.width, bar.contact.mu,
                     bar.contact.mus, bar.x])


@njit(cache=True, error_model="numpy")
def _loads(p, t, x, v):
    """Everything in m x'' but friction, R, tau at x'' = 0, and -d tau/dx''."""
    th = p[2] + p[3] * t
    sin, cos = np.sin(th), np.cos(th)
    applied = p[8] + p[9] * np.sin(p[10] * t + p[11]) - p[5] * (x - p[7]) - p[6] * v + p[1] * p[3] ** 2 * cos
    return applied, p[0] * p[4] - p[1] * p[3] ** 2 * sin, p[1] * p[4] * cos, p[1] * sin


@njit(cache=True, error_model="numpy")
def _acceleration(p, t, x, v, s, s1, s2, event):
    """x'' in slip of direction s with corner signs s1, s2; the event functions into `event`."""
    applied, R, tau, inertia = _loads(p, t, x, v)
    phi = -p[14] * s
    mean, half = 0.5 * (s1 + s2), 0.5 * (s2 - s1)
    lever = 2.0 / p[12]
    D = lever * (tau - 0.5 * p[13] * phi * R)
    a = (applied + phi * (mean * R + half * D)) / (p[0] + phi * half * lever * inertia)
    D -= lever * inertia * a
    event[0], event[1], event[2] = s * v, s1 * 0.5 * (R - D), s2 * 0.5 * (R + D)
    return a


@njit(cache=True, error_model="numpy")
def _holds(p, t, x, s):
    """Positive while static friction keeps the slider from leaving in direction s."""
    applied, R, tau, _ = _loads(p, t, x, 0.0)
    D = 2.0 / p[12] * (tau + 0.5 * p[13] * p[15] * s * R)
    return p[15] * max(abs(R), abs(D)) - s * applied


@njit(cache=True, error_model="numpy")
def _corners(p, t, x, v, s, event):
    """Return the corner signs that agree best with the forces they lead to."""
    best, b1, b2 = -np.inf, 1.0, 1.0
    for s1 in (1.0, -1.0):
        for s2 in (1.0, -1.0):
            _acceleration(p, t, x, v, s, s1, s2, event)
            worst = min(event[1], event[2])
            if worst > best:
                best, b1, b2 = worst, s1, s2
    return b1, b2


@njit(cache=True, error_model="numpy")
def _step(p, t, h, x, v, s, s1, s2, kx, kv, event):  # noqa: PLR0913 - as for a kernel
    """Return the new state, and true if an event function was negative at a stage; kx[0], kv[0] hold y'(t)."""
    passed = False
    for i in range(1, 13):
        dx, dv = 0.0, 0.0
        for j in range(i):
            w = A[i, j] if i < 12 else B[j]
            dx += w * kx[j]
            dv += w * kv[j]
        kx[i] = v + h * dv
        kv[i] = _acceleration(p, t + (C[i] if i < 12 else 1.0) * h, x + h * dx, kx[i], s, s1, s2, event)
        passed = passed or min(event[0], event[1], event[2]) < -NOISE
    return x + h * dx, v + h * dv, passed


@njit(cache=True, error_model="numpy")
def _error(h, kx, kv, rtol):
    """Hairer's norm of the error relative to rtol (1 m, 1 m/s)."""
    e3, e5 = 0.0, 0.0
    for k in (kx, kv):
        a, b = 0.0, 0.0
        for i in range(13):
            a += E3[i] * k[i]
            b += E5[i] * k[i]
        e3 += (a / rtol) ** 2
        e5 += (b / rtol) ** 2
    return h * e5 / np.sqrt(2.0 * (e5 + 0.01 * e3)) if e5 + e3 > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _break_away(p, t, x, t_end):
    """Time and direction of the end of stick: first sign change on a grid of 10 ms, then bisection."""
    while t < t_end:
        later = min(t + 0.01, t_end)
        for s in (1.0, -1.0):
            if _holds(p, later, x, s) < 0.0:
                low, high = t, later
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if _holds(p, middle, x, s) < 0.0:
                        high = middle
                    else:
                        low = middle
                return high, s
        t = later
    return t_end, 0.0


@njit(cache=True, error_model="numpy")
def _length_to_event(p, t, h, x, v, s, s1, s2, kx, kv, event,  # noqa: PLR0913 - as a kernel
                     which, at_low, at_high):
    """Length of the step that ends where event function `which` is zero (Illinois), and the number of steps tried."""
    low, high, side, trial = 0.0, h, 0, h
    for i in range(60):
        trial = low + (high - low) * (at_low / (at_low - at_high) if i % 4 != 3 and at_low > 0.0 else 0.5)
        _step(p, t, trial, x, v, s, s1, s2, kx, kv, event)
        value = event[which]
        if value < 0.0:
            high, at_high = trial, value
            at_low *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            low, at_low = trial, value
            at_high *= 0.5 if side > 0 else 1.0
            side = 1
        if abs(value) < 1e-15 or high - low < 1e-15 * h:
            break
    return trial, i + 1


@njit(cache=True, error_model="numpy")
def integrate(p, t_end, rtol):
    """x and v at t_end, events, and evaluations of the equation, from rest at t = 0."""
    kx, kv, event = np.zeros(13), np.zeros(13), np.zeros(3)
    t, x, v, s, s1, s2 = 0.0, p[16], 0.0, 0.0, 1.0, 1.0
    h, events, calls, at_rest = 1e-3 * t_end, -1, 0, True  # the start is no event
    while t < t_end:
        if at_rest:
            s = 1.0 if _holds(p, t, x, 1.0) < 0.0 else -1.0 if _holds(p, t, x, -1.0) < 0.0 else 0.0
            if s == 0.0:
                t, s = _break_away(p, t, x, t_end)
                events += 1
                if s == 0.0:
                    break
            s1, s2 = _corners(p, t, x, 0.0, s, event)
            events += 1
            at_rest = False
        kx[0], kv[0] = v, _acceleration(p, t, x, v, s, s1, s2, event)
        h = min(h, t_end - t)
        x_new, v_new, passed = _step(p, t, h, x, v, s, s1, s2, kx, kv, event)
        calls += 13
        error = _error(h, kx, kv, rtol)
        factor = min(6.0, max(0.2, 0.9 * error ** -0.125)) if error > 0.0 else 6.0
        if error > 1.0:
            h *= factor
            continue
        which = int(np.argmin(event))
        if passed and event[which] >= -NOISE:
            h *= 0.5  # an event function fell below zero and returned
            continue
        if not passed:
            t, x, v, h = t + h, x_new, v_new, h * factor
            continue
        t_event = h
        for candidate in range(3):
            _step(p, t, h, x, v, s, s1, s2, kx, kv, event)
            at_high = event[candidate]
            if at_high >= -NOISE:
                continue
            _acceleration(p, t, x, v, s, s1, s2, event)
            at_low = max(event[candidate], 0.0)
            trial, used = _length_to_event(p, t, h, x, v, s, s1, s2, kx, kv, event, candidate, at_low, at_high)
            calls += 12 * (used + 1)
            if trial < t_event:
                t_event, which = trial, candidate
        x, v, _ = _step(p, t, t_event, x, v, s, s1, s2, kx, kv, event)
        calls += 12
        t, h = t + t_event, h * factor
        if which == 0:
            v, at_rest = 0.0, True
        else:
            events += 1
            if which == 1:
                s1 = -s1
            else:
                s2 = -s2
    return x, v, events, calls
