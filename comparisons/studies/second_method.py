"""The check of a truth that is our own run: a second method computes the motion again.

The second method is `stiction.truths.enumerated_motion`. It shares no code with the reference: it tries
every contact mode of all guides, with the equations of `stiction.truths.dense_equations`. It is slow,
does not cover every mechanism, and is therefore no truth.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.bench.presentation import Column, Presentation, row_of, view
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison
from stiction.comparisons.bench.study import Scope, Study, Tables
from stiction.comparisons.measures.accuracy import size_of
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines.isolation import Outcome, Task
from stiction.engines.status import Status
from stiction.scenes import InputError, Scene
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fidelity import Fidelity
from stiction.truths import Tier, Truth
from stiction.truths.enumerated_motion import simulate

MAX_GUIDES = 3
"""Largest number of guides with friction.

Each guide has twelve combinations of slip and corner signs and four at rest, so that a step of the
second method takes sixteen times longer with each further guide.
"""
EVENT_KINDS = ("stick", "slip", "reversal")
"""Kinds of events that are compared; corner events depend on conventions where a corner is unloaded."""
POSITION = "position_error"
"""Column: largest difference of a coordinate of a centre of mass between the two methods, m."""
UNCERTAINTY = "position_uncertainty"
"""Column: uncertainty of the positions of our own run, m."""
EVENT_TIME = "event_time_error"
"""Column: largest difference of the times of corresponding events, s."""
EVENTS = "checked_events"
"""Column: number of events of our own run."""
END = "checked_until"
"""Column: end of the motion by the second method, s."""
AGREES = "agrees"
"""Column: whether both methods have the same events, and positions within `SAME`."""
SAME = 1e-6
"""Difference of positions, relative to the size of the mechanism, up to which two motions are the same.

Tolerances of both methods are 1e-11 and less. Events may make a motion sensitive, but a wrong contact mode
moves a mechanism by far more.
"""


@dataclass(frozen=True)
class SecondMotion:
    """The motion of a scene by the second method.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Ends of its steps, s.
    q : ndarray, shape (n, 3 bodies)
        Position (m) and angle (rad) of each body, in the order of the scene.
    events : tuple of (str, str, float)
        Guide, kind and time (s) of each event.
    breakdown : str
        Why the motion ends early; empty if it does not, or if the mechanism is at rest from then on.
    """

    t: np.ndarray
    q: np.ndarray
    events: tuple[tuple[str, str, float], ...]
    breakdown: str


def second_motion(scene: Scene) -> SecondMotion:
    """Return the motion of a scene by the second method; InputError for a guide that locks itself."""
    try:
        motion = simulate(scene, scene.t_end)
    except ValueError as error:
        raise InputError(f"{scene.name}: the second method does not apply: {error}") from error
    events = tuple((event.joint, event.kind, event.time) for event in motion.events)
    breakdown = "" if motion.breakdown is None else motion.breakdown.reason
    return SecondMotion(motion.t, motion.q, events, breakdown)


def check_scene(scene: Scene) -> None:
    """Raise InputError for a scene to which the second method does not apply."""
    guides = len(scene.frictional_guides)
    if guides == 0:
        raise InputError(
            f"{scene.name}: no guide with friction; the second method is for those, and there is nothing to decide"
        )
    if guides > MAX_GUIDES:
        raise InputError(
            f"{scene.name}: {guides} guides with friction; the second method tries all their contact modes, and "
            f"is too slow for more than {MAX_GUIDES}"
        )


def reason_against(scope: Scope) -> str:
    """Return why no scene of a scope is checked; empty for the paper's cases, which have an independent truth."""
    if scope.is_of_paper:
        return ""
    try:
        for scene in scope.scenes:
            check_scene(scene)
    except InputError as error:
        return str(error)
    return ""


def plan(scope: Scope) -> Comparison[Tables] | None:
    """Plan the second motion of each scene; None for the paper's cases."""
    if scope.is_of_paper:
        return None
    tasks = [Task(f"second-method/{scene.name}", second_motion, (scene,)) for scene in scope.scenes]

    def tabulate(outcomes: Sequence[Outcome]) -> Tables:
        rows = [_row(scene, outcome) for scene, outcome in zip(scope.scenes, outcomes, strict=True)]
        return Tables({"second-method": pd.DataFrame(rows)})

    return Comparison(tuple(tasks), tabulate)


def _row(scene: Scene, outcome: Outcome) -> dict[str, object]:
    """Return the row of a scene: the differences of the second motion from its truth."""
    row: dict[str, object] = {
        "scene": scene.name,
        "status": str(outcome.status),
        "reason": outcome.reason,
    }
    if outcome.status != Status.OK:
        return row
    # The second method solves the equations of ideal joints, too.
    truth = ground_truth(scene, fidelity=Fidelity.JOINT)
    row |= {"truth": truth.scene, "truth_tier": str(truth.tier)}
    if truth.tier == Tier.NONE:
        return row | {"reason": truth.note}
    return row | differences(scene, outcome.value, truth)


def differences(scene: Scene, motion: SecondMotion, truth: Truth) -> dict[str, object]:
    """Return the columns that compare a second motion with a truth.

    The difference of events is missing if the two motions have different events.
    """
    columns = [f"{body}.{name}" for body in scene.bodies for name in BODY_COLUMNS[0]]
    of_truth = truth(motion.t)
    size = max(
        float(np.max(np.abs(of_truth[column] - values)))
        for column, values in zip(columns, motion.q.T, strict=True)
        if not column.endswith(".angle")
    )
    uncertainty = max(truth.uncertainty[c] for c in columns if not c.endswith(".angle"))
    end = float(motion.t[-1])
    # The truth has no events after the end of the second motion that could be compared.
    rounding = truth.uncertainty.get("event time", 0.0)
    own = _ordered(
        (event.joint, event.kind, event.time)
        for event in truth.events
        if event.time <= end + rounding
    )
    other = _ordered(motion.events)
    reason = motion.breakdown
    event_difference = None
    if [event[:2] for event in own] == [event[:2] for event in other]:
        gaps = [abs(one[2] - another[2]) for one, another in zip(own, other)]
        event_difference = max(gaps, default=0.0)
    else:
        reason = reason or f"different events: {_counts(own)} of our own run, {_counts(other)} here"
    return {
        AGREES: event_difference is not None and size <= SAME * size_of(scene),
        POSITION: size,
        UNCERTAINTY: uncertainty,
        EVENTS: len(own),
        EVENT_TIME: event_difference,
        END: end,
        "reason": reason,
    }


def _ordered(events: Iterable[tuple[str, str, float]]) -> list[tuple[str, str, float]]:
    """Return the events of `EVENT_KINDS`, sorted by guide and time."""
    return sorted(
        ((joint, kind, time) for joint, kind, time in events if kind in EVENT_KINDS),
        key=lambda event: (event[0], event[2]),
    )


def _counts(events: Sequence[tuple[str, str, float]]) -> str:
    """Return the numbers of events by kind as text: ``3 stick, 2 slip``."""
    numbers = Counter(kind for _, kind, _ in events)
    return ", ".join(f"{numbers[kind]} {kind}" for kind in EVENT_KINDS if numbers[kind]) or "none"


def present(results: Results) -> Presentation:
    """Present how far our own run and the second method differ in each scene."""
    table = results.table("second-method")
    if table.empty:
        return Presentation()
    compared = table.index[table[POSITION].notna()] if POSITION in table else []
    rows = {
        "compared": [row_of("second-method", table, label) for label in compared],
        "failed": [
            {"scene": row["scene"], "reason": row["reason"]}
            for label, row in table.iterrows()
            if label not in compared
        ],
    }
    tables = []
    if len(compared):
        columns = (
            Column("scene"),
            Column("truth_tier", "compared with"),
            Column(AGREES),
            Column(POSITION, "difference of positions"),
            Column(EVENTS),
            Column(EVENT_TIME, "difference of their times"),
            Column(END),
            Column("reason"),
        )
        tables.append(view("second-method", table.loc[compared], columns))
    return Presentation(rows=rows, tables=tables)


STUDY = Study(
    "second-method",
    "Second method",
    "Does a second, independent method give the same motion?",
    present,
    plan,
    seconds=2.0,
    takes=frozenset({"scenes"}),
    applies=reason_against,
    tables={
        "second-method": "Motions by a second method",
    },
)
