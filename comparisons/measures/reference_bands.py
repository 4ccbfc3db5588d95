"""Bands of the steady states of any mechanism, by runs of the reference implementation.

The reference locates the events of a motion, so that a stick phase is seen however short it is. Where there is no
independent solution, its bands are the answer; elsewhere they say where the independent solution has to look.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from math import ceil, isfinite

import numpy as np

from stiction.comparisons.measures.settling import (
    NoCommonPeriod,
    NotSettled,
    excitation_period,
)
from stiction.comparisons.measures.steady_state_measures import (
    REPEATS,
    SteadyRun,
    SteadyWindow,
    measure_of,
    steady_window,
)
from stiction.scenes import InputError, Scene, StictionError, vary
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.laws import Linear
from stiction.truths.bands import (
    Band,
    BandKind,
    ExpectedEnd,
    Range,
    find_bands,
    no_expected_end,
    with_coexisting,
)

AMPLITUDE = "F0"
"""Parameter that is varied if no other one is named: the amplitude of the load of the paper's example."""
USUAL_RANGE = 4.0
"""Upper end of the range of a parameter for which none is given, in units of the scene's own value; the lower end is
zero."""
USUAL_VALUES = 120
"""Values in a range for which no resolution is given: a few seconds of computing time. The narrowest band that is
known, 0.3 N of 12 N, contains three of them."""
GRID_RTOL = 1e-6
"""Relative tolerance of the runs on the grid."""
END_RTOL = 1e-9
"""Relative tolerance of the runs by which an end is located."""
END_WIDTH = 1e-6
"""Width to which an end is located, as a part of the range: what the rest of the transient leaves of it at that
tolerance."""
FIRST_PERIODS = 15
"""Periods of loads and drives that a motion is given at first. Case 1 of the paper contracts by half in each."""
LONGEST = 16
"""Length of the last run of a motion that does not settle, in units of its first run."""

Start = Mapping[str, object]
"""Values of a scene that replace its start, by key as in `vary`; the scene's own start where empty."""
OWN_START: Start = {}


@dataclass(frozen=True)
class Variation:
    """A parameter of a scene, its searched range, and the joint that is looked at.

    Attributes
    ----------
    parameter : str
        Key as in `vary`: a parameter, or a value such as ``guide.mu``.
    joint : str
        Name of the frictional guide or pin.
    searched : Range
        Values that are examined.
    own : float
        The scene's own value, next to which the threshold is; the middle of the range where it is not a parameter.
    """

    parameter: str
    joint: str
    searched: Range
    own: float


def variation_of(
    scene: Scene,
    parameter: str | None = None,
    joint: str | None = None,
    ends: tuple[float, float] | None = None,
    resolution: float | None = None,
) -> Variation:
    """Return what is varied in a scene, with defaults for all that is not given.

    Raises
    ------
    InputError
        If the scene does not have the parameter, or no frictional joint of this name; if a range is missing that
        cannot be derived from the scene's own value; or as `Range`.
    """
    # a guide is looked at before a pin
    joints = list(scene.frictional_guides | scene.frictional_joints)
    if not joints:
        raise InputError(f"joint: found no joint with friction in {scene.name}; expected one")
    if joint is not None and joint not in joints:
        raise InputError(f"joint: found {joint!r}; expected one of {', '.join(joints)}")
    key = parameter or AMPLITUDE
    own = scene.parameters.get(key)
    if parameter is None and own is None:
        raise InputError(
            f"parameter: found no parameter {AMPLITUDE} in {scene.name}; expected --parameter KEY, such "
            "as guide.mu, and --range LOW:HIGH"
        )
    if ends is None:
        if own is None or not isfinite(own) or own == 0:
            raise InputError(
                f"range: found none for {key}; expected --range LOW:HIGH, or an axis {key} of a sweep, as "
                "the scene has no value of its own from which to derive it"
            )
        low, high = sorted((0.0, USUAL_RANGE * own))
    else:
        low, high = ends
    searched = Range(low, high, (high - low) / USUAL_VALUES if resolution is None else resolution)
    # A key that the scene does not have is an error of every value.
    try:
        vary(scene, {key: own if own is not None else searched.low})
    except StictionError as error:
        if own is None and not _is_possible(scene, key, searched):
            raise InputError(f"parameter: found {key!r}; {error}") from None
    return Variation(
        key, joint or joints[0], searched, 0.5 * (low + high) if own is None else float(own)
    )


def _is_possible(scene: Scene, key: str, searched: Range) -> bool:
    """Return True if the scene exists with one of the values."""
    for value in searched.values():
        try:
            vary(scene, {key: value})
        except StictionError:
            continue
        return True
    return False


@dataclass(frozen=True)
class SteadyMotion:
    """The steady state at a value of a parameter.

    Attributes
    ----------
    kind : BandKind
        Kind with regard to the guide.
    end : Start
        State at the end of the run, after a whole number of periods, as the start of another run; the scene's own
        start where there is no steady state.
    reason : str
        Why there is no steady state.
    """

    kind: BandKind
    end: Start = field(default_factory=dict)
    reason: str = ""


@dataclass(frozen=True)
class ReferenceProbe:
    """Runs of the reference, each at one value of a parameter from one start.

    Attributes
    ----------
    scene : Scene
        The mechanism.
    variation : Variation
        Parameter and guide.
    rtol : float
        Relative tolerance of the runs.
    """

    scene: Scene
    variation: Variation
    rtol: float

    def kind(self, value: float) -> BandKind:
        """Return the kind of the steady state that is reached from the scene's own start."""
        return self.motion(value).kind

    def motion(self, value: float, start: Start = OWN_START) -> SteadyMotion:
        """Return the steady state at a value, reached from a start."""
        reason = ""
        try:
            scene = vary(self.scene, {self.variation.parameter: value, **start})
            first = usual_end(scene)
            duration, elapsed = first, 0.0
            while duration <= LONGEST * first:
                window = self._window(scene, duration)
                try:
                    kind = _kind_in(window, f"{self.variation.joint}.mode")
                    return SteadyMotion(kind, _state_at_end(window))
                except NotSettled as error:
                    reason = str(error)
                # A motion that has not settled is followed until its time has doubled: from its last
                # state, where loads and drives begin anew there, else from the start again.
                if _begins_anew(scene):
                    elapsed += duration
                    duration = elapsed
                    scene = vary(scene, _state_at_end(window))
                else:
                    duration *= 2
        except StictionError as error:
            return SteadyMotion(BandKind.UNKNOWN, reason=" ".join(str(error).split()))
        return SteadyMotion(BandKind.UNSETTLED, reason=reason)

    def _window(self, scene: Scene, end: float) -> SteadyWindow:
        """Return the window of a run; that it is steady is not yet known."""
        measures = [measure_of(f"stick-fraction:{self.variation.joint}")]
        return steady_window(scene, SteadyRun(end / 3, end, self.rtol), measures)


def usual_end(scene: Scene) -> float:
    """Return the end of a run in which most motions settle, s: twice the scene's own, and a whole number of periods."""
    period = _period(scene)
    if not isfinite(period):
        return 2 * scene.t_end
    return period * max(FIRST_PERIODS, ceil(2 * scene.t_end / period))


def _period(scene: Scene) -> float:
    """Return the common period of loads and drives, s; inf if they are constant, nan if there is none."""
    try:
        return excitation_period(scene)
    except NoCommonPeriod:
        return np.nan


def _begins_anew(scene: Scene) -> bool:
    """Return True if all laws have the same values again after each period, whole turns aside.

    A drive that changes a distance at a constant rate goes on: its value at the end of a run is not that at the start.
    """
    goes_on = any(
        isinstance(drive.law, Linear) and drive.law.rate and drive.type == "distance"
        for drive in scene.drives.values()
    )
    return isfinite(_period(scene)) and not goes_on


def _kind_in(window: SteadyWindow, mode: str) -> BandKind:
    """Return the kind of a window; raises NotSettled where the motion has no steady state."""
    run = window.run
    modes = {int(run.columns[mode][-1])}
    for event in run.events:
        modes |= {int(event.before[mode]), int(event.after[mode])}
    if modes == {0}:
        return BandKind.REST
    return BandKind.STICK if 0 in modes else BandKind.SLIP


def _state_at_end(window: SteadyWindow) -> Start:
    """Return positions and velocities at the end of a window, as values of a scene.

    Whole turns are taken off the angles: drives begin anew at zero.
    """
    columns = window.whole.columns
    start: dict[str, object] = {}
    (x, y, angle), (vx, vy, rate) = BODY_COLUMNS[:2]
    for name, body in window.scene.bodies.items():
        last = {
            label: float(columns[f"{name}.{label}"][-1]) for label in (x, y, angle, vx, vy, rate)
        }
        turns = round((last[angle] - body.angle) / (2 * np.pi))
        start |= {
            f"{name}.position": [last[x], last[y]],
            f"{name}.angle": last[angle] - 2 * np.pi * turns,
            f"{name}.velocity": [last[vx], last[vy]],
            f"{name}.angular_velocity": last[rate],
        }
    return start


@dataclass(frozen=True)
class ReferenceBands:
    """Bands by the reference.

    Attributes
    ----------
    bands : tuple of Band
        They cover the range, for motions from the scene's own start.
    motions : Mapping[float, SteadyMotion]
        The steady state at each value of the grid.
    reason : str
        Why some value has no steady state; of the first such value.
    """

    bands: tuple[Band, ...]
    motions: Mapping[float, SteadyMotion]
    reason: str = ""


def bands_from_own_start(
    scene: Scene,
    variation: Variation,
    width: float | None = None,
    expected_end: ExpectedEnd = no_expected_end,
) -> ReferenceBands:
    """Return the bands of the steady states that are reached from the scene's own start, and their ends.

    Parameters
    ----------
    width : float, optional
        Width to which an end is located, in the unit of the parameter; `END_WIDTH` of the range if not given.
    expected_end : callable, optional
        Where ends may be; see `find_bands`.

    Raises
    ------
    InputError
        If there is no motion at any value.
    """
    coarse = ReferenceProbe(scene, variation, GRID_RTOL)
    fine = ReferenceProbe(scene, variation, END_RTOL)
    searched = variation.searched
    values = searched.values()
    motions = {value: coarse.motion(value) for value in values}
    if all(motion.kind == BandKind.UNKNOWN for motion in motions.values()):
        raise InputError(
            f"{variation.parameter}: found no motion of {scene.name} at any of {len(values)} values; "
            f"at {values[0]:g}: {motions[values[0]].reason}"
        )
    width = width or END_WIDTH * (searched.high - searched.low)
    bands = find_bands(lambda value: motions[value].kind, searched, width, fine.kind, expected_end)

    # The rest of the transient shifts an end, too.
    transient = REPEATS * END_RTOL
    bands = tuple(
        replace(
            band,
            low_uncertainty=_with_transient(band.low, band.low_uncertainty, transient),
            high_uncertainty=_with_transient(band.high, band.high_uncertainty, transient),
        )
        for band in bands
    )
    reasons = [motion.reason for motion in motions.values() if motion.reason]
    return ReferenceBands(bands, motions, reasons[0] if reasons else "")


def bands_of_reference(
    scene: Scene, variation: Variation, expected_end: ExpectedEnd = no_expected_end
) -> ReferenceBands:
    """Return the bands of a scene, and where other starts lead to other kinds of steady states.

    Besides the scene's own start at each value of the grid, the motion is continued from the steady state of the value
    below, upwards through the range, and from that of the value above, downwards: where two steady states coexist, each
    is followed as far as it goes. `expected_end` is described at `find_bands`.

    Raises
    ------
    InputError
        If there is no motion at any value.
    """
    own = bands_from_own_start(scene, variation, expected_end=expected_end)
    probe = ReferenceProbe(scene, variation, GRID_RTOL)
    values = list(own.motions)
    seen = _continued(probe, values, own.motions) + _continued(probe, values[::-1], own.motions)
    return replace(own, bands=with_coexisting(own.bands, seen))


def _with_transient(end: float, uncertainty: float, part: float) -> float:
    """Return the uncertainty of an end with a part of it added; zero for an end of the range."""
    return uncertainty + part * abs(end) if uncertainty else 0.0


def _continued(
    probe: ReferenceProbe, values: Iterable[float], own: Mapping[float, SteadyMotion]
) -> list[tuple[float, BandKind]]:
    """Return each value with the kind of the steady state that is reached from that of the value before."""
    seen = []
    before = SteadyMotion(BandKind.UNKNOWN)
    for value in values:
        # From no steady state nothing is continued: the scene's own start is taken.
        before = probe.motion(value, before.end) if before.end else own[value]
        seen.append((value, before.kind))
    return seen
