"""Quantities: the label, unit and number format of every column of the tables of results.

A table of results is a DataFrame whose columns are named by keys such as ``position_error`` or
``cpu_time``. When a table is rendered, the keys are looked up here. Computations must not depend on
labels or on parts of keys, so that a label can be changed without changing any number, ranking or
group.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Any

from stiction.engines.status import STATUS_LABELS
from stiction.scenes.columns import unit_of
from stiction.scenes.fidelity import FIDELITY_LABELS
from stiction.truths.truth import TIER_LABELS


class Kind(StrEnum):
    """Kind of a quantity, which determines how its values are written."""

    ERROR = "error"
    """Error, drift, residual or change, of which only the order of magnitude matters; sign
    omitted."""
    UNCERTAINTY = "uncertainty"
    """Bound of the error of another quantity, or half the width of its confidence interval."""
    TIME = "time"
    """Measured CPU or wall time, or a ratio of such times."""
    EXPONENT = "exponent"
    """Order of convergence, or exponent of a power law."""
    JUMP = "jump"
    """Jump; sign omitted."""
    VALUE = "value"
    """Any other real number."""
    EXACT = "exact"
    """Real number known to ten digits, such as the amplitude at a stick threshold."""
    COUNT = "count"
    """Whole number."""
    CATEGORY = "category"
    """Element of a small set of words, such as an engine, a status, or a tier of truths."""
    FLAG = "flag"
    """True or False."""
    TEXT = "text"
    """Any text."""
    INTERVALS = "intervals"
    """Intervals of a real number as a JSON list of pairs (lower end, upper end); empty if there are
    none."""
    JSON = "json"
    """Settings as a JSON object."""


DIGITS: Mapping[Kind, int] = {
    Kind.ERROR: 2,
    Kind.UNCERTAINTY: 2,
    Kind.TIME: 2,
    Kind.EXPONENT: 2,
    Kind.JUMP: 6,
    Kind.VALUE: 6,
    Kind.EXACT: 10,
    Kind.COUNT: 6,
}
"""Significant digits of the numbers of each kind; whole numbers are written with all their
digits."""
NO_WORDS: Mapping[str, str] = MappingProxyType({})
"""Default of `Quantity.words`: the values of the category are written as they are stored."""
NUMERIC = frozenset(DIGITS)
"""Kinds whose values are numbers."""


@dataclass(frozen=True)
class Quantity:
    """The meaning and the format of the values of a column.

    Attributes
    ----------
    key : str
        Name of the column: lower case, words joined by underscores.
    label : str
        Heading, without unit.
    unit : str
        Unit of the stored numbers: SI, except for some times in us and creep in um/s. Empty for
        dimensionless numbers and for words.
    kind : Kind
    uncertainty : str
        Key of the quantity that is the uncertainty of this one; empty if there is none.
    symbol : str
        Symbol in formulas, as LaTeX; empty if there is none.
    description : str
        Explanation for readers of the data; if empty, the label is sufficient.
    words : Mapping
        For a category, the words that are written instead of the stored values.
    """

    key: str
    label: str
    unit: str = ""
    kind: Kind = Kind.VALUE
    uncertainty: str = ""
    symbol: str = ""
    description: str = ""
    words: Mapping[Any, str] = field(default_factory=lambda: NO_WORDS, hash=False)

    @property
    def head(self) -> str:
        """The label, followed by the unit in brackets."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def is_number(self) -> bool:
        """True if the values are numbers."""
        return self.kind in NUMERIC


# The following functions return a quantity of the kind that their names contain. Without a label,
# the words of the key are the label.


def _category(
    key: str, label: str = "", description: str = "", words: Mapping[Any, str] = NO_WORDS
) -> Quantity:
    return Quantity(
        key,
        label or key.replace("_", " "),
        kind=Kind.CATEGORY,
        description=description,
        words=words,
    )


def _text(key: str, label: str = "", description: str = "") -> Quantity:
    return Quantity(key, label or key.replace("_", " "), kind=Kind.TEXT, description=description)


def _flag(key: str, label: str = "", description: str = "") -> Quantity:
    return Quantity(key, label or key.replace("_", " "), kind=Kind.FLAG, description=description)


def _count(key: str, label: str = "", description: str = "") -> Quantity:
    return Quantity(key, label or key.replace("_", " "), kind=Kind.COUNT, description=description)


def _value(
    key: str,
    label: str = "",
    unit: str = "",
    description: str = "",
    uncertainty: str = "",
    symbol: str = "",
) -> Quantity:
    return Quantity(
        key, label or key.replace("_", " "), unit, Kind.VALUE, uncertainty, symbol, description
    )


def _time(key: str, label: str, unit: str = "s", description: str = "") -> Quantity:
    return Quantity(key, label, unit, Kind.TIME, description=description)


def _measured(
    kind: Kind,
    key: str,
    label: str,
    unit: str,
    uncertainty: str,
    noun: str,
    description: str = "",
) -> tuple[Quantity, Quantity]:
    """Return a quantity, and its uncertainty with the key `uncertainty` and the label "uncertainty of `noun`"."""
    return (
        Quantity(key, label, unit, kind, uncertainty, description=description),
        Quantity(uncertainty, f"uncertainty of {noun}", unit, Kind.UNCERTAINTY),
    )


def _error(key: str, label: str, unit: str, description: str = "") -> Quantity:
    return Quantity(key, label, unit, Kind.ERROR, description=description)


RUN = (
    _category("scene"),
    _category("variant", description="an engine with its fidelity and settings"),
    _category("engine"),
    _text("version", "version", "version of the engine"),
    _category(
        "fidelity",
        description="joint: an ideal guide with a friction law; contact: two surfaces",
        words=FIDELITY_LABELS,
    ),
    _category("friction_by", "friction law supplied by"),
    _category("events_by", "events located by"),
    _category(
        "coefficients",
        "coefficients of friction",
        "whether the engine has a static one; else mus = mu",
    ),
    _category("parameter", description="what is refined: dt, rtol or iterations"),
    _value(
        "step",
        "step or tolerance",
        description="value of the parameter: s for dt, no unit for others",
    ),
    _category("status", words=STATUS_LABELS),
    _text("reason", description="why the run failed or ended early"),
    Quantity(
        "settings",
        "settings",
        kind=Kind.JSON,
        description="all settings of the run, as the engine states them",
    ),
    _text("key", "key", "name of the run: scene/variant/parameter=step"),
    _text("trajectory", "file of the trajectory", "relative to the run folder"),
    _text("rerun_command", "command that repeats the run"),
    _text("ladder", "refinement series", "the values of the parameter"),
    _text("method"),
    _text("friction_law"),
    _text("stabilization"),
    _text("iterations"),
    _category("solver", description="of the contact problem, where an engine has several"),
    _text("other_settings"),
)
"""Identity, settings and status of a run."""

TRUTHS = (
    _text("truth", "truth", "name of the truth that the row is compared with"),
    _category("truth_tier", "tier of the truth", words=TIER_LABELS),
    _text("truth_note", "remark on the truth"),
    _category("tier", description="tier of the truth", words=TIER_LABELS),
    _text("column", description="column of a trajectory"),
    Quantity(
        "uncertainty",
        "uncertainty",
        kind=Kind.UNCERTAINTY,
        description="uncertainty of the truth, in the unit of its column",
    ),
    _text("theorem"),
)
"""Truths that results are compared with."""

COST = (
    _time("cpu_time", "CPU time", description="CPU time of all steps, the adapter included"),
    _time("cpu_time_low", "CPU time, lower end of the interval"),
    _time("cpu_time_high", "CPU time, upper end of the interval"),
    _time(
        "engine_time",
        "engine's CPU time",
        description="CPU time inside the engine's own calls, part of cpu_time",
    ),
    _time("engine_time_low", "engine's CPU time, lower end of the interval"),
    _time("engine_time_high", "engine's CPU time, upper end of the interval"),
    _value("interval_level", "probability of the interval"),
    _time("stepping_time", "stepping time"),
    _time("setup_time", "set-up time"),
    _time("setup_cpu_time", "set-up, CPU time"),
    _time("compile_time", "compilation time"),
    _time("compile_cpu_time", "compilation, CPU time"),
    _time("wall_time", "wall time"),
    _count("repeats", description="number of timed samples"),
    _count("round", description="round of timing, from 1"),
    _count("runs"),
    _text("timing", description="what makes the time unsure"),
    _time(
        "kernel_time",
        "calibration kernel",
        description="time of the calibration kernel beside the sample",
    ),
    _value("other_load", "load by others", "cores"),
    _time("relative_time", "least CPU time per calibration kernel", ""),
    Quantity("position_order", "observed order of the position", kind=Kind.EXPONENT),
)
"""Cost of a run."""

ACCURACY = (
    _value("time_covered", "time covered", "s"),
    _value("checked_until", "compared until", "s"),
    _count("checked_events", "events"),
    _flag("agrees", "same motion"),
    *_measured(
        Kind.ERROR,
        "position_error",
        "position error",
        "m",
        "position_uncertainty",
        "the position error",
        "largest over all bodies and output times",
    ),
    *_measured(
        Kind.ERROR,
        "velocity_error",
        "velocity error",
        "m/s",
        "velocity_uncertainty",
        "the velocity error",
        "largest over all bodies and output times",
    ),
    *_measured(
        Kind.ERROR,
        "torque_error",
        "torque error, mean",
        "N m",
        "torque_uncertainty",
        "the torque error",
        "mean of the size of the error over time, largest of all drives",
    ),
    *_measured(
        Kind.ERROR,
        "event_time_error",
        "event time error",
        "s",
        "event_time_uncertainty",
        "the event times",
        "largest over all events that are found",
    ),
    _count("events_matched", "events found"),
    _count("events_missed", "events missed"),
    _count("events_spurious", "spurious events"),
    *(
        _count(f"{kind}_events_missed", f"{kind} events missed")
        for kind in ("slip", "stick", "reversal", "corner")
    ),
    _value("path_length", "path of the bodies", "m"),
)
"""Errors of the motion and of events."""

DRIFT = (
    _error(
        "position_drift",
        "position drift, largest",
        "m, rad",
        "norm of the residuals of all constraints",
    ),
    _error("position_drift_end", "position drift at the end", "m, rad"),
    _error("velocity_drift", "velocity drift, largest", "m/s"),
    _error("velocity_drift_end", "velocity drift at the end", "m/s"),
    _error("position_drift_rms", "position drift, root mean square", "m, rad"),
    _error("position_drift_24s", "position drift up to 24 s, largest", "m, rad"),
    Quantity("drift_uncertainty", "rounding of the drift", "m, rad", Kind.UNCERTAINTY),
    Quantity("drift_rounding", "drift by rounding", "m, rad", Kind.UNCERTAINTY),
    _error("decay_error", "error of the decay to the joints", ""),
    _category("growth", "growth of the drift"),
    *_measured(
        Kind.EXPONENT,
        "growth_exponent",
        "exponent of growth",
        "",
        "growth_exponent_uncertainty",
        "the exponent of growth",
    ),
    _flag("joint_coordinates"),
    _category("choice", description="choice of stabilization"),
    _category("run", description="key of a run"),
    _value("alpha", "alpha", "1/s", symbol=r"\alpha"),
    _value("beta", "beta", "1/s", symbol=r"\beta"),
    _value("time", "time", "s"),
    _value("octave_end", "end of the octave", "s"),
    _error("drift_ratio", "drift, of that without stabilization", ""),
    _error("error_ratio", "error, of that without stabilization", ""),
    *(
        quantity
        for length in (24, 240, 2400)
        for quantity in (
            _category(f"growth_{length}s", f"growth, {length} s"),
            *_measured(
                Kind.EXPONENT,
                f"growth_exponent_{length}s",
                f"exponent of growth, {length} s",
                "",
                f"growth_exponent_uncertainty_{length}s",
                f"the exponent of growth, {length} s",
            ),
            _value(f"walk_spread_{length}s", f"spread, of a random walk's, {length} s"),
        )
    ),
)
"""Drift from the constraints."""

THRESHOLD = (
    _text("varied", "varied parameter"),
    _text("varied_unit", "unit of the varied parameter", "empty if it is a ratio, or not known"),
    Quantity(
        "with_stick",
        "threshold, side with stick",
        "",
        Kind.EXACT,
        description="value of the varied parameter next to the threshold, with a stick phase",
    ),
    Quantity(
        "without_stick",
        "threshold, side without stick",
        "",
        Kind.EXACT,
        description="value of the varied parameter next to the threshold, without a stick phase",
    ),
    *_measured(
        Kind.EXACT,
        "true_threshold",
        "true threshold",
        "",
        "true_threshold_uncertainty",
        "the true threshold",
    ),
    *_measured(
        Kind.ERROR,
        "threshold_error",
        "threshold error",
        "",
        "threshold_uncertainty",
        "the threshold error",
    ),
    Quantity(
        "paper_threshold",
        "the paper's threshold",
        "N",
        Kind.EXACT,
        description="empty: the figure is lost in the text that we have",
    ),
    _error("threshold_change", "change from the coarser step", ""),
    Quantity(
        "sticks_again",
        "sticks again, about",
        "",
        Kind.INTERVALS,
        description="bands above the threshold in which the slider sticks again: pairs of the smallest and "
        "the largest value with stick, as a JSON list",
    ),
    Quantity(
        "stick_bands",
        "sticks",
        "",
        Kind.INTERVALS,
        description="bands in which the slider sticks: pairs of values of the varied parameter, as a JSON list",
    ),
    Quantity(
        "all_bands",
        "bands",
        "",
        Kind.JSON,
        description="all bands within the searched range: a JSON list of lower end, upper end and kind",
    ),
    _value("scanned_to", "searched up to"),
    Quantity("band_low", "from", "", Kind.EXACT),
    Quantity("band_high", "to", "", Kind.EXACT),
    _error("band_low_uncertainty", "uncertainty of the lower end", ""),
    _error("band_high_uncertainty", "uncertainty of the upper end", ""),
    _error("band_low_shift", "lower end, difference from truth", ""),
    _error("band_high_shift", "upper end, difference from truth", ""),
    _category("band_kind", "the slider", description="kind of the steady state"),
    _flag(
        "depends_on_start",
        description="whether another start leads to a steady state of another kind",
    ),
    _text("coexisting", "from other starts", "kinds of steady states that coexist in the band"),
    _value("range_low", "begin of the range"),
    _value("range_high", "end of the range"),
    _value("resolution", "resolution", description="narrower bands may be missed"),
    _value("mu", "mu", description="kinetic coefficient of friction", symbol=r"\mu"),
    _value("mus", "mus", description="static coefficient of friction", symbol=r"\mu_s"),
    Quantity("threshold", "threshold", "", Kind.EXACT),
    _value("window_begin", "begin of the window", "s"),
)
"""Stick bands and thresholds; their numbers have the unit of the varied parameter, `varied_unit`."""

TORQUE = (
    _category("effort", description="the drive whose effort jumps"),
    _text("event"),
    _category("kind"),
    _category("joint"),
    Quantity("event_time", "event time", "s", Kind.EXACT),
    *_measured(
        Kind.JUMP, "true_jump", "true jump", "N m", "true_jump_uncertainty", "the true jump"
    ),
    Quantity("closed_form_jump", "jump in closed form", "N m", Kind.JUMP),
    _flag("resolved", description="whether the jump is read off the run"),
    Quantity("jump", "jump", "N m", Kind.JUMP),
    *_measured(Kind.ERROR, "jump_error", "jump error", "N m", "jump_uncertainty", "the jump error"),
    *_measured(Kind.ERROR, "time_error", "time error", "s", "time_uncertainty", "the time error"),
    _error("jump_bound", "bound of the jump error", "N m"),
    _value("t", "time", "s"),
    _value("effort_value", "effort", "N m"),
)
"""Jumps of the driving torque."""

EFFECTS = (
    _category("effect"),
    _category("effect_kind"),
    _category("effect_left_out"),
    _text("blocks_left_out"),
    _count("hlcp_pairs", "HLCP pairs in slip"),
    *(
        _count(f"{kind}_events", f"{kind} events")
        for kind in ("slip", "stick", "reversal", "corner")
    ),
    _value("first_event", "first event", "s"),
    _value("time_compared", "time compared", "s"),
    _error("position_change", "position change", "m"),
    _error("velocity_change", "velocity change", "m/s"),
    _error("effort_change", "effort change, mean", "N, N m"),
    _value("largest_effort", "largest effort", "N, N m"),
    _time("engine_time_ratio", "engine's CPU time, of the baseline's", ""),
    _time("engine_time_ratio_low", "engine's CPU time, of the baseline's, lower end", ""),
    _time("engine_time_ratio_high", "engine's CPU time, of the baseline's, upper end", ""),
)
"""Changes of the motion and of its cost by single effects of a scene, such as friction."""

EQUAL_ERROR = (
    _category("quantity", description="what the error is of"),
    Quantity(
        "error",
        "error",
        kind=Kind.ERROR,
        uncertainty="uncertainty",
        description="error to reach; of a judged table, error of a column, in the unit of the column",
    ),
    _category("unit"),
    _flag("is_bound", "an upper bound"),
    _error("smallest_error", "smallest error reached", ""),
    _category("because", description="what limits the method"),
    _text("why"),
    *_measured(Kind.EXPONENT, "order", "order", "", "order_uncertainty", "the order"),
)
"""Time to reach a given error, and what limits the error."""

ORDERS = (
    _value("mean_step", "mean step", "s"),
    _count("promised_order", "order of the method"),
    *_measured(
        Kind.EXPONENT,
        "observed_order",
        "observed order",
        "",
        "observed_order_uncertainty",
        "the observed order",
    ),
    _text("why_none", "why there is no order"),
)
"""Observed orders of convergence."""

SETTINGS = (
    _category("subject", description="the method whose setting is changed"),
    _category("setting"),
    _category("changed", "name of the setting"),
    _time("time_of_fastest", "time, of the fastest setting's", ""),
    _time("time_ratio", "time, of the default's", ""),
    _error("largest_error_ratio", "largest error, of the default's", ""),
    _flag("on_front", "on the Pareto front"),
    _flag("better_everywhere"),
    _count("failed_runs"),
)
"""Changes of error and cost by settings of engines."""

HOLD = (
    _category("test"),
    _value("load", "load, of the limit"),
    *_measured(Kind.ERROR, "creep", "creep", "m/s", "creep_uncertainty", "the creep"),
    _value("bound_fraction", "friction, of its bound"),
    _flag("lets_go"),
    _flag("holds"),
    *_measured(
        Kind.ERROR,
        "joint_creep",
        "creep of a joint",
        "",
        "joint_creep_uncertainty",
        "the creep of a joint",
        "in the unit of the column creep_unit",
    ),
    *_measured(
        Kind.ERROR,
        "joint_stop_error",
        "stop error of a joint",
        "",
        "joint_stop_uncertainty",
        "the stop error of a joint",
        "in m for creep in m/s, in rad for creep in rad/s",
    ),
    _category("creep_unit", "unit of the creep"),
    _category("refuses", description="whether the engine does not take the friction of the scene"),
    _error("creep_per_g_dt", "creep, of g dt", ""),
    _error("creep_per_regularization", "creep, of the regularization", ""),
    _error("landing", "landing", "m"),
    *_measured(
        Kind.ERROR,
        "break_away_error",
        "break-away error, of the limit",
        "",
        "break_away_uncertainty",
        "the break-away error",
    ),
    _category("bound", description="sign of a value that is a bound"),
    _error("acceleration_error", "acceleration error, relative", ""),
    *_measured(Kind.ERROR, "stop_error", "stop error", "m", "stop_uncertainty", "the stop error"),
    _error("creep_ratio", "creep, of the default's", ""),
    _count("failed", "failed runs"),
    _category("over", description="setting over which the creep follows a law"),
    _value("law", "law"),
    *_measured(Kind.VALUE, "found", "found", "", "found_uncertainty", "what is found"),
    _category("verdict"),
    _text("source"),
    _value("published_creep", "published creep", "um/s"),
    *_measured(
        Kind.ERROR, "creep_um", "creep here", "um/s", "creep_um_uncertainty", "the creep here"
    ),
    _value("published_joint_creep", "published creep of a joint", "rad/s"),
    *_measured(
        Kind.ERROR,
        "joint_creep_here",
        "speed here",
        "rad/s",
        "joint_creep_here_uncertainty",
        "the speed here",
        "change in the last fifth of the run",
    ),
    _text("published_statement", "the source in words"),
    _flag("moves", "moves, as published or predicted"),
    _text("difference", "difference from the source"),
    _flag("matched"),
    _value("published_load", "published load", "N"),
    _value("load_N", "load", "N"),
    _value("margin"),
)
"""Creep, landing and break-away of a slider that is held by static friction."""

JOINT_FRICTION = (
    *_measured(
        Kind.ERROR,
        "joint_friction_error",
        "error",
        "",
        "joint_friction_error_uncertainty",
        "the error of joint friction",
        "in the unit of the column joint_friction_unit",
    ),
    _category("joint_friction_unit", "unit of the error"),
    Quantity("joint_friction_order", "order", "", Kind.EXPONENT),
)
"""Errors of joints whose friction has a constant bound."""

CLEARANCE = (
    _value("clearance", "clearance", "m", "gap between the centred slider and each surface"),
    _value("restitution", description="Newton's coefficient"),
    _count("perturbed_start", "perturbed start", "0 is the start of the scene"),
    _value("window_end", "end of the window", "s"),
    *_measured(
        Kind.ERROR,
        "slider_change",
        "change of the slider's position",
        "m",
        "slider_change_uncertainty",
        "the change of the slider's position",
        "largest difference of the displacement along the guide from that with ideal joints",
    ),
    *_measured(
        Kind.ERROR,
        "effort_share",
        "change of the effort, mean, of the ideal mean",
        "",
        "effort_share_uncertainty",
        "the mean change of the effort",
        "mean size of the difference from the effort with ideal joints over the mean size of the latter",
    ),
    *_measured(
        Kind.ERROR,
        "effort_rms",
        "change of the effort, rms, of the ideal rms",
        "",
        "effort_rms_uncertainty",
        "the rms change of the effort",
    ),
    *_measured(
        Kind.ERROR,
        "effort_peak",
        "largest effort, of the ideal largest",
        "",
        "effort_peak_uncertainty",
        "the largest effort",
        "of a single step; inversely proportional to the step where impacts are impulses, and then missing",
    ),
    *_measured(
        Kind.ERROR,
        "effort_peak_mean",
        "largest mean effort over 1 ms, of the ideal largest",
        "",
        "effort_peak_mean_uncertainty",
        "the largest mean effort over 1 ms",
    ),
    *_measured(
        Kind.ERROR,
        "flight_share",
        "part of the time without contact",
        "",
        "flight_share_uncertainty",
        "the part of the time without contact",
        "no corner within 2 % of the clearance of its surface",
    ),
    *(
        quantity
        for key, words in (
            ("one_corner_share", "one corner in contact"),
            ("adjacent_share", "two adjacent corners in contact"),
            ("opposite_share", "two opposite corners in contact"),
        )
        for quantity in _measured(
            Kind.ERROR,
            key,
            f"part of the time with {words}",
            "",
            f"{key}_uncertainty",
            f"the part of the time with {words}",
        )
    ),
    *_measured(
        Kind.ERROR,
        "largest_overlap",
        "largest overlap",
        "m",
        "largest_overlap_uncertainty",
        "the largest overlap",
        "depth of a corner in its surface",
    ),
    *_measured(
        Kind.ERROR,
        "impact_count",
        "impacts",
        "",
        "impact_count_uncertainty",
        "the number of impacts",
        "arrivals of corners that were more than 10 % of the clearance away",
    ),
    *_measured(
        Kind.ERROR,
        "impact_speed",
        "speed of impact",
        "m/s",
        "impact_speed_uncertainty",
        "the speed of impact",
        "of a flight its end, of a run the largest one",
    ),
    _text(
        "unresolved", "not resolved", "numbers that change by more than 25 % by the last halving"
    ),
    _value("effect_limit", "limit of the change of the effort"),
    _flag("has_drive", description="whether the scene has a drive, whose effort is compared"),
    _error("limit_clearance", "clearance at the limit", "m"),
    _error("limit_clearance_low", "clearance at the limit, lower end", "m"),
    _error("limit_clearance_high", "clearance at the limit, upper end", "m"),
    *(
        quantity
        for key, words in (
            ("effort_exponent", "the change of the effort"),
            ("slider_exponent", "the change of the position"),
            ("flight_time_exponent", "the flight time"),
            ("impact_speed_exponent", "the speed of impact"),
        )
        for quantity in _measured(
            Kind.EXPONENT,
            key,
            f"exponent of {words}",
            "",
            f"{key}_uncertainty",
            f"the exponent of {words}",
            "over the clearance",
        )
    ),
    _category(
        "release", "release by", "how the force of the end changes its sign with ideal joints"
    ),
    _count("corner", description="number of the corner that leaves its surface"),
    _count("opposite_corner", "to corner", "number of the corner that hits"),
    _value("effective_mass", "effective mass", "kg"),
    _error("crowding", "crowding", "", "flight time over the time to the nearest other event"),
    _error("mobilization", "mobilization", "", "friction at the corner that holds, of its bound"),
    _value("predicted_flight_time", "predicted flight time", "s"),
    _value("predicted_impact_speed", "predicted speed of impact", "m/s"),
    _value("flight_time", "flight time", "s"),
    _value("flight_time_ratio", "flight time, predicted over measured"),
    _value("impact_speed_ratio", "speed of impact, predicted over measured"),
    _count("flights", "flights", "isolated flights that are fitted"),
    _error("largest_time_deviation", "largest deviation of the flight time", ""),
    _error("largest_speed_deviation", "largest deviation of the speed of impact", ""),
    _value("time_after_release", "time after the release", "s"),
    _value("ideal_effort", "effort with ideal joints", "N, N m"),
)
"""Changes of a motion by clearance in its guides, and flights of corners through the gap."""

HARD = (
    _category("topic"),
    _category("case"),
    _category("must", "expected"),
    _text("about"),
    _value("size"),
    _value("limit"),
)
"""Checks of scenes that are difficult to solve."""

CLAIMS = (
    _text("claim"),
    _text("figure", "figure behind it"),
    _category("margin_kind", "what the margin is"),
    _value("run_needed", "length of the run that is needed", "s"),
    _value("step_needed", "step that is needed", "s"),
    _text("place", description="where the paper says it"),
    _text("study_runs", "runs of the study"),
    *(
        _value(f"margin_{part}", f"margin, {words}")
        for part, words in (
            ("truth_from_start", "truth from the start"),
            ("truth_steady", "truth in the steady state"),
            ("run_from_start", "HLCP from the start"),
            ("run_last_period", "HLCP in the last period"),
        )
    ),
    _text("claims_that_change"),
    _text("numbers_that_change"),
    *(
        quantity
        for case in (1, 2, 3)
        for quantity in (
            _value(f"stick_time_case_{case}", f"stick time per period, case {case}", "s"),
            _value(f"largest_corner_force_case_{case}", f"largest F_i, case {case}", "N"),
            _value(f"largest_moment_case_{case}", f"largest moment, case {case}", "N m"),
        )
    ),
    Quantity("threshold_on_F0", "threshold on F0", "N", Kind.EXACT),
)
"""Statements of the paper, and the margins by which they hold."""

JUDGE = (
    _category("measure", description="how the error of a column is measured"),
    _text("hint"),
    _value(
        "factor", "values, of the truth's", description="with the hint: 1000 for mm in place of m"
    ),
    _flag(
        "is_input", "read in another way", "whether a unit, a sign or an origin seems to be another"
    ),
    _flag("has_unit_option", "read in another unit"),
    _value("error_time", "time of the error", "s"),
    _category("guide"),
    _value("begin", "begin", "s"),
    _value("duration", "duration", "s"),
    _count("samples"),
    _value("fastest_slip", "fastest slip", "m/s"),
    _value("table_begin", "begin of the table", "s"),
    _value("table_end", "end of the table", "s"),
    _value("t_end", "end of the scene", "s"),
    _value("sample_distance", "distance of the samples", "s"),
    _count("two_sided_instants", "instants with two sides"),
    *_measured(
        Kind.ERROR,
        "energy_error",
        "energy not accounted for",
        "J",
        "energy_uncertainty",
        "the energy not accounted for",
    ),
    _value("energy_exchanged", "energy exchanged", "J"),
    *_measured(
        Kind.ERROR,
        "completed_energy_error",
        "energy of the completed motion not accounted for",
        "J",
        "completed_energy_uncertainty",
        "the energy of the completed motion not accounted for",
    ),
    _value("completed_energy_exchanged", "energy exchanged by the completed motion", "J"),
)
"""Judgement of a table of results that a user supplies."""

BENCHMARK = (
    _text("title"),
    _value("mechanism_size", "size of the mechanism", "m"),
    _value("position_bound", "bound of the position error", "m"),
    _value("effort_bound", "bound of the mean error of efforts", "N m"),
    _value(
        "rest_speed",
        "speed of rest",
        "m/s",
        description="below it a joint is at rest; of pins in rad/s",
    ),
    _value("max_step", "largest distance of rows", "s"),
    Quantity(
        "uncertainty_between_rows",
        "uncertainty between rows",
        kind=Kind.UNCERTAINTY,
        description="what interpolation between rows adds to the uncertainty, in the same unit",
    ),
    _text("error_column", "column of the error"),
    _count("stick_phases", "stick phases"),
    _count("stick_found", "stick phases found"),
    _count("stick_missed", "stick phases missed"),
    _count("stick_unresolved", "stick phases too short for the samples"),
    _count("stick_invented", "stick phases invented"),
    _count("jumps", "jumps of efforts"),
    _count("jumps_read", "jumps that the table shows"),
    _text("off_columns", "columns in another unit or sign"),
    _value("off_factor", "their values, of the truth's"),
    _category("off_unit", "unit of the truth there"),
    _category("other_parameter", "parameter with which the table agrees"),
    _value("other_value", "its value"),
    _text("explanations", description="all parameters with which the errors vanish"),
    _text("unknown_columns", "columns of the table that the scene does not have"),
    _value("widest_gap", "longest time between rows", "s"),
)
"""The scenes of the friction benchmark, and the judgement of a submission."""

REPLAY = (
    _category("class"),
    _time("median_time", "median time", "us"),
    _error("largest_residual", "largest residual", ""),
)
"""Results of solvers for stored complementarity problems."""

QUANTITIES: Mapping[str, Quantity] = {
    quantity.key: quantity
    for quantity in (
        *RUN,
        *TRUTHS,
        *COST,
        *ACCURACY,
        *DRIFT,
        *THRESHOLD,
        *TORQUE,
        *EFFECTS,
        *EQUAL_ERROR,
        *ORDERS,
        *SETTINGS,
        *HOLD,
        *JOINT_FRICTION,
        *CLEARANCE,
        *HARD,
        *CLAIMS,
        *JUDGE,
        *BENCHMARK,
        *REPLAY,
    )
}
"""All quantities, by key."""


FAMILIES: Mapping[str, Quantity] = {
    quantity.key: quantity
    for quantity in (
        _value("end", "{} at the end"),
        _count("events", "events of {}"),
        _value("last_event", "last event of {}", "s"),
        _time("over_older", "{} over that of the older code", ""),
        _count("counter", "{}"),
    )
}
"""Quantities of individual objects, by the first part of their keys, as in ``end:slider.x``."""


def quantity_of(key: str) -> Quantity:
    """Return the quantity with a key; the key is also the label if the quantity is unknown.

    A key of one of the `FAMILIES` is ``family:subject``. The subject is a column of a trajectory, a
    guide with a kind of event, a counter of an engine (`stiction.scenes.Cost`), or another
    quantity.
    """
    if key in QUANTITIES:
        return QUANTITIES[key]
    family_key, _, subject = key.partition(":")
    if not subject or family_key not in FAMILIES:
        return Quantity(key, key)
    family = FAMILIES[family_key]
    noun = QUANTITIES[subject].label if subject in QUANTITIES else subject
    # a family without a unit has the unit of its subject, if this is a column of a trajectory
    unit = family.unit or unit_of(subject)
    return replace(family, key=key, label=family.label.format(noun), unit=unit)
