"""What the paper says about its example, statement by statement, with a verdict and the figure behind it.

Source of every claim: Zhuang & Wang (2014), Sect. 5. Each is decided on the independent reduced solution of its case
(`comparisons.truth`) or, where it is about the method (drift), on our run of the paper's scheme; nothing here is
taken from the reference implementation's own motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from comparisons.truth import HIGH_PRECISION, StickThreshold, slider_bar_truth
from comparisons.truth.record import motion_columns, motion_events
from comparisons.truth.slider_bar import SliderBar
from comparisons.truth.steady_state import steady_state
from scenes import Scene, vary

HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "not decided"

PERIODIC = 1e-10
"""m and m/s; change of the state from one period to the next at which the motion counts as periodic. The reduced solution
itself is good to 1e-12."""

STICK_SPEED = 1e-9
"""m/s; the reduced solution's velocity in stick is zero to rounding."""

OPPOSITE, ADJACENT = ({"1", "3"}, {"2", "4"}), ({"1", "2"}, {"3", "4"})


class SteadyState:
    """The periodic motion that a case's start leads to: samples over one period, events with two-sided values.

    `change` is what position and velocity still change by from one period to the next (m, m/s).
    """

    def __init__(self, scene: Scene, samples: int = 2001):
        mechanism = SliderBar.from_scene(scene)
        self.period = mechanism.period()
        self.t = np.linspace(0.0, self.period, samples)
        motion = steady_state(mechanism).motion
        self.columns = motion_columns(mechanism, motion, self.t, "after")
        self.events = motion_events(mechanism, motion, ("guide",))
        self.change = max(abs(self.columns[name][-1] - self.columns[name][0]) for name in ("slider.x", "slider.vx"))

    @property
    def stick_time(self) -> float:
        """Seconds per period in which the slider is stuck."""
        changes = [event for event in self.events if event.kind in ("stick", "slip")]
        if not changes:
            return self.period if self.maximum("slider.vx") <= STICK_SPEED else 0.0
        total = sum(event.time * (1 if event.kind == "slip" else -1) for event in changes)
        # a stick phase that spans the end of the period
        return float(total + (self.period if changes and changes[0].kind == "slip" else 0.0))

    def maximum(self, *names: str) -> float:
        return float(max(np.max(np.abs(self.columns[name])) for name in names))

    def configurations(self, columns: Mapping[str, np.ndarray] | None = None) -> list[str]:
        """Contact configurations in their order, repetitions in succession left out; ``"1+3"``: corners 1 and 3 touch."""
        columns = self.columns if columns is None else columns
        touching = np.stack([columns[f"guide.F{i}"] > 0 for i in range(1, 5)])
        names = ["+".join(str(i + 1) for i in range(4) if column[i]) for column in touching.T]
        return [name for i, name in enumerate(names) if i == 0 or name != names[i - 1]]


def claims_table(scenes: Mapping[int, Scene], drift: pd.DataFrame, threshold: StickThreshold) -> pd.DataFrame:
    """One row per claim: case, claim, verdict, figure behind it, tier, source.

    Parameters
    ----------
    scenes
        The paper's cases, by number.
    drift
        The table of `comparisons.drift`, for the claims about stabilization.
    threshold
        Of the first case.
    """
    steady = {case: SteadyState(scene) for case, scene in scenes.items()}
    first = scenes[min(scenes)]
    start = slider_bar_truth(first, steady[1].period)
    beginning = steady[1].configurations(start(np.linspace(0.0, steady[1].period, 4001)))
    rows: list[dict[str, Any]] = []

    def claim(case: str, text: str, verdict: bool | None, figure: str, tier: str = HIGH_PRECISION) -> None:
        rows.append({"case": case, "claim": text, "verdict": UNDECIDED if verdict is None else HOLDS if verdict else FAILS,
                     "figure behind it": figure, "truth tier": tier, "source": "Zhuang & Wang 2014, Sect. 5"})

    for case, state in steady.items():
        claim(str(case), "the motion of the slider is periodic", state.change <= PERIODIC,
              f"period {state.period:g} s; reached from the start, it changes by {state.change:.0e} m, m/s from one period to the next")
    claim("1", "a stick phase occurs: velocity and acceleration both remain zero", steady[1].stick_time > 0 and _rests(steady[1]),
          f"stuck for {steady[1].stick_time:.4f} s per period")
    for case in (2, 3):
        claim(str(case), "no stick phase", steady[case].stick_time == 0, f"stuck for {steady[case].stick_time:.4f} s per period")
    for case, state in steady.items():
        turning = [event for event in state.events if event.kind in ("slip", "stick", "reversal")]
        jumps = [abs(event.jump("slider.ax")) for event in turning]
        others = [abs(event.jump("slider.ax")) for event in state.events if event.kind == "corner"]
        claim(str(case), "the acceleration jumps at every stick-slip transition and every change of direction, and nowhere else",
              bool(jumps) and min(jumps) > 1e-6 and max(others, default=0.0) < 1e-9,
              f"{len(jumps)} per period, between {min(jumps):.3g} and {max(jumps):.3g} m/s^2; at corner changes at most "
              f"{max(others, default=0.0):.0e}")
        efforts = [abs(event.jump("motor.effort")) for event in turning]
        peak = state.maximum("motor.effort")
        claim(str(case), "the driving moment changes abruptly, by a small amount, when the acceleration jumps",
              bool(efforts) and min(efforts) > 1e-6 and max(efforts) < 0.2 * peak,
              f"jumps between {min(efforts):.3g} and {max(efforts):.3g} N m, largest moment {peak:.3g} N m (small: below a fifth)")
    said = ["2+4", "1+2", "1+3", "1+2"]
    claim("1", "contact: corners 2 and 4 first, then 1 and 2, then 1 and 3, then 1 and 2", beginning[:4] == said,
          "first period: " + " -> ".join(beginning))
    claim("2", "the contact situations are similar to those in case 1", _cycle(steady[2]) == _cycle(steady[1]),
          f"case 1: {' -> '.join(_cycle(steady[1]))}; case 2: {' -> '.join(_cycle(steady[2]))}")
    seen = {frozenset(name.split("+")) for name in steady[3].configurations()}
    wanted = [frozenset(pair) for pair in (*OPPOSITE, *ADJACENT)]
    claim("3", "all contact configurations of Fig. 3 appear (1+3, 2+4, 1+2, 3+4)", all(pair in seen for pair in wanted),
          " -> ".join(steady[3].configurations()))
    corners = [f"guide.F{i}" for i in range(1, 5)]
    for label, names, unit in (("corner forces F_i", corners, "N"), ("driving moment", ["motor.effort"], "N m")):
        sizes = {case: state.maximum(*names) for case, state in steady.items()}
        claim("3", f"the largest {label} is larger than in case 1", sizes[3] > sizes[1],
              ", ".join(f"case {case}: {size:.4g} {unit}" for case, size in sizes.items()))
    claim("1, 2", "with F0 = 3 N the slider sticks, with F0 = 5 N it does not", steady[1].stick_time > 0 == steady[2].stick_time,
          f"{steady[1].stick_time:.4f} s and {steady[2].stick_time:.4f} s per period")
    guide = first.guides["guide"]
    claim("1", "there is an amplitude F0 up to which the slider sticks and above which it does not", _decides(first, threshold.F0),
          f"F0 = {threshold.F0:.7f} N for g = {-first.gravity[1]:g}, mu = {guide.mu:g}, mus = {guide.static_coefficient:g} "
          "(the paper's own number is lost)")
    for label, text, bounded in (("paper's scheme, no stabilization", "the constraint drift grows indefinitely without stabilization", False),
                                 ("paper's scheme", "the constraint drift remains bounded with Baumgarte stabilization", True)):
        found = drift[(drift["variant"] == label) & (drift["status"] == "ok")]
        verdict = bool((found["bounded"] == bounded).all()) if len(found) else None
        figure = "; ".join(f"{row['scene'][-6:]} dt = {row['step']:g} s: {row['position drift, first third [m]']:.1e} -> "
                           f"{row['position drift, last third [m]']:.1e} m" for _, row in found.iterrows())
        claim("1-3", text, verdict, figure or "no run", "closed form")
    return pd.DataFrame(rows)


def _rests(state: SteadyState) -> bool:
    """Velocity and acceleration vanish on every sample between a stick event and the slip event after it."""
    for event in state.events:
        after = [e.time for e in state.events if e.kind == "slip" and e.time > event.time]
        if event.kind == "stick" and after:
            inside = (state.t > event.time) & (state.t < min(after))
            if np.any(np.abs(state.columns["slider.vx"][inside]) > STICK_SPEED) or \
                    np.any(np.abs(state.columns["slider.ax"][inside]) > STICK_SPEED):
                return False
    return True


def _cycle(state: SteadyState) -> list[str]:
    """The configurations of one period as a cycle, beginning with 2+4 where there is one."""
    names = state.configurations()
    if len(names) > 1 and names[0] == names[-1]:
        names = names[:-1]
    first = names.index("2+4") if "2+4" in names else 0
    return names[first:] + names[:first]


def _decides(scene: Scene, F0: float) -> bool:
    """Whether the steady state sticks 1 % below F0 and does not 1 % above, and does at a tenth of it."""
    below, above, far = (SteadyState(vary(scene, {"F0": F0 * factor})).stick_time for factor in (0.99, 1.01, 0.1))
    return below > 0 and above == 0 and far > 0
