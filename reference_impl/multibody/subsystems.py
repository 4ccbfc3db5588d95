"""Parts of a scene that do not act on each other: each is integrated on its own.

Two bodies that share a joint, a drive, a spring or a damper are in one part; the ground connects nothing. A part has
its own steps, events and scales. So it moves to rounding as it would alone, and n of them cost n times as much as one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import Cost, Event, Scene
from stiction.scenes.errors import ELEMENTS
from stiction.scenes.event_values import Sides, rows_of

if TYPE_CHECKING:
    from stiction.reference_impl.integration.result import Run

DRIFT = "drift."


def connected_bodies(scene: Scene, pairs: Iterable[tuple[str, str]]) -> tuple[int, dict[str, int]]:
    """Return the number of groups that no pair connects, and the group of each body, in order."""
    # The smaller of two groups joins the larger one, so that a body moves from group to group at most log2(n) times.
    # scipy's connected_components takes a tenth of a millisecond for two bodies, as long as a short run.
    group = {name: [name] for name in scene.bodies}
    for a, b in pairs:
        if a in group and b in group and group[a] is not group[b]:
            smaller, larger = sorted((group[a], group[b]), key=len)
            larger += smaller
            group.update(dict.fromkeys(smaller, larger))
    number: dict[int, int] = {}
    label = {name: number.setdefault(id(group[name]), len(number)) for name in scene.bodies}
    return len(number), label


def independent_parts(scene: Scene) -> list[Scene]:
    """Return the independent parts of a scene; the scene itself if it is one.

    Each is a scene with the names and the order of the whole.
    """
    count, label = connected_bodies(
        scene,
        (
            element.bodies
            for element in chain(
                scene.joints.values(), scene.drives.values(), scene.springs.values()
            )
        ),
    )
    if count == 1:
        return [scene]
    sections: list[dict[str, dict[str, Any]]] = [
        {section: {} for section in ELEMENTS} for _ in range(count)
    ]
    for section in ELEMENTS:
        for name, element in getattr(scene, section).items():
            touched = (
                (name,)
                if section == "bodies"
                else (element.body,)
                if section == "forces"
                else element.bodies
            )
            part = next(label[body] for body in touched if body in label)
            sections[part][section][name] = element
    parts = []
    for own in sections:
        copied = scene.model_copy(update=own)
        copied._raw = {
            key: {name: value[name] for name in own[key]} if key in own else value
            for key, value in scene._raw.items()
        }
        parts.append(copied)
    return parts


def simulate_parts(
    scene: Scene, parts: Sequence[Mechanism], simulate: Callable[[int, float], Run], t_end: float
) -> Run:
    """Integrate the parts of a scene one after the other and put together what they yield.

    `simulate` is called with the place of a part and the time up to which it is needed: `t_end`, or the earliest time
    at which a part before it broke down. The run has columns by element in the order of the scene, events in order of
    time, and sums of costs and counters. It ends where the first part breaks down. Events have the values of the part
    that they belong to, without ``drift``.
    """
    until, runs = t_end, []
    for i in range(len(parts)):
        run = simulate(i, until)
        until = until if run.breakdown is None else min(until, run.breakdown.time)
        runs.append(run)
    if len(runs) == 1:
        return runs[0]
    broken = [
        run.breakdown for run in runs if run.breakdown is not None and run.breakdown.time <= until
    ]
    rows = min(len(run.t) for run in runs)
    found = {
        name: column[:rows]
        for run in runs
        for name, column in run.columns.items()
        if not name.startswith(DRIFT)
    }
    place = {name: i for i, name in enumerate(chain(scene.bodies, scene.joints, scene.drives))}
    columns = {
        name: found[name] for name in sorted(found, key=lambda name: place[name.partition(".")[0]])
    }
    for name in runs[0].columns:
        if name.startswith(DRIFT):
            columns[name] = np.sqrt(sum(run.columns[name][:rows] ** 2 for run in runs))
    events = _in_order([run.events for run in runs], until)
    switches = _in_order([run.switches for run in runs], until)
    alternatives = {
        name: values[:rows] for run in runs for name, values in run.alternatives.items()
    }
    counters: Counter[str] = Counter()
    for run in runs:
        counters.update(run.cost.counters)
    cost = Cost(
        sum(run.cost.setup_s for run in runs),
        0.0,
        sum(run.cost.stepping_s for run in runs),
        dict(counters),
    )
    return replace(
        runs[0],
        t=runs[0].t[:rows],
        columns=columns,
        events=events,
        switches=switches,
        cost=cost,
        breakdown=broken[0] if broken else None,
        alternatives=alternatives,
    )


def _in_order(events_of_parts: Sequence[Sequence[Event]], until: float) -> tuple[Event, ...]:
    """Return the events of all parts up to a time (s), in order of time."""
    merged = [
        event
        for events in events_of_parts
        for event in _without_drift(events)
        if event.time <= until
    ]
    return tuple(sorted(merged, key=lambda event: event.time))


def _without_drift(events: Sequence[Event]) -> list[Event]:
    """Return the events of a part without the columns of the drift, which is that of all parts."""
    sides = Sides(events)
    columns = {
        name: sides[name]
        for name in (events[0].before if events else ())
        if not name.startswith(DRIFT)
    }
    if not columns:
        return list(events)  # without values
    rows = rows_of(columns)
    return [
        replace(event, before=before, after=after)
        for event, before, after in zip(events, rows[::2], rows[1::2])
    ]
