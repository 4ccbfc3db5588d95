"""What every trajectory must be before anybody measures it: whole, finite, in order, of the scene that was asked for, and of one piece.

An engine is code of others, and what it returns is not believed: a trajectory that is none, or not of this scene, would be measured as if it
were a motion. The gate says nothing about whether the motion is right; that is what the comparisons are for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.engines.coherence import contradictions
from stiction.scenes import Breakdown, Cost, Event, Scene, Trajectory
from stiction.scenes.wording import names

if TYPE_CHECKING:
    from stiction.reference_impl.multibody.mechanism import Mechanism

START = 1e-6
"""How far a run may begin from the scene's start, relative to the mechanism's size (velocities: to size per second or the largest speed at
the start). Scene files are met to 1e-9 (`stiction.reference_impl.multibody.initial_state.CONSISTENT`); engines that compute in single precision (eps = 6e-8) round
what they are given."""
DRIFT = 1e-6
"""Relative accuracy to which an engine must know the residuals of its own states, and, times the mechanism's size (velocities: as for START), absolute."""
ROUNDING = 1e-9
"""Of times, relative to the end of the run: sums of 1e6 steps are off by 1e6 eps = 2e-10."""
OWN_STEP = 0.01
"""Part of a run up to which a step that the engine has chosen itself excuses an end that is not the one asked for."""
GAP = 2.0
"""Output steps between instants at most: an engine takes the nearest multiple of its step, which is less than twice what was asked for."""
KINDS = ("slip", "stick", "reversal", "corner")
_STATE = (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
_SHOWN = 4


def required_columns(scene: Scene) -> list[str]:
    """The columns that every trajectory of a scene has, whoever made it: all of `stiction.scenes.Trajectory` but ``mode``.

    ``mode`` is left to engines that have contact modes.
    """
    columns = [f"{body}.{label}" for body in scene.bodies for labels in _STATE for label in labels]
    for name in scene.joints:
        if (guide := scene.guides.get(name)) is None:
            columns += [f"{name}.fx", f"{name}.fy"]
            continue
        columns += [f"{name}.{label}" for label in ("normal_force", "moment", "displacement", "slip_velocity")]
        columns += [f"{name}.friction"] if guide.frictional else []
        if guide.length is not None:
            columns += [f"{name}.F{corner}" for corner in (1, 2, 3, 4)]
            columns += [f"{name}.friction_lower", f"{name}.friction_upper"] if guide.frictional else []
    return [*columns, *(f"{name}.effort" for name in scene.drives), "drift.position", "drift.velocity"]


def problems(found: Any, scene: Scene, *, t_end: float, dt: float | None, output_step: float,
             fidelity: str, locates_events: Callable[[Mapping[str, Any]], bool], keeps_cone: Callable[[Mapping[str, Any]], bool]) -> Iterator[str]:
    """What keeps something from being a trajectory of this run, in words that go on from "the engine returned"; nothing if it is one.

    Take the first alone: what is looked at later relies on what was found in order before.

    - It is a `Trajectory` with fields of their types, of this scene and fidelity.
    - Times are finite, begin at 0, increase, and reach `t_end` unless `termination` says why they do not; then there may be none. They are no
      further apart than two output steps: a motion is not judged by its end alone.
    - There are the `required_columns`, and every column has one finite number per time. Forces may be nan where the motion and the other
      frictions leave them open (`recover_columns` says where), and with accelerations at the start of a run whose breakdown is there.
    - It starts in the scene's start where that meets the constraints, else on them (with an engine that assembles).
    - The residuals that it reports are those of its states, and do not exceed the size of the mechanism: what does is not this mechanism
      any more.
    - Events are finite, in order, within the time of the run, and of guides of the scene. The residuals of both sides are those of their states at the time of the event: a
      drive's constraint has time in it, so that values of a neighbouring sample are noticed.
    - Its columns and events do not contradict each other; see `coherence.contradictions`.

    Parameters
    ----------
    found
        What `Engine.run` returned.
    t_end, dt, output_step, fidelity
        As they were asked for. The run may end a step before or after `t_end`: dt, or where none was asked for ``settings["dt"]`` up to
        `OWN_STEP` of the run.
    locates_events, keeps_cone
        Those of `Engine` at this fidelity, by the settings of the trajectory.
    """
    if not isinstance(found, Trajectory):
        yield f"{_shown(found)}; expected a stiction.scenes.Trajectory"
        return
    yield from _fields(found, scene, fidelity)
    own = found.settings.get("dt")
    step = dt if dt is not None else own if _number(own) and 0 < own <= OWN_STEP * t_end * (1 + ROUNDING) else 0.0
    slack = step + ROUNDING * t_end
    yield from _times(found, t_end, slack, GAP * max(output_step, step) + ROUNDING * t_end)
    parts = _parts(scene) if len(found.t) or found.events else []
    yield from _columns(found, scene, parts)
    if len(found.t):
        yield from _motion(found, scene, parts)
    yield from _events(found, scene, t_end + slack)
    yield from _sides(found, scene, parts)
    if len(found.t) and not _stopped_at_once(found):
        yield from contradictions(found, scene, parts, locates_events(found.settings), keeps_cone(found.settings))


def _stopped_at_once(found: Trajectory) -> bool:
    """Whether there is no motion from the start: its state is known, and accelerations and forces are not."""
    return found.breakdown is not None and len(found.t) == 1 and found.breakdown.time == found.t[0]


def _fields(found: Trajectory, scene: Scene, fidelity: str) -> Iterator[str]:
    for name, expected in (("scene", scene.name), ("fidelity", fidelity)):
        if getattr(found, name) != expected:
            yield f"{name} {_shown(getattr(found, name))}; expected {expected!r}"
    for name, kind, words in (("engine", str, "text"), ("version", str, "text"), ("settings", Mapping, "a mapping"), ("cost", Cost, "a stiction.scenes.Cost"),
                              ("columns", Mapping, "a mapping of arrays by name"), ("events", tuple, "a tuple of stiction.scenes.Event")):
        if not isinstance(getattr(found, name), kind):
            yield f"{name} {_shown(getattr(found, name))}; expected {words}"
    if not (isinstance(found.termination, str) and found.termination.strip()):
        yield f"termination {_shown(found.termination)}; expected 'end' or why it stopped"
    seconds = (found.cost.setup_s, found.cost.compile_s, found.cost.stepping_s, found.cost.own_s)
    if not (all(_number(value) and value >= 0 for value in seconds) and isinstance(found.cost.counters, Mapping)
            and all(_number(value) for value in found.cost.counters.values())):
        yield f"cost {_shown(found.cost)}; expected seconds >= 0 and finite counters"


def _times(found: Trajectory, t_end: float, slack: float, widest: float) -> Iterator[str]:
    stop = found.breakdown
    if stop is not None and not (isinstance(stop, Breakdown) and _number(stop.time) and -slack <= stop.time <= t_end + slack):
        yield f"breakdown {_shown(stop)}; expected a stiction.scenes.Breakdown within 0 .. {t_end:g} s"
    elif stop is not None and found.termination == "end":
        yield f"a breakdown ({_shown(stop.reason)}) and the termination 'end'; expected one of them"
    t = found.t
    if not isinstance(t, np.ndarray) or t.dtype.kind not in "fiu" or t.ndim != 1:
        yield f"times {_shown(t)}; expected a one-dimensional array of numbers"
    if not len(t):
        if found.termination == "end":
            yield "no instant at all; expected times from 0 to t_end, or a termination that says why there is no motion"
        return
    if not np.isfinite(t).all():
        yield f"a time that is not finite, t[{int(np.argmin(np.isfinite(t)))}]; expected seconds"
    if abs(t[0]) > ROUNDING * t_end:
        yield f"times that begin at {t[0]:g} s; expected 0"
    if (disorder := np.flatnonzero(np.diff(t.astype(float)) <= 0)).size:
        i = int(disorder[0])
        yield f"times that do not increase: {t[i]:.9g} s, then {t[i + 1]:.9g} s"
    if len(t) > 1 and (gap := float(np.max(np.diff(t.astype(float))))) > widest:
        yield f"times {gap:.9g} s apart; expected {widest:.9g} s at most, two of the output steps asked for"
    if t[-1] > t_end + slack:
        yield f"times up to {t[-1]:.9g} s; expected t_end = {t_end:.9g} s at most"
    if found.termination == "end" and t[-1] < t_end - slack:
        yield f"times up to {t[-1]:.9g} s without a word why; expected t_end = {t_end:.9g} s, or a termination that says why it stopped"


def _columns(found: Trajectory, scene: Scene, parts: Collection[Mechanism]) -> Iterator[str]:
    if missing := [name for name in required_columns(scene) if name not in found.columns]:
        yield f"no column {names(missing[:_SHOWN])}{f' and {len(missing) - _SHOWN} others' if len(missing) > _SHOWN else ''}; expected all columns " \
              "that the scene calls for (stiction.reference_impl.multibody.reactions.recover_columns makes them from states)"
    stopped_at_once = _stopped_at_once(found)
    known = {f"{body}.{label}" for body in scene.bodies for labels in _STATE[:2] for label in labels} | {"drift.position", "drift.velocity"}
    unknown = {}
    for name, values in found.columns.items():
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiub" or values.shape != found.t.shape:
            shape = f"an array of {values.dtype}, shape {values.shape}" if isinstance(values, np.ndarray) else _shown(values)
            yield f"column {name}: {shape}; expected numbers of shape {found.t.shape}, one per time"
        elif not (finite := np.isfinite(values)).all() and not (stopped_at_once and name not in known):
            unknown[name] = ~finite
    left_open = _left_open(found, parts) if unknown else {}
    for name, bad in unknown.items():
        if (wrong := np.flatnonzero(bad & ~left_open.get(name, False))).size:
            i = int(wrong[0])
            yield f"column {name}: {found[name][i]} at t = {found.t[i]:.9g} s; expected finite numbers, or nan in forces that the motion leaves open"


def _left_open(found: Trajectory, parts: Collection[Mechanism]) -> dict[str, np.ndarray]:
    """By column the instants at which its force is nan, and the motion and the frictions that are not nan leave it open."""
    from stiction.reference_impl.multibody.reactions import recover_columns

    left_open: dict[str, np.ndarray] = {}
    for part in parts:
        motion = [np.stack([found[f"{body}.{label}"] for body in part.body_names for label in labels], axis=1) for labels in _STATE]
        frictions = {f"{name}.friction": found[f"{name}.friction"] for name in part.guide_names}
        if any(np.isinf(values).any() for values in frictions.values()) or not all(np.isfinite(values).all() for values in motion):
            continue
        recovered = recover_columns(part.scene, found.t, *motion, frictions)
        left_open |= {name: np.isnan(values) & np.isnan(found[name]) for name, values in recovered.items()}
    return left_open


def _motion(found: Trajectory, scene: Scene, parts: Collection[Mechanism]) -> Iterator[str]:
    """The start, and residuals of the constraints as the states have them."""
    from stiction.reference_impl.multibody.initial_state import CONSISTENT  # imported here: what refuses a scene, or lists engines, needs no kernels

    size = max(part.arrays.length_scale for part in parts)
    q, v = (np.stack([found[name] for name in names_of], axis=1).astype(float) for names_of in _states(scene))
    starts = {body: state for part in parts for body, *state in zip(part.body_names, *(values.reshape(-1, 3) for values in part.initial_state()))}
    start_q, start_v = (np.concatenate([starts[body][k] for body in scene.bodies]) for k in range(2))
    speed = max(size, float(np.max(np.abs(start_v))))
    limits = (START * size, START * speed)
    residuals = _residuals(scene, parts, found.t.astype(float), q, v)
    [position], [velocity] = _residuals(scene, parts, np.zeros(1), start_q[None], start_v[None])
    if position <= CONSISTENT * size and velocity <= CONSISTENT * speed:
        for values, start, labels, limit in ((q[0], start_q, _STATE[0], limits[0]), (v[0], start_v, _STATE[1], limits[1])):
            if (wrong := np.flatnonzero(~(np.abs(values - start) <= limit))).size:
                i = int(wrong[0])
                yield f"a start that is not the scene's: {list(scene.bodies)[i // 3]}.{labels[i % 3]} = {values[i]:.9g}; expected " \
                      f"{start[i]:.9g} within {limit:.1g}"
    if (lost := np.flatnonzero(~(residuals[0] <= size))).size and scene.joints | scene.drives:
        i = int(lost[0])
        yield f"states that have left the mechanism: {residuals[0][i]:.3g} m off the constraints at t = {found.t[i]:.9g} s; expected less than " \
              f"its size, {size:.3g} m"
    for name, residual, limit, scale, unit in zip(("drift.position", "drift.velocity"), residuals, limits, (size, speed), ("m", "m/s")):
        if not residual[0] <= limit:
            yield f"a start that is {residual[0]:.3g} {unit} off the constraints; expected at most {limit:.1g}"
        if (wrong := np.flatnonzero(~_agrees(found[name], residual, scale))).size:
            i = int(wrong[0])
            yield f"{name} = {found[name][i]:.6g} at t = {found.t[i]:.9g} s; expected {residual[i]:.6g}, the residual of its states"


def _parts(scene: Scene) -> list[Mechanism]:
    """The mechanisms that a scene consists of; a whole of many parts may be too large."""
    from stiction.reference_impl.multibody.mechanism import Mechanism
    from stiction.reference_impl.multibody.subsystems import independent_parts

    return [Mechanism(part, stabilization="none") for part in independent_parts(scene)]


def _states(scene: Scene) -> tuple[list[str], list[str]]:
    """Columns of all positions and of all velocities."""
    position, velocity = ([f"{body}.{label}" for body in scene.bodies for label in labels] for labels in _STATE[:2])
    return position, velocity


def _residuals(scene: Scene, parts: Collection[Mechanism], t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Norms of Phi and Phi' over all parts, shape (2, n)."""
    from stiction.reference_impl.multibody.kinematics import workspace
    from stiction.reference_impl.multibody.trajectory_columns import residual_norms

    place = {body: 3 * i for i, body in enumerate(scene.bodies)}
    columns = [np.concatenate([np.arange(place[body], place[body] + 3) for body in part.body_names]) for part in parts]
    return np.sqrt(sum(np.square(residual_norms(part.arrays, workspace(part.arrays), t, np.ascontiguousarray(q[:, own]),
                                                np.ascontiguousarray(v[:, own]))) for part, own in zip(parts, columns)))


def _agrees(reported: np.ndarray, residual: np.ndarray, scale: float) -> np.ndarray:
    """Whether residuals that were reported are those of the states."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.abs(reported - residual) <= DRIFT * (scale + residual)


def _sides(found: Trajectory, scene: Scene, parts: Collection[Mechanism]) -> Iterator[str]:
    """Residuals of both sides of events, of those that have states and residuals."""
    position, velocity = _states(scene)
    needed = {*position, *velocity, "drift.position", "drift.velocity"}
    sides = [(event, name, side) for event in found.events for name, side in (("before", event.before), ("after", event.after)) if needed <= side.keys()]
    if not sides:
        return
    size = max(part.arrays.length_scale for part in parts)
    t = np.array([event.time for event, *_ in sides], dtype=float)
    q, v = (np.array([[side[name] for name in names_of] for *_, side in sides], dtype=float) for names_of in (position, velocity))
    speed = max(size, float(np.max(np.abs(v))))
    for name, residual, scale in zip(("drift.position", "drift.velocity"), _residuals(scene, parts, t, q, v), (size, speed)):
        reported = np.array([side[name] for *_, side in sides], dtype=float)
        if (wrong := np.flatnonzero(~_agrees(reported, residual, scale))).size:
            i = int(wrong[0])
            event, which, _ = sides[i]
            yield f"{event.kind} of {event.joint} at t = {event.time:.9g} s: {which}, {name} = {reported[i]:.6g}; expected {residual[i]:.6g}, the residual of its states then"


def _events(found: Trajectory, scene: Scene, latest: float) -> Iterator[str]:
    if odd := next((event for event in found.events if not isinstance(event, Event)), None):
        yield f"event {_shown(odd)}; expected a stiction.scenes.Event"
    before = 0.0
    for i, event in enumerate(found.events):
        where = f"event {i}, {event.kind} of {event.joint}"
        if not _number(event.time):
            yield f"{where}: time {_shown(event.time)}; expected finite seconds"
        if not before <= event.time <= latest:
            yield f"{where}: t = {event.time:.9g} s after one at {before:.9g} s; expected events in order within 0 .. {latest:.9g} s"
        before = event.time
        if event.kind not in KINDS or event.joint not in scene.guides:
            yield f"{where}; expected {', '.join(KINDS)} of a guide of the scene"
        for side, values in (("before", event.before), ("after", event.after)):
            if not isinstance(values, Mapping) or values.keys() != event.before.keys():
                yield f"{where}: {side} {_shown(values)}; expected values of the same columns on both sides"
            elif not values.keys() <= found.columns.keys():
                unknown = sorted(map(str, values.keys() - found.columns.keys()))
                yield f"{where}: {side} has {names(unknown[:_SHOWN])}; expected columns of the trajectory"
            elif not _all_numbers(values.values()):
                name = next(name for name, value in values.items() if not _number(value))
                yield f"{where}: {side}, {name} = {_shown(values[name])}; expected finite numbers"


def _all_numbers(values: Collection[Any]) -> bool:
    try:
        return math.isfinite(sum(values)) or all(map(_number, values))  # the sum of finite numbers may overflow, but costs a tenth
    except TypeError:
        return False


def _number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value)


def _shown(value: Any) -> str:
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 60 else text[:57] + '...'}"
