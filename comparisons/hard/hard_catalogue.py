"""The catalogue of hard cases, by topic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from stiction.comparisons.depth import Depth
from stiction.comparisons.hard import checks
from stiction.comparisons.hard.case import LIMITS, MOTION_OR_WORD, NONE, NO_MOTION, REFUSAL, SEVERAL, HardCase, Limits
from stiction.comparisons.hard.checks import at_rest, both, follows, follows_truth, rests_as
from stiction.comparisons.hard.hostile_scenes import hostile_cases
from stiction.comparisons.hard.other_units import Units, scaled
from stiction.comparisons.truth import four_bar_truth, oscillator_truth, slider_bar_truth
from stiction.scenes import Scene, Trajectory, scene_from_dict

slider_bar = follows_truth(slider_bar_truth, "slider.x")
oscillator = follows_truth(oscillator_truth, "slider.x")
grazing = both(follows_truth(slider_bar_truth, "slider.x", events=False), rests_as(slider_bar_truth))


def existence() -> list[HardCase]:
    """Existence and uniqueness lost (Painleve)."""
    rod = HardCase("rod below the critical mu", "existence and uniqueness", "hard/sliding-rod",
                   "one motion: the normal force of the balances, a thousandth below the critical mu (4/3 for a small slider)", 1e-6,
                   checks.rod_force_at_start, depth=Depth.QUICK)
    return [
        HardCase("slider-bar through the critical angle", "existence and uniqueness", "hard/painleve-sweep",
                 "stop where sin th = m a/(mu m1 L), to 1e-8 rad: several solutions from there on", 1e-3, expected=NO_MOTION,
                 stop=lambda scene: (checks.slider_bar_critical_time(scene), SEVERAL), depth=Depth.QUICK),
        HardCase("slider-bar started beyond it", "existence and uniqueness", "hard/painleve-none",
                 "stop at t = 0: no solution", 1e-3, expected=NO_MOTION, stop=lambda _: (0.0, NONE), depth=Depth.QUICK),
        rod,
        replace(rod, name="rod 1e-8 below", must="one motion, 1e-8 below the critical mu", overrides={"excess": -1e-8, "t_end": 1e-9},
                dt=1e-11, limits=_NEARLY_SINGULAR, depth=Depth.DEFAULT),
        replace(rod, name="rod 1e-8 above", must="stop at t = 0: no solution, 1e-8 above the critical mu", expected=NO_MOTION,
                stop=lambda _: (0.0, NONE), check=None, overrides={"excess": 1e-8}),
        replace(rod, name="rod above, turning fast", must="stop at t = 0: several solutions", expected=NO_MOTION,
                stop=lambda _: (0.0, SEVERAL), check=None, overrides={"excess": 1e-3, "w": 20}),
    ]


def vanishing_normal_force() -> list[HardCase]:
    """The normal force passes zero, or is zero."""
    return [
        HardCase("case 3", "vanishing normal force", "hard/normal-force-through-zero",
                 "the motion of the reduced equation; R and all corner forces pass zero", 1e-3,
                 follows_truth(slider_bar_truth, "slider.x", "guide.normal_force"), depth=Depth.QUICK),
        HardCase("no weight", "vanishing normal force", "hard/no-weight", "x = v t: no load, no friction", 1e-3,
                 follows(slider__x=lambda scene, t: t)),
        HardCase("weightless instants", "vanishing normal force", "hard/weightless-instants",
                 "the closed form between the zeros of R; friction goes and returns", 1e-3,
                 follows(slider__x=checks.lifted_position,
                         guide__normal_force=lambda scene, t: 9.81 - 2 * 9.81 * np.sin(2 * t)), depth=Depth.QUICK),
    ]


def hyperstatic_stick() -> list[HardCase]:
    """More frictions hold than are needed."""
    def sums(scenes: list[Scene], runs: list[Trajectory]) -> dict[str, float]:
        incline, found = np.deg2rad(15), {}
        for scene, run in zip(scenes, runs):
            weight = -scene.gravity[1] * scene.bodies["slider"].mass
            for name, total in (("friction", -weight * np.sin(incline)), ("normal_force", weight * np.cos(incline))):
                if len(sums := checks.shared(sum(checks.settled(run, f"guide-{i}.{name}") for i in (1, 2, 3)))):
                    found[f"sum of {name}"] = max(checks.gap(sums, total), found.get(f"sum of {name}", 0.0))
        return found

    def virtual_power(scenes: list[Scene], runs: list[Trajectory]) -> dict[str, float]:
        p, run = scenes[0].parameters, runs[0]
        weight = (p["m"] / 2 + p["m1"]) * p["g"] * p["L"] * np.cos(p["phi"])
        # the guides' directions are +x and +y, slider x moves with -L sin p, slider y with L cos p
        power = checks.shared(p["L"] * (np.cos(p["phi"]) * checks.settled(run, "guide-y.friction")
                                        - np.sin(p["phi"]) * checks.settled(run, "guide-x.friction")))
        return {"virtual power of friction": checks.gap(power, p["T"] + weight, weight)} if len(power) else {}

    def wedged(scenes: list[Scene], runs: list[Trajectory]) -> dict[str, float]:
        start = scenes[0].parameters["mus"] * 2 * scenes[0].parameters["T"] / scenes[0].parameters["a"] / 3
        held = (runs[0].t < 0.95 * start) & checks.carried(runs[0], "guide.friction")
        return {"friction before it breaks away": checks.gap(runs[0]["guide.friction"][held], -3 * runs[0].t[held])}

    return [
        HardCase("three guides at rest", "hyperstatic stick", "hard/three-guides-at-rest",
                 "rest; sum of friction m g sin, of normal force m g cos, in any order and any units", 1e-3,
                 both(at_rest("slider"), sums), variations=(reordered, _in_units(Units(1e3, 1e-4, 1.0))), depth=Depth.QUICK),
        HardCase("wedged slider", "hyperstatic stick", "hard/wedged-slider",
                 "friction equals the load until mus 2 T/a, then the closed form", 1e-3,
                 both(follows(slider__x=checks.pulled_free), wedged)),
        HardCase("trammel at rest", "hyperstatic stick", "hard/trammel-at-rest",
                 "rest; the virtual power of both frictions balances torque and weight", 1e-3,
                 both(at_rest("bar", "slider-x", "slider-y"), virtual_power), variations=(reordered,)),
        HardCase("trammel comes to rest", "hyperstatic stick", "hard/trammel-comes-to-rest",
                 "both guides are held where it stops, within 2 arctan(mus) of the vertical", 1e-3, checks.comes_to_rest,
                 reference={"stabilization": "none"}),
        HardCase("oblique trammel comes to rest", "hyperstatic stick", "hard/oblique-trammel-comes-to-rest",
                 "both guides are held where it stops", 1e-3, checks.comes_to_rest, depth=Depth.FULL),
    ]


def redundant_constraints() -> list[HardCase]:
    """Constraints that say the same twice."""
    def share(scenes: list[Scene], runs: list[Trajectory]) -> dict[str, float]:
        total, each = 9.81 * np.cos(angle), [checks.settled(runs[0], f"guide-{i}.normal_force") for i in (1, 2)]
        found = {"sum of normal_force": checks.gap(sum(each), total)}
        if runs[0].engine == "reference":  # no other says how it shares them
            found["minimum-norm normal forces"] = max(checks.gap(one, total / 2) for one in each)
        return found

    angle = np.deg2rad(25)
    return [
        HardCase("two guides on one line", "redundant constraints", "hard/two-guides-sliding",
                 "slides as on one guide: (g/2) (sin - mu cos) t^2; equal normal forces", 1e-3,
                 both(follows(slider__x=lambda scene, t: np.cos(angle) * checks.sliding(scene, t, 0.2, angle)), share), depth=Depth.QUICK),
        HardCase("parallelogram through its flat position", "redundant constraints", "hard/parallelogram-flat",
                 "the cranks stay parallel: a pendulum in closed form", 1e-3, follows(**{"crank-0__angle": checks.parallel_cranks}),
                 limits=_PASSING),
        HardCase("four-bars through their flat position", "redundant constraints", "four-bar",
                 "the uprights stay parallel through each flat position (IFToMM A02): a pendulum in closed form", 1e-3,
                 follows_truth(four_bar_truth, "upright-0.x"), limits=_PASSING),
        HardCase("forty cranks", "redundant constraints", "hard/forty-cranks",
                 "38 redundant rows; a pendulum in closed form", 1e-3, follows(**{"crank-0__angle": checks.parallel_cranks}), depth=Depth.FULL),
    ]


def coincidence() -> list[HardCase]:
    """Grazing contact with an event, several at once, kinks, starts on an event."""
    peak = HardCase("peak 1e-9 above the capacity", "grazing and coincidence", "hard/peak-of-the-load",
                    "breaks away within 5e-5 rad of the peak and slides off", 1e-3, follows(slider__x=checks.peak_position), depth=Depth.QUICK, static=True)
    stop = lambda scene, t: _stopping(t)
    return [
        HardCase("threshold of stick + 1e-9 N", "grazing and coincidence", "hard/threshold",
                 "the steady motion of the reduced equation, whose velocity only just passes zero", 1e-3, grazing, static=True),
        HardCase("threshold of stick - 1e-9 N", "grazing and coincidence", "hard/threshold",
                 "the same motion to 1e-9, at rest for 0.1 ms of the period", 1e-3, grazing, overrides={"F0": 4.2119562653098255},
                 static=True),
        peak,
        replace(peak, name="peak 1e-9 below the capacity", must="never moves", check=at_rest("slider"), overrides={"excess": -1e-9},
                depth=Depth.DEFAULT),
        HardCase("three guides stop at once", "grazing and coincidence", "hard/three-stop-at-once",
                 "all stop at v/(mu g), having gone v^2/(2 mu g)", 1e-3,
                 follows(left__x=lambda s, t: stop(s, t) - 1, right__x=lambda s, t: stop(s, t) + 1, other__x=stop)),
        HardCase("break-away at a kink of the load", "grazing and coincidence", "hard/kink-at-break-away",
                 "rest until the knot, the closed form from it", 1e-3, follows(slider__x=checks.kinked_position)),
        HardCase("start in break-away", "grazing and coincidence", "hard/start-on-break-away",
                 "x = (mus - mu) g t^2/2 + c t^3/(6 m) from t = 0", 1e-3,
                 follows(slider__x=checks.released_position), depth=Depth.QUICK),
        HardCase("start with a corner without load", "grazing and coincidence", "hard/start-on-corner",
                 "x'' = -mu g (1 + c t) from t = 0", 1e-4,
                 follows(slider__x=lambda scene, t: 2 * t - 2 * (t ** 2 / 2 + 2 * t ** 3 / 6))),
    ]


def rest_between_events() -> list[HardCase]:
    """Rest that is left for a moment, and rest that need not be left."""
    brief = HardCase("load above static friction for 1 ms", "rest and break-away", "hard/break-away-for-a-millisecond",
                     "breaks away at 5.62480 s; the motion of the reduced equation", 1e-3, slider_bar, overrides={"t_end": 8}, static=True, depth=Depth.QUICK)
    return [
        brief,
        replace(brief, name="load above static friction for 2 ms", scene="hard/break-away-for-two-milliseconds",
                must="breaks away at 22.47441 s; the motion of the reduced equation", overrides={}, most_steps=24_000, depth=Depth.FULL),
        HardCase("slider wider than long by 1/mus", "rest and break-away", "hard/can-jam",
                 "stop where full mobilization is exceeded: rest by wedging and slip are both solutions", 1e-3, expected=NO_MOTION,
                 stop=lambda scene: (checks.can_jam_time(scene), SEVERAL), static=True, depth=Depth.QUICK),
        HardCase("static friction below kinetic", "rest and break-away", "hard/static-below-kinetic",
                 "stop where full mobilization is exceeded first: the slider can jam", 1e-3, expected=NO_MOTION,
                 stop=lambda scene: (checks.first_break_away(scene), SEVERAL), overrides={"t_end": 2}, static=True),
    ]


def thresholds() -> list[HardCase]:
    """Steady motions next to a threshold of stick that a search by waiting, or from elsewhere, does not find."""
    briefly = HardCase("threshold after subharmonics - 1e-3 N", "stick threshold", "hard/threshold-after-subharmonics",
                       "rests for 51 us of each period; the motion of the reduced equation", 5e-3, slider_bar, static=True)
    coexisting = HardCase("threshold of two attractors - 1e-4 N", "stick threshold", "hard/threshold-of-two-attractors",
                          "comes to rest for ever; the motion of the reduced equation", 1e-2, slider_bar, static=True, depth=Depth.FULL)
    return [
        briefly, replace(briefly, name="threshold after subharmonics + 1e-3 N", must="reverses without rest; the motion of the reduced equation",
                         overrides={"F0": 9.040113413198}, depth=Depth.FULL),
        coexisting, replace(coexisting, name="threshold of two attractors + 1e-4 N", must="slides without rest; the motion of the reduced equation",
                            overrides={"F0": 1.9946997473597528}),
    ]


def friction_extremes() -> list[HardCase]:
    """Coefficients and dimensions at the ends of their ranges."""
    drawer = HardCase("drawer that slides", "friction extremes", "hard/self-locking",
                      "slides with (P/m) (1 - 2 mu h/a), a thousandth of what it had without friction", 1e-3,
                      follows(slider__x=lambda scene, t: (1 - 1 / (1 + scene.parameters["excess"])) * t ** 2 / 2))
    return [
        HardCase("mu = mus = 0", "friction extremes", "hard/zero-coefficients", "x = cos t", 1e-3,
                 follows(slider__x=lambda scene, t: np.cos(t)), most_steps=40_000),
        HardCase("mus = 10 mu", "friction extremes", "hard/static-ten-times-kinetic", "stick-slip in closed form", 1e-3, oscillator, static=True),
        HardCase("mu just below critical", "friction extremes", "hard/nearly-critical", "the motion of the reduced equation", 1e-3,
                 slider_bar),
        drawer,
        replace(drawer, name="drawer that locks", must="locks, 0.1 % below the length at which it slides, also for 1e6 N",
                check=at_rest("slider"), overrides={"excess": -1e-3, "P": 1e6}, depth=Depth.QUICK),
        replace(drawer, name="drawer without length", must="locks: a = 1 um", check=at_rest("slider"),
                overrides={"guide.length": 1e-6}),
    ]


def stiffness_and_ratios() -> list[HardCase]:
    """Stiff springs, unequal masses, fast drives, large and small mechanisms."""
    in_units = HardCase("bar of 1 km", "stiffness and ratios", "slider-bar-case-1",
                        "the same numbers as for the bar of 2 m in other units (dimensional analysis), to 1e-9", 1e-3,
                        both(slider_bar, _same_motion(Units(500.0, 1.0, np.sqrt(500.0)))), overrides={"t_end": 2},
                        variations=(_in_units(Units(500.0, 1.0, np.sqrt(500.0))),),
                        limits={**LIMITS, "rtol": Limits(1e-9, 1e-6)})
    small = Units(5e-4, 1e-6, np.sqrt(5e-4))
    return [
        HardCase("spring of 1e8 N/m", "stiffness and ratios", "hard/stiff-spring", "stick-slip in closed form", 1e-7, oscillator,
                 most_steps=60_000),
        HardCase("slider of 2e-8 kg on a bar of 2 kg", "stiffness and ratios", "hard/light-slider",
                 "the motion of the reduced equation", 1e-3, slider_bar),
        HardCase("slider of 2e8 kg on a bar of 2 kg", "stiffness and ratios", "hard/heavy-slider",
                 "the motion of the reduced equation", 1e-3, slider_bar),
        HardCase("drive at 1000 rad/s", "stiffness and ratios", "hard/fast-drive", "the motion of the reduced equation", 1e-6,
                 follows_truth(slider_bar_truth, "slider.x", events=False), most_steps=20_000),
        in_units,
        replace(in_units, name="bar of 1 mm", variations=(_in_units(small),), check=both(slider_bar, _same_motion(small)), depth=Depth.QUICK),
    ]


def long_time() -> list[HardCase]:
    """Twelve thousand periods."""
    long = HardCase("1e5 s of case 1", "long time", "hard/long-time",
                    "the reduced equation's periodic motion after 12 500 periods, the same events in each, no growth of drift", 1e-2,
                    checks.periodic, reference={"event_values": False}, depth=Depth.FULL)
    return [replace(long, name="200 s of case 1", must="the periodic motion after 25 periods, the same events in each",
                    overrides={"t_end": 200}, reference={}), long]


def corrections_and_starts() -> list[HardCase]:
    """Baumgarte outside of its range, inconsistent starts."""
    start = HardCase("start off its constraints", "corrections and starts", "hard/inconsistent-position",
                     "refused with the residual, 0.05 m", 1e-3, checks.accepted_start, expected=REFUSAL, depth=Depth.QUICK)
    return [
        HardCase("Baumgarte unstable for the step", "corrections and starts", "hard/baumgarte-unstable",
                 "the motion of the reduced equation, or the word that this step cannot have it", 1e-2, slider_bar,
                 expected=MOTION_OR_WORD, reference={"stabilization": "baumgarte"}, depth=Depth.QUICK),
        start,
        replace(start, name="velocity off its constraints", scene="hard/inconsistent-velocity", must="refused with the residual, 0.5 m/s",
                depth=Depth.DEFAULT),
    ]


def chatter() -> list[HardCase]:
    """Very many events in a short time."""
    return [HardCase("stiff spring on a slow belt", "chatter", "hard/chatter",
                     "two events every 50 ms, each in closed form", 1e-4, oscillator, most_steps=100_000, static=True, depth=Depth.FULL)]


_NEARLY_SINGULAR = {**LIMITS, "rtol": Limits(1e-5, 1e-3)}
"""Rounding, 1e-16, over the slope of the slip equation, 1e-8, times the ratio of masses, 1e-2, with a digit of reserve."""
_PASSING = {**LIMITS, "rtol": Limits(1e-4, 1e-3)}
"""Near the singular position a residual e of the state acts as forces of e over the distance to it: a step of 1e-2 rad passes
it with 1e-10 of rtol over 1e-2, squared; two digits of reserve for the order of the passage."""


def reordered(scene: Scene) -> Scene:
    """The scene with its joints in reverse order."""
    raw = scene.model_dump()
    raw["joints"] = dict(reversed(raw["joints"].items()))
    return scene_from_dict(raw, scene._origin, name=scene.name)


def _in_units(units: Units) -> Callable[[Scene], Scene]:
    return lambda scene: scaled(scene, units)


def _same_motion(units: Units) -> checks.Check:
    def check(_: list[Scene], runs: list[Trajectory]) -> dict[str, float]:
        one, other = runs
        n = min(len(one.t), len(other.t))
        size = float(np.ptp(one["slider.x"]))
        found = {"motion in other units": checks.gap(other["slider.x"][:n] / units.length, one["slider.x"][:n], size)}
        if one.events or other.events:
            same = [event.kind for event in one.events] == [event.kind for event in other.events]
            found["events in other units"] = checks.gap(
                np.array([event.time for event in other.events]) / units.time, np.array([event.time for event in one.events]),
                one.t[-1]) if same else np.inf
        return found
    return check


def _stopping(t: np.ndarray) -> np.ndarray:
    s = np.minimum(t, 1 / (0.2 * 9.81))
    return s - 0.2 * 9.81 * s ** 2 / 2


@cache
def hard_cases(depth: Depth = Depth.FULL) -> tuple[HardCase, ...]:
    """The cases that a depth reaches."""
    topics = (existence, vanishing_normal_force, hyperstatic_stick, redundant_constraints, coincidence, rest_between_events, thresholds,
              friction_extremes,
              stiffness_and_ratios, long_time, corrections_and_starts, chatter, hostile_cases)
    return tuple(case for topic in topics for case in topic() if depth.reaches(case.depth))
