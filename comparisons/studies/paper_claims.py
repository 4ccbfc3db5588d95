"""What the paper says about its example, statement by statement: measured on the independent solution and on runs of the HLCP scheme.

Source of every claim: Zhuang & Wang, Acta Mech. Sin. 30(3), 437-446 (2014), in the words of the text. A claim has a measure with a margin, positive where the
claim holds, that is taken of four stretches of motion: the independent solution from the start and in its steady state, and the paper's own
scheme from the start and in its last period. The verdict follows from the four. What is asked of a run, how long and with how small a step, comes from
repeating the measure on shorter and coarser ones.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison
from stiction.comparisons.measures.drift_growth import BOUNDED, GROWS, INCONCLUSIVE, ROUNDED
from stiction.comparisons.measures.steady_stretch import Stretch, run_stretch, steady_stretch, truth_stretch
from stiction.comparisons.studies.constraint_drift import LENGTHS, NONE, PAPERS, drift_findings, longest, run_name
from stiction.comparisons.truth import HIGH_PRECISION, NoMotion, StickThreshold, slider_bar_truth
from stiction.comparisons.truth.reduced.slider_bar import SliderBar
from stiction.comparisons.truth.reduced.steady_state import NoSteadyState, stick_threshold
from stiction.comparisons.uncertain import Uncertain
from stiction.engines.isolation import Outcome, Task
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, scene_to_toml, vary

HOLDS, STEADY, PARTLY, FAILS = "holds", "holds in the steady state only", "partly", "does not hold"
CONTRADICTS, NOT_TESTABLE, UNDECIDED = "contradicts itself", "not testable", "not decided"
VERDICTS = (HOLDS, STEADY, PARTLY, CONTRADICTS, FAILS, NOT_TESTABLE, UNDECIDED)

LINE = 1 / 500
"""Of the range: what the width of a line, 0.1 mm, is to the height of a printed figure, 50 mm. The paper shows that the motion repeats
itself by figures; a smaller change from one period to the next could not be seen in them."""
RUN, FROM_START = 80.0, 24.0
"""s; of a run of the scheme, whose last period is its steady state, and of the stretch from the start, the length of the paper's figures. The slowest of the
return maps' multipliers is 0.5 in 8 s, and 0.5^9 is below `LINE`."""
STEPS = (1e-2, 5e-3, 2.5e-3, 1e-3)
"""s; of the runs of the scheme. The verdict is that of the last."""
AMPLITUDES = (0.1, 0.5, 0.99, 1.01, 2.0)
"""Of the threshold on F0: on both sides as near as 1 %, which is some hundred times what the scheme at 1 ms is unsure of it, and as far as 10 times and twice."""
CORNERS = ("guide.F1", "guide.F2", "guide.F3", "guide.F4")
EFFORT, ACCELERATION, FRICTION = "motor.effort", "slider.ax", "guide.friction"

Simulate = Callable[[Scene, float, float], Trajectory]
"""(scene, t_end, step) to a run."""
View = Callable[[Scene], Stretch]


@dataclass(frozen=True)
class Finding:
    """What a measure yields: `margin`, positive where the claim holds, and in words; `some`: it holds of some of what it is about."""

    margin: float
    words: str
    some: bool = False

    @property
    def holds(self) -> bool:
        return self.margin > 0


Measure = Callable[[View, Mapping[int, Scene]], Finding]


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper.

    Attributes
    ----------
    case, place, words : str
        The case it is about, where it stands, and the sentence.
    measure : callable, optional
        None where nothing can be measured: `note` says why.
    margin : str
        What the margin is, and at which value it would fail.
    beginning : bool
        It is about the beginning of the motion alone.
    contradiction : str
        Another sentence of the paper that it cannot be true beside.
    """

    case: str
    place: str
    words: str
    measure: Measure | None
    margin: str = ""
    note: str = ""
    beginning: bool = False
    contradiction: str = ""


def _periodic(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    change = view(cases[case]).change()
    return Finding(LINE - change, f"changes by {change:.1e} of its range from one period to the next")


def _sticks(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Shortest stick phase, in which velocity and acceleration must vanish: to rounding, 1e-9 of their largest values."""
    stretch = view(cases[case])
    if not stretch.phases:
        return Finding(-_restart(stretch), "no stick phase")
    rests = 0.0
    for start, end in stretch.phases:
        inside = (stretch.t > start) & (stretch.t < end)
        rests = max([rests, *(float(np.max(np.abs(stretch.columns[name][inside]), initial=0.0)) / stretch.maximum(name)
                              for name in ("slider.vx", ACCELERATION))])
    shortest = min(end - start for start, end in stretch.phases)
    return Finding(shortest if rests <= 1e-9 else -rests, f"{len(stretch.phases)} stick phases, {stretch.stick_time:.4f} s in all; "
                   f"velocity and acceleration in them at most {rests:.0e} of their largest")


def _restart(stretch: Stretch) -> float:
    """Smallest acceleration with which the slider goes on after its velocity was zero, m/s^2."""
    return min((abs(event.after[ACCELERATION]) for event in stretch.turning), default=np.inf)


def _slips(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    stretch = view(cases[case])
    if stretch.phases:
        return Finding(-stretch.stick_time, f"stuck for {stretch.stick_time:.4f} s")
    least = _restart(stretch)
    return Finding(least, f"never stuck; goes on with at least {least:.3g} m/s^2 where its velocity is zero")


def _jumps(column: str, unit: str, case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Smallest jump of a column at events, less what a smooth change may look like."""
    stretch = view(cases[case])
    sizes = [abs(event.jump(column)) for event in stretch.turning]
    if not sizes:
        return Finding(-1.0, "no event")
    resolution, largest = stretch.resolution(column), stretch.maximum(column)
    told = sum(size > resolution for size in sizes)
    return Finding(min(sizes) - resolution, f"{told} of {len(sizes)} jumps, of {min(sizes):.3g} to {max(sizes):.3g} {unit} where the largest value is "
                   f"{largest:.3g}, told from changes of {resolution:.1g}", 0 < told < len(sizes))


def _friction_causes(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Of the jump of mass times acceleration along the guide the part that friction's jump is, at every event."""
    stretch, mass = view(cases[case]), SliderBar.from_scene(cases[case]).mass
    rest = [abs(1 - event.jump(FRICTION) / (mass * event.jump(ACCELERATION))) for event in stretch.turning if event.jump(ACCELERATION)]
    if not rest:
        return Finding(-1.0, "no event")
    return Finding(0.5 - max(rest), f"friction's jump is all of (m1 + m2) times that of the acceleration but {max(rest):.0e}")


def _direction_changes(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Friction before and after each event: opposite signs."""
    events = view(cases[case]).turning
    if not events:
        return Finding(-1.0, "no event")
    turned = {kind: [event.before[FRICTION] * event.after[FRICTION] < 0 for event in events if event.kind == kind] for kind in
              dict.fromkeys(event.kind for event in events)}
    count = sum(map(sum, turned.values()))
    told = ", ".join(f"{kind}: {sum(found)} of {len(found)}" for kind, found in turned.items())
    return Finding(count / len(events) - 1 + 1 / (2 * len(events)), f"friction changes its direction at {count} of {len(events)} jumps ({told})",
                   0 < count < len(events))


def _alternates(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Two adjacent and two opposite corners in turn; the shorter of the times that each kind lasts."""
    found = view(cases[case]).configurations
    kinds = [name in ("1+2", "3+4") for name, _ in found]
    pairs = all(name in ("1+2", "3+4", "1+3", "2+4") for name, _ in found)
    turns = all(one != other for one, other in zip(kinds, kinds[1:]))
    times = [sum(seconds for (_, seconds), adjacent in zip(found, kinds) if adjacent == kind) for kind in (True, False)]
    return Finding(min(times) if pairs and turns else -1.0, f"adjacent for {times[0]:.3f} s, opposite for {times[1]:.3f} s, {len(found) - 1} changes")


def _order(case: int, said: Sequence[str], view: View, cases: Mapping[int, Scene]) -> Finding:
    """The first configurations; the shortest of them."""
    found = view(cases[case]).configurations[:len(said)]
    same = [name for name, _ in found] == list(said)
    return Finding(min(seconds for _, seconds in found) if same else -1.0, " -> ".join(f"{name} ({seconds:.3f} s)" for name, seconds in found))


def _similar(case: int, other: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """The same cycle of configurations in the last period; the shortest of them."""
    last = [stretch.between(stretch.end - stretch.period, stretch.end) for stretch in (view(cases[case]), view(cases[other]))]
    one, two = (stretch.cycle() for stretch in last)
    shortest = min(seconds for stretch in last for _, seconds in stretch.configurations[1:-1] or stretch.configurations)
    return Finding(shortest if one == two else -1.0, f"case {case}: {' -> '.join(one)}; case {other}: {' -> '.join(two)}")


def _all_configurations(case: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    found = view(cases[case]).configurations
    times = {pair: sum(seconds for name, seconds in found if name == pair) for pair in ("1+3", "2+4", "1+2", "3+4")}
    return Finding(min(times.values()) or -1.0, ", ".join(f"{pair} for {seconds:.3f} s" for pair, seconds in times.items()), any(times.values()))


def _larger(case: int, other: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Largest corner force and largest moment, in units of the other case's."""
    ratios = _ratios(view(cases[case]), view(cases[other]))
    return Finding(min(ratios.values()) - 1, ", ".join(f"{name} {ratio:.3g} times" for name, ratio in ratios.items()),
                   max(ratios.values()) > 1)


def _ratios(one: Stretch, other: Stretch) -> dict[str, float]:
    return {name: one.maximum(*columns) / other.maximum(*columns) for name, columns in (("F_i", CORNERS), ("moment", (EFFORT,)))}


def _larger_because(case: int, other: int, names: Sequence[str], view: View, cases: Mapping[int, Scene]) -> Finding:
    """The other case with each of the parameters alone as in this one."""
    ratios = {name: _ratios(view(vary(cases[other], {name: cases[case].parameters[name]})), view(cases[other])) for name in names}
    sizes = [ratio for found in ratios.values() for ratio in found.values()]
    return Finding(min(sizes) - 1, "; ".join(f"{name} alone: " + ", ".join(f"{what} {ratio:.3g} times" for what, ratio in found.items())
                                             for name, found in ratios.items()), max(sizes) > 1)


def _slips_because(case: int, other: int, name: str, view: View, cases: Mapping[int, Scene]) -> Finding:
    """One parameter exchanged between the two cases: this one must stick, the other must not."""
    here = view(vary(cases[case], {name: cases[other].parameters[name]}))
    there = view(vary(cases[other], {name: cases[case].parameters[name]}))
    return Finding(min(here.stick_time, _restart(there)) if here.stick_time and not there.stick_time else -1.0,
                   f"case {case} with the {name} of case {other} is stuck for {here.stick_time:.3f} s of {here.end - here.start:g} s, "
                   f"case {other} with that of case {case} for {there.stick_time:.3f} s", bool(here.stick_time) != bool(there.stick_time))


def _threshold(case: int, threshold: StickThreshold, view: View, cases: Mapping[int, Scene]) -> Finding:
    """Stick phases below the threshold, none above it, at `AMPLITUDES` of it."""
    if threshold.F0 is None:
        return Finding(-1.0, f"no threshold: {threshold.note}")
    stretches = {factor: view(vary(cases[case], {"F0": factor * threshold.F0})) for factor in AMPLITUDES}
    wrong = [factor for factor, stretch in stretches.items() if bool(stretch.stick_time) != (factor < 1)]
    still = [factor for factor, stretch in stretches.items() if stretch.stick_time >= stretch.end - stretch.start - 1e-6]
    words = f"sticks below and not above F0 = {threshold.F0:.7f} N at {len(AMPLITUDES) - len(wrong)} of {len(AMPLITUDES)} amplitudes, {AMPLITUDES[0]:g} to {AMPLITUDES[-1]:g} times it"
    if still:
        words += f"; up to {max(still) * threshold.F0:.3g} N it never moves"
    return Finding(min(abs(factor - 1) for factor in AMPLITUDES) if not wrong else -1.0, words, len(wrong) < len(AMPLITUDES))


def _amplitude(sticking: int, slipping: int, view: View, cases: Mapping[int, Scene]) -> Finding:
    one, two = view(cases[sticking]), view(cases[slipping])
    others = {name for name, value in cases[sticking].parameters.items() if value != cases[slipping].parameters[name]}
    alone = others == {"F0"}
    return Finding(min(one.stick_time, _restart(two)) if one.stick_time and not two.stick_time and alone else -1.0,
                   f"stuck for {one.stick_time:.4f} s and {two.stick_time:.4f} s of {one.end - one.start:g} s; the cases differ in {', '.join(sorted(others))}",
                   bool(one.stick_time) != bool(two.stick_time))


DEFINITION = "a definition, not a statement about the motion"


def claims(threshold: StickThreshold) -> tuple[Claim, ...]:
    """The paper's sentences about its example, in their order; those about drift are `drift_claims`'s."""
    at = "Sect. 5, p. {}".format
    stick = "shortest stick phase, s; fails at 0"
    restart = "smallest acceleration after a stop, m/s^2; fails at 0, where it would stick"
    repeats = (f"{LINE:g} less the change per period; fails where a printed line would show it. The independent steady state repeats itself by construction, or there is none: "
               "the run, which knows of no period, decides")
    jump = "smallest jump less what a step of the run changes; fails at 0"
    return (
        Claim("1", at(442), "It is found that the motion of the slider is periodic.", partial(_periodic, 1), repeats),
        Claim("1", at(442), "When both the velocity and the acceleration of slider remain zero, stick phase takes place in the motion.", partial(_sticks, 1), stick),
        Claim("1", at(442), "The slider slips if either the velocity or the acceleration of slider is nonzero.", None, note=DEFINITION),
        Claim("1", at(442), "the value of slider acceleration jumps when the stick-slip transition occurs or the direction of slider's velocity changes",
              partial(_jumps, ACCELERATION, "m/s^2", 1), f"m/s^2, {jump}"),
        Claim("1", at(442), "[it jumps] due to the variation of the value of friction forces acting on the slider", partial(_friction_causes, 1),
              "0.5 less the part of a jump that is not friction's; fails where friction is not the larger part"),
        Claim("1", at(443), "Two adjacent slider corners and two opposite slider corners are in contact with the guide surfaces alternately in the motion.",
              partial(_alternates, 1), "the shorter of the times of each kind, s; fails at 0"),
        Claim("1", at(443), "initially, corners 2 and 4 of the slider remain in contact with the upper and the lower surfaces of the guide, respectively. "
              "Next, corners 1 and 2 [..] the lower surface [..]. And then, corners 1 and 3 [..]. Finally, the lower surface of the slider is in contact [..] again.",
              partial(_order, 1, ("2+4", "1+2", "1+3", "1+2")), "shortest of the four, s; fails at 0", beginning=True,
              contradiction="corner 2 is at the upper surface in its first sentence and at the lower one in its second; the order of the pairs is right"),
        Claim("1", at(443), "a small abrupt change of the magnitude of driving moment occurs when the magnitude of slider's acceleration jumps",
              partial(_jumps, EFFORT, "N m", 1), f"N m, {jump}; how small is small the paper does not say"),
        Claim("1", at(443), "This phenomenon results from the direction change of frictional forces acting on the slider.", partial(_direction_changes, 1),
              "part of the jumps with a change of direction, less 1; fails as soon as one has none"),
        Claim("2", at(443), "the slider's motion is periodic", partial(_periodic, 2), repeats),
        Claim("2", at(443), "without stick phenomena", partial(_slips, 2), restart),
        Claim("1, 2", at(443), "[without stick phenomena] because F0 in this case is bigger than that in Case 1 [and again on p. 444: F0 = 3.0 N or F0 = 5.0 N]",
              partial(_amplitude, 1, 2), "the smaller of stick phase and acceleration after a stop; fails at 0"),
        Claim("2", at(443), "the value of slider's acceleration jumps when the direction of slider's velocity changes", partial(_jumps, ACCELERATION, "m/s^2", 2),
              f"m/s^2, {jump}"),
        Claim("2", at(443), "the contact situations of the slider inside the guide are similar to those in Case 1", partial(_similar, 2, 1),
              "shortest configuration, s; fails where the cycles differ"),
        Claim("3", at(444), "The slider's motion is periodic", partial(_periodic, 3), repeats),
        Claim("3", at(444), "without stick phase", partial(_slips, 3), restart),
        Claim("3", at(444), "[without stick phase] because w0 in this case is bigger than that in Case 1", partial(_slips_because, 3, 1, "w0"),
              "the smaller of stick phase and acceleration after a stop with w0 exchanged; fails where that does not decide"),
        Claim("3", at(444), "all contact configurations of the slider and the guide shown in Fig. 3 appear in this case", partial(_all_configurations, 3),
              "shortest time of one of the four, s; fails at 0"),
        Claim("3", at(444), "the maximum values of F_i(t) and lambda_D are bigger than those in Case 1", partial(_larger, 3, 1), "smaller ratio less 1; fails at 0"),
        Claim("3", at(444), "[they are bigger] because L and w are bigger than those in Case 1 and Case 2", partial(_larger_because, 3, 1, ("L", "w0")),
              "smallest ratio less 1 with one of them changed alone; fails at 0"),
        Claim("1", at("444-445"), "If the amplitude of the external force acting on the slider is not large enough, the stick phase would take place [..] the stick "
              "phenomenon occurs in slider's motion if 0 < F0 <= [..], and the slider remains slipping without stick phenomena if F0 > [..]",
              partial(_threshold, 1, threshold), "distance of the nearest amplitude that is told from the threshold, in units of it; fails where one is on the wrong side"),
        Claim("1", at(445), "[the value of that amplitude]", None, note="the number is lost in the text we have; ours is in the table of thresholds"),
        Claim("-", at(445), "[the bound of the drift with Baumgarte's stabilization]", None, note="the number is lost in the text we have; ours is in the table of drift"))


def paper_run(scene: Scene, t_end: float, step: float) -> Trajectory:
    """The paper's scheme with its stabilization, samples as the steps or every 2 ms."""
    return ReferenceEngine().simulate(scene, t_end=t_end, dt=step, output_step=max(step, 2e-3), assemble=True)


class Views:
    """The stretches that claims are measured on; each motion is made once."""

    def __init__(self, simulate: Simulate = paper_run):
        self._simulate = simulate
        self._known: dict[tuple[str, object], Stretch] = {}

    def steady_truth(self, scene: Scene) -> Stretch:
        return self._once(scene, "steady", lambda: steady_stretch(scene))

    def truth(self, scene: Scene) -> Stretch:
        return self._once(scene, "truth", lambda: truth_stretch(scene, slider_bar_truth(scene, FROM_START)))

    def run(self, step: float, scene: Scene) -> Stretch:
        """All of a run of the scheme: as many periods as `RUN` has."""
        period = SliderBar.from_scene(scene).period()
        return self._once(scene, step, lambda: run_stretch(scene, self._simulate(scene, period * max(2, round(RUN / period)), step), step))

    def beginning(self, step: float, scene: Scene) -> Stretch:
        whole = self.run(step, scene)
        return whole.between(0.0, FROM_START)

    def period(self, step: float, age: float, scene: Scene) -> Stretch:
        """The whole period that ends about `age` seconds before the end of the run; 0 the last, and the first where there are none before it."""
        whole = self.run(step, scene)
        number = min(round(age / whole.period), round(whole.end / whole.period) - 1)
        end = whole.end - number * whole.period
        return whole.between(end - whole.period, end)

    def _once(self, scene: Scene, what: object, make: Callable[[], Stretch]) -> Stretch:
        key = scene_to_toml(scene), what
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]


def claims_comparison(cases: Mapping[int, Scene], threshold: StickThreshold) -> Comparison[pd.DataFrame]:
    """`claims_table` of the claims about the motion, a task for those of one case, which share motions; lost, they are a row with the reason."""
    numbers: dict[str, list[int]] = {}
    for number, claim in enumerate(claims(threshold)):
        numbers.setdefault(claim.case, []).append(number)

    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        parts = [outcome.value.assign(status="ok", reason="").set_axis(there) if outcome.value is not None else pd.DataFrame({
            "case": case, "place": "", "claim": f"[all about case {case}]", "verdict": UNDECIDED, "why": outcome.reason,
            "status": outcome.status, "reason": outcome.reason}, index=there[:1])
                 for (case, there), outcome in zip(numbers.items(), outcomes, strict=True)]
        return pd.concat(parts).sort_index().reset_index(drop=True)

    return Comparison(tuple(Task(f"claims/{case}", claims_table, (dict(cases), threshold, case)) for case in numbers), tabulate)


def claims_table(cases: Mapping[int, Scene], threshold: StickThreshold, about: str | None = None, simulate: Simulate = paper_run) -> pd.DataFrame:
    """One row per claim about the motion: words and place, verdict, margins and what was found on each stretch, how long a run and how small a step it
    takes. `drift_claims` has the others.

    Parameters
    ----------
    cases
        The paper's, by number.
    threshold
        Of the first case.
    about
        Case of the claims; all of them where None.
    simulate
        The scheme that is held to the claims.
    """
    views = Views(simulate)
    return pd.DataFrame([{"case": claim.case, "place": claim.place, "claim": claim.words, **_examine(claim, views, cases), "truth tier": HIGH_PRECISION}
                         for claim in claims(threshold) if about in (None, claim.case)])


def drift_claims(study: pd.DataFrame, scene: str) -> list[dict[str, Any]]:
    """Rows as of `claims_table` for the two sentences about Fig. 14, from the table of `stiction.comparisons.studies.constraint_drift`.

    Decided by the laws of growth of the longest runs. The margin is what is left of the interval of the exponent: above zero for drift that grows, and how
    far its spread is below that of a random walk for drift that does not. Drift that is no more than rounding makes of a coordinate is bounded as far as the
    method is concerned: the sentence is about the method.
    """
    rows = []
    found = drift_findings(study, scene)
    for choice, words, wanted, margin in (
            (NONE, "the constraint drift grows indefinitely with time when the Baumgarte stabilization method is not utilized", (GROWS,),
             "lower end of the exponent's interval, smallest of all steps; fails at 0"),
            (PAPERS, "it can remain bounded by means of the Baumgarte stabilization method", (BOUNDED, ROUNDED),
             "1 less the spread of the octaves in units of what a random walk hardly ever stays below, smallest of all steps with a law; fails at 0")):
        runs = found[choice.label]
        laws = [(run["step"], *longest(run)) for run in runs]
        held = [law in wanted for _, law, *_ in laws if law != INCONCLUSIVE]  # of a run that is too short to tell nothing follows
        verdict = UNDECIDED if not held else HOLDS if all(held) else PARTLY if any(held) else FAILS
        margins = [exponent - half if choice is NONE else 1 - spread for _, law, exponent, half, spread, _ in laws if law not in (ROUNDED, INCONCLUSIVE)]
        row = {"case": "-", "place": "Sect. 5, p. 445", "claim": words, "verdict": verdict, "margin is": margin, "truth tier": "closed form",
               "found, HLCP, from the start": "; ".join(map(_law_in_words, runs)) or "no run",
               "runs of the study": "; ".join(run_name(scene, choice.label, run["step"]) for run in runs)}
        if margins:
            row |= {"margin, HLCP, from the start": min(margins)}
        lengths = [length for length in LENGTHS if runs and all(run.get(f"growth, {length:g} s") in wanted for run in runs)]
        if lengths:
            row |= {"run needed [s]": lengths[0], "step needed [s]": max(run["step"] for run in runs)}
        rows.append(row)
    return rows


def _law_in_words(run: Mapping[str, Any]) -> str:
    law, exponent, half, _, length = longest(run)
    until = run.get(f"above rounding until, {length:g} s [s]", length)
    seen = f", read to {until:g} s, rounding beyond" if np.isfinite(until) and until < length else ""
    return f"{1e3 * run['step']:g} ms: {law} over {length:g} s" + ("" if law in (ROUNDED, BOUNDED) else f", as t^({Uncertain(exponent, half).both()}){seen}")


def _examine(claim: Claim, views: Views, cases: Mapping[int, Scene]) -> dict[str, Any]:
    if claim.measure is None:
        return {"verdict": NOT_TESTABLE, "why": claim.note}
    found = findings(claim, views, cases)
    said = verdict(claim, found)
    row: dict[str, Any] = {"verdict": said, "why": claim.contradiction if said == CONTRADICTS else "", "margin is": claim.margin}
    row |= {f"margin, {name}": finding.margin for name, finding in found.items()} | {f"found, {name}": finding.words for name, finding in found.items()}
    return row | (_needs(claim, views, cases) if said in (HOLDS, STEADY, CONTRADICTS) else {})


def findings(claim: Claim, views: Views, cases: Mapping[int, Scene]) -> dict[str, Finding]:
    """What is found of a claim on each stretch of motion; of one about the beginning, on those from the start."""
    step = STEPS[-1]
    where = {"truth, from the start": views.truth, "truth, steady": views.steady_truth,
             "HLCP, from the start": partial(views.beginning, step), "HLCP, last period": partial(views.period, step, 0)}
    return {name: _measured(claim.measure, view, cases) for name, view in where.items() if "start" in name or not claim.beginning}


def _measured(measure: Measure, view: View, cases: Mapping[int, Scene]) -> Finding:
    try:
        return measure(view, cases)
    except (NoSteadyState, NoMotion) as error:
        return Finding(float("nan"), str(error))


def verdict(claim: Claim, found: Mapping[str, Finding]) -> str:
    """From what was found on each stretch.

    It holds where it does on all of them; in the steady state only where it does on both stretches of it and not on one from the start; where truth and
    run disagree, or only a part of what it is about is so, partly. A claim that holds and contradicts another is said to contradict itself.
    """
    holds = {name: finding.holds for name, finding in found.items()}
    if any(np.isnan(finding.margin) for finding in found.values()):
        return UNDECIDED
    if all(holds.values()):
        return CONTRADICTS if claim.contradiction else HOLDS
    steady = [held for name, held in holds.items() if "start" not in name]
    if steady and all(steady):
        return STEADY
    return PARTLY if any(holds.values()) or any(finding.some for finding in found.values()) else FAILS


def _needs(claim: Claim, views: Views, cases: Mapping[int, Scene]) -> dict[str, Any]:
    """The shortest run from which on the claim holds in every period, and the largest step from which on it does in the last, of those tried."""
    def held(step: float, age: float) -> bool:
        view = partial(views.beginning, step) if claim.beginning else partial(views.period, step, age)
        return _measured(claim.measure, view, cases).holds

    period, number, step = SliderBar.from_scene(cases[int(claim.case[0])]).period(), 0, STEPS[-1]
    while not claim.beginning and (number + 2) * period <= RUN and held(step, (number + 1) * period):
        number += 1
    coarser = step
    for candidate in STEPS[-2::-1]:
        if not held(candidate, 0):
            break
        coarser = candidate
    return {"run needed [s]": FROM_START if claim.beginning else RUN - number * period, "step needed [s]": coarser}


CHOICES: dict[str, Mapping[str, Any]] = {
    "as here: g = 9.81, anchor at L0, start at L0": {},
    "g = 9.8": {"g": 9.8}, "g = 10": {"g": 10.0},
    "spring natural at x = 0": {"springs.spring.points.1.0": 0.0},
    "start at x = 0": {"bodies.slider.position.0": 0.0, "bodies.bar.position.0": "L/2"},
    "start at x = 1 m": {"bodies.slider.position.0": 1.0, "bodies.bar.position.0": "1 + L/2"},
    "start with 1 m/s": {"bodies.slider.velocity.0": 1.0, "bodies.bar.velocity.0": 1.0}}
"""What the paper does not give, and other values of it."""


SAMPLING = 1e-5
"""Part of a number by which it must differ to be said to change: maxima are of 4000 samples a period, which miss that of the fastest oscillation here, four periods
of the bar in one of the load, by up to (2 pi 4/4000)^2/8 = 5e-6 of it."""


@dataclass(frozen=True)
class Sensitivity:
    """Under one choice: the threshold on F0 (N), `numbers` by the heading of their column, the verdicts by the words of the claim, and why numbers are missing."""

    threshold: float | None
    numbers: Mapping[str, float]
    verdicts: Mapping[str, str]
    reason: str = ""


def sensitivity(cases: Mapping[int, Scene], overrides: Mapping[str, Any]) -> Sensitivity:
    """What the independent solution has where the paper's cases are changed by `overrides` of `stiction.scenes.vary`."""
    varied = {case: vary(scene, overrides) if overrides else scene for case, scene in cases.items()}
    threshold, views = stick_threshold(varied[1]), Views()
    verdicts, numbers, reasons = {}, {}, [threshold.note] if threshold.F0 is None else []
    for claim in claims(threshold):
        if claim.measure is not None:
            where = {"truth, from the start": views.truth} | ({} if claim.beginning else {"truth, steady": views.steady_truth})
            verdicts[_named(claim)] = verdict(claim, {name: _measured(claim.measure, view, varied) for name, view in where.items()})
    for case in varied:
        try:
            steady = views.steady_truth(varied[case])
        except (NoSteadyState, NoMotion) as error:
            reasons.append(f"case {case}: {error}")
            continue
        numbers |= {f"stick time per period, case {case} [s]": steady.stick_time_per_period, f"largest F_i, case {case} [N]": steady.maximum(*CORNERS),
                    f"largest moment, case {case} [N m]": steady.maximum(EFFORT)}
    return Sensitivity(threshold.F0, numbers, verdicts, "; ".join(reasons))


def _named(claim: Claim) -> str:
    """Case and words: the same words are said of several cases."""
    return f"case {claim.case}: {claim.words}"


def sensitivity_comparison(cases: Mapping[int, Scene]) -> Comparison[pd.DataFrame]:
    """One row per choice that the paper leaves open: what of the independent solution depends on it.

    Columns: ``choice``; ``reason`` why a number, or the whole row, is missing; ``claims that change``: verdicts that are not those under the first choice, of the
    independent solution alone, from the start and in the steady state; ``numbers that change``: those that differ from the first choice by more than `SAMPLING`;
    ``threshold on F0 [N]`` and the numbers themselves.
    """
    def tabulate(outcomes: Sequence[Outcome]) -> pd.DataFrame:
        before: Sensitivity | None = outcomes[0].value
        return pd.DataFrame([_sensitivity_row(choice, outcome, before) for choice, outcome in zip(CHOICES, outcomes, strict=True)])

    return Comparison(tuple(Task(f"sensitivity/{choice}", sensitivity, (dict(cases), overrides)) for choice, overrides in CHOICES.items()), tabulate)


def _sensitivity_row(choice: str, outcome: Outcome, before: Sensitivity | None) -> dict[str, Any]:
    found: Sensitivity | None = outcome.value
    if found is None:
        return {"choice": choice, "status": outcome.status, "reason": outcome.reason}
    row = {"choice": choice, "status": "ok", "reason": found.reason}
    numbers = {"threshold on F0 [N]": found.threshold, **found.numbers}
    if before is None:
        unknown = "not known: the first choice has no result"
        return row | {"claims that change": unknown, "numbers that change": unknown, **numbers}
    claims_changed = [f"\"{textwrap.shorten(words, 90, placeholder=' ..')}\" {said} (was: {before.verdicts.get(words, UNDECIDED)})"
                      for words, said in found.verdicts.items() if said != before.verdicts.get(words, UNDECIDED)]
    old = {"threshold on F0 [N]": before.threshold, **before.numbers}
    numbers_changed = [f"{name.rpartition(' [')[0]} {_change(old[name], value)}" for name, value in numbers.items()
                       if old.get(name) is not None and value is not None and abs(value - old[name]) > SAMPLING * abs(old[name])]
    return row | {"claims that change": "; ".join(claims_changed) or "none", "numbers that change": "; ".join(numbers_changed) or "none", **numbers}


def _change(before: float, after: float) -> str:
    return f"{100 * (after / before - 1):+.2g} %" if before else f"{after:.3g} (was: 0)"
