"""Random mechanisms of no freedom: joints and drives determine all accelerations, and frictional guides slip.

The second method knows all forces that obey Coulomb's law in the motion that the drives prescribe, by trying all signs of all
corner forces (`dense_mechanics.Dense.driven_solutions`). Expected of a run, at every row and on both sides of every event:

- one solution: the run has it;
- several: the columns that differ are nan, and `Trajectory.alternatives` has exactly these solutions;
- none: the run has ended before, with a reason; it has not ended where there still is one.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from fuzz.dense_mechanics import (
    SINGULAR,
    Dense,
    Dice,
    NotAssembled,
    add_loads,
    assembled,
    pin,
    place_of,
    rod,
    slider_on,
    tables,
)
from stiction.scenes import InputError, Scene, Trajectory, scene_from_dict
from stiction.scenes.laws import evaluate_law

T_END = 0.4
ROWS = 24
FORCES = 1e-7
"""Error of a force, relative to the largest of its solution."""
ROUNDING = 1e-13
"""Of a dense solve, times its condition number."""
AHEAD = 0.01
"""Part of a run within which a singular position lies that it may end before: forces and accelerations grow without bound."""
UNLOADED = 1e-4
"""Part of the largest force of a run that counts as a load."""
GIVEN_UP = ("ray", "pivot limit", "sign cycle")
"""Ends of solvers that may find no solution where there is one; never of ``solver="automatic"`` or ``"enumeration"``."""
MOST_COMPARED = 8
"""Alternatives that the reference keeps (`open_forces.MOST_ALTERNATIVES`)."""


def law_of_drive(dice: Dice, size: float) -> dict:
    """A law of a drive around zero; `assembled` shifts it."""
    kind = dice.random.integers(3)
    if kind == 0:
        return {"type": "linear", "rate": dice.one_of([-1, 1]) * dice.number(0.1, 2) * size}
    if kind == 1:
        return {
            "type": "sine",
            "amplitude": dice.number(0.2, 1) * size,
            "frequency": dice.number(1, 8),
            "phase": dice.number(0, 6),
        }
    times = np.cumsum(dice.random.uniform(0.05, 0.25, 6)) - 0.15
    return {
        "type": "table",
        "times": times.tolist(),
        "values": (0.6 * size * dice.random.uniform(-1, 1, 6)).tolist(),
        "interpolation": "cubic",
    }


def strut(dice: Dice, raw: dict, most: float) -> None:
    """A block on a guide, moved by a strut of driven length."""
    slider_on(
        dice,
        raw,
        "block",
        "ground",
        dice.number(-3, 3),
        0.0,
        dice.number(-1, 1),
        dice.friction(most),
    )
    own = dice.point(0.05) if dice.chance() else [0.0, 0.0]
    anchor = place_of(raw, "block", own) + dice.number(0.3, 1.2) * np.array(dice.unit())
    raw["drives"]["strut"] = {
        "type": "distance",
        "bodies": ["block", "ground"],
        "points": [own, anchor.tolist()],
        "law": law_of_drive(dice, 0.1) | {},
    }


def slider_crank(dice: Dice, raw: dict, most: float) -> None:
    """A slider-crank with an offset, driven at its crank or at its slider."""
    r, along = dice.number(0.1, 0.4), dice.number(-3, 3)
    length, phi = dice.number(1.1, 3) * r, dice.number(-3, 3)
    slider_on(dice, raw, "slider", "ground", along, 0.0, dice.number(-1, 1), dice.friction(most))
    own = dice.point(0.04) if dice.chance() else [0.0, 0.0]
    end = place_of(raw, "slider", own)
    joint = end + length * np.array([np.cos(phi), np.sin(phi)])
    base = joint + r * np.array(dice.unit())
    raw["bodies"]["crank"] = dice.body((joint + base) / 2, np.arctan2(*(joint - base)[::-1]))
    raw["joints"]["base"] = pin("crank", "ground", [-r / 2, 0], base)
    rod(dice, raw, "rod", (("slider", own, end), ("crank", [r / 2, 0], joint)))
    if dice.chance(0.75):
        raw["drives"]["motor"] = {
            "type": "angle",
            "bodies": ["crank", "ground"],
            "law": law_of_drive(dice, 1.0),
        }
    else:
        raw["drives"]["ram"] = {
            "type": "distance",
            "bodies": ["slider", "ground"],
            "axis": [float(np.cos(along)), float(np.sin(along))],
            "law": law_of_drive(dice, 0.1),
        }


def trammel(dice: Dice, raw: dict, most: float) -> None:
    """A rod between two sliders on guides at an angle, driven at one slider or at the rod."""
    first = dice.number(-3, 3)
    angle = first + dice.number(0.4, 2.7)
    for name, along in (("one", first), ("two", angle)):
        slider_on(
            dice,
            raw,
            name,
            "ground",
            along,
            dice.number(-0.6, 0.6),
            dice.number(-1, 1),
            dice.friction(most),
        )
    rod(
        dice,
        raw,
        "rod",
        tuple((name, [0.0, 0.0], place_of(raw, name, [0, 0])) for name in ("one", "two")),
    )
    if dice.chance():
        raw["drives"]["motor"] = {
            "type": "angle",
            "bodies": ["rod", "ground"],
            "law": law_of_drive(dice, 1.0),
        }
    else:
        raw["drives"]["ram"] = {
            "type": "distance",
            "bodies": ["one", "ground"],
            "axis": [float(np.cos(first)), float(np.sin(first))],
            "law": law_of_drive(dice, 0.15),
        }


def quick_return(dice: Dice, raw: dict, most: float) -> None:
    """A slider on a rocking arm, pinned to a driven crank."""
    base, pivot, r = (
        np.array(dice.point(0.1)),
        np.array([0.0, -dice.number(0.3, 0.8)]),
        dice.number(0.1, 0.25),
    )
    phi = dice.number(-3, 3)
    joint = base + r * np.array([np.cos(phi), np.sin(phi)])
    raw["bodies"]["crank"] = dice.body(base, phi)
    raw["joints"]["base"] = pin("crank", "ground", [0, 0], base)
    arm = np.arctan2(*(joint - pivot)[::-1])
    raw["bodies"]["arm"] = dice.body(pivot, arm)
    raw["joints"]["pivot"] = pin("arm", "ground", [0, 0], pivot)
    angle = dice.number(-1, 1)
    raw["bodies"]["slider"] = dice.body(joint, arm + angle)
    raw["joints"]["guide-slider"] = {
        "type": "translational",
        "slider": "slider",
        "guide": "arm",
        "angle": angle,
        **dice.friction(most),
    }
    raw["joints"]["pin"] = pin("slider", "crank", [0, 0], [r, 0])
    raw["drives"]["motor"] = {
        "type": "angle",
        "bodies": ["crank", "ground"],
        "law": law_of_drive(dice, 1.0),
    }


def wedge(dice: Dice, raw: dict, most: float) -> None:
    """A wedge that is driven along the ground, and lifts a slider on its slope, which a plunger's guide holds."""
    slider_on(dice, raw, "wedge", "ground", 0.0, 0.0, 0.0, dice.friction(most))
    slope = dice.number(0.1, 1.4)
    slider_on(dice, raw, "foot", "wedge", slope, dice.number(-0.2, 0.2), 0.0, dice.friction(most))
    raw["joints"]["guide-foot"]["slider_point"] = [0.0, 0.0]
    place = place_of(raw, "wedge", np.array(raw["joints"]["guide-foot"]["point"]))
    raw["bodies"]["foot"] |= {"position": place.tolist(), "angle": 0.0}
    upright = np.pi / 2 + dice.number(-0.4, 0.4)
    raw["bodies"]["plunger"] = dice.body(place)
    raw["joints"]["guide-plunger"] = {
        "type": "translational",
        "slider": "plunger",
        "direction": [float(np.cos(upright)), float(np.sin(upright))],
        "point": place.tolist(),
        **dice.friction(most),
    }
    raw["joints"]["pin"] = pin("plunger", "foot", [0, 0], [0, 0])
    if dice.chance():
        raw["drives"]["ram"] = {
            "type": "distance",
            "bodies": ["wedge", "ground"],
            "axis": [1.0, 0.0],
            "law": law_of_drive(dice, 0.1),
        }
    else:
        raw["drives"]["ram"] = {
            "type": "distance",
            "bodies": ["plunger", "ground"],
            "axis": raw["joints"]["guide-plunger"]["direction"],
            "law": law_of_drive(dice, 0.1),
        }


def driven_arm(dice: Dice, raw: dict, most: float) -> None:
    """An arm that a motor turns, and a slider that a ram moves along it."""
    raw["bodies"]["arm"] = dice.body([0, 0], dice.number(-3, 3))
    raw["joints"]["pivot"] = pin("arm", "ground", [0, 0], [0, 0])
    along = dice.number(-3, 3)
    slider_on(
        dice,
        raw,
        "slider",
        "arm",
        along,
        dice.number(-0.3, 0.3),
        dice.number(-1, 1),
        dice.friction(most),
    )
    raw["drives"]["motor"] = {
        "type": "angle",
        "bodies": ["arm", "ground"],
        "law": law_of_drive(dice, 2.0),
    }
    if dice.chance():
        raw["drives"]["ram"] = {
            "type": "distance",
            "bodies": ["slider", "arm"],
            "axis": [float(np.cos(along)), float(np.sin(along))],
            "law": law_of_drive(dice, 0.2),
        }
    else:
        anchor = np.array(raw["joints"]["guide-slider"]["point"]) + dice.number(0.5, 1) * np.array(
            dice.unit()
        )
        raw["drives"]["ram"] = {
            "type": "distance",
            "bodies": ["slider", "arm"],
            "points": [[0, 0], anchor.tolist()],
            "law": law_of_drive(dice, 0.1),
        }


def dwells(scene: Scene) -> Scene:
    """The scene with all its drives holding what they are at the start, and its bodies at rest."""
    raw = {
        **scene._raw,
        "drives": {
            name: {
                **drive,
                "law": {"type": "constant", "value": evaluate_law(scene.drives[name].law, 0.0)[0]},
            }
            for name, drive in scene._raw["drives"].items()
        },
    }
    raw["bodies"] = {
        name: {**body, "velocity": [0.0, 0.0], "angular_velocity": 0.0}
        for name, body in raw["bodies"].items()
    }
    return scene_from_dict(raw, scene.name)


FAMILIES = (strut, slider_crank, trammel, quick_return, wedge, driven_arm)


def draw(seed: int, index: int) -> tuple[str, Scene]:
    """The scene of a seed and an index, and the name of its family."""
    dice = Dice(1, seed, index)
    while True:
        family = dice.one_of(FAMILIES)
        raw = tables(dice, T_END)
        family(dice, raw, dice.one_of([0.3, 0.8, 1.5]))
        add_loads(dice, raw, 20.0)
        for drive in raw["drives"].values():
            if drive["type"] == "distance" and "axis" not in drive:
                _keep_positive(drive)
        try:
            scene = assembled(raw)
        except (NotAssembled, InputError):
            continue
        terms = Dense(scene).equations.at(0.0, *Dense(scene).equations.start())
        sized = terms.J / np.linalg.norm(terms.J, axis=1)[:, None]
        if np.linalg.cond(sized) < 1e3:  # not in a singular position of its own
            return family.__name__, scene


def draw_with_dry_pins(seed: int, index: int) -> Scene:
    """A driven slider-crank of a seed and an index, with mu in its guide and constant bounds in some of its pins.

    The guide has a constant bound beside mu now and then.
    """
    dice = Dice(48, seed, index)
    while True:
        raw = tables(dice, T_END)
        slider_crank(dice, raw, dice.one_of([0.3, 0.8, 1.5]))
        add_loads(dice, raw, 20.0)
        pins = [joint for joint in raw["joints"].values() if joint["type"] == "revolute"]
        dry = [joint for joint in pins if dice.chance(0.7)] or pins
        for joint in dry:
            joint["friction"] = dice.number(0.05, 2.0)
        guide = raw["joints"]["guide-slider"]
        if dice.chance(0.3):
            guide["friction"] = dice.number(0.2, 5.0)
        try:
            scene = assembled(raw)
        except (NotAssembled, InputError):
            continue
        terms = Dense(scene).equations.at(0.0, *Dense(scene).equations.start())
        sized = terms.J / np.linalg.norm(terms.J, axis=1)[:, None]
        if np.linalg.cond(sized) < 1e3:  # not in a singular position of its own
            return scene


def _keep_positive(drive: dict) -> None:
    """A first law of the distance that the loader accepts; it is shifted to the distance of the start."""
    law = drive["law"]
    if law["type"] == "table":
        law["values"] = [value + 5.0 for value in law["values"]]
    else:
        law["offset"] = 5.0


def check(scene: Scene, run: Trajectory) -> tuple[list[str], Counter]:
    """What a run has wrong, and how many rows had one solution, several, none, or were undecided."""
    dense, wrong, met = Dense(scene), [], Counter()
    if not len(run.t) or not run.columns:
        met["empty"] += 1
        return (_start(dense, run) if run.breakdown else ["no rows and no breakdown"]), met
    stopped_at_once = run.breakdown is not None and run.breakdown.time == 0.0
    q, v = dense.states(run)
    force = dense.forces(run)
    scales = float(np.max(np.abs(v))), float(np.nanmax(np.abs(force), initial=0.0))
    if not stopped_at_once:
        for i, t in enumerate(run.t):
            slip = np.array([run[f"{guide.name}.mode"][i] for guide in dense.guides], dtype=int)
            alternatives = {name: values[i] for name, values in run.alternatives.items()}
            wrong += [
                f"row {i}, t = {t:.6g}: {word}"
                for word in _row(dense, t, q[i], v[i], slip, force[i], alternatives, met, scales)
            ]
    for event in run.events:
        for side in ("before", "after"):
            values = getattr(event, side)
            slip = np.array([values[f"{guide.name}.mode"] for guide in dense.guides], dtype=int)
            wrong += [
                f"{event.kind} at {event.time:.6g}, {side}: {word}"
                for word in _row(
                    dense,
                    event.time,
                    *dense.states(values),
                    slip,
                    dense.forces(values),
                    None,
                    met,
                    scales,
                )
            ]
    if run.breakdown is not None:
        wrong += _end(dense, run, met)
    return wrong, met


def _row(
    dense: Dense,
    t: float,
    q: np.ndarray,
    v: np.ndarray,
    slip: np.ndarray,
    force: np.ndarray,
    alternatives: dict[str, np.ndarray] | None,
    met: Counter,
    scales: tuple[float, float],
) -> list[str]:
    """What is wrong with the forces of an instant; `scales`: the largest speed and force of the run."""
    terms = dense.equations.at(t, q, v)
    speed = terms.slip_speed
    if not np.isfinite(terms.gamma).all() or np.linalg.cond(terms.J) > 1e8:
        met["singular position"] += 1
        return []
    known = np.abs(speed) > max(
        1e-7 * scales[0], 1e-12
    )  # elsewhere a sign is that of the side of a reversal
    if np.any(slip[known] != np.sign(speed[known])):
        return [f"modes {slip.tolist()} against the slip speeds {speed.tolist()}"]
    if np.any(slip == 0):
        met["at rest"] += 1
        if np.any(slip != 0):
            return []
        # drives hold all guides: they share the load with the frictions, and nothing tells how
        expected = dense.open_columns(terms, list(range(len(slip))))
        nans = {name for name, value in zip(dense.columns, force) if np.isnan(value)}
        return (
            [f"at rest nan in {sorted(nans)}, expected in {sorted(expected)}"]
            if nans != expected
            else []
        )
    if np.nanmax(np.abs(force), initial=0.0) < 1e-9 * scales[1]:
        met["without load"] += 1  # all forces pass zero: signs are rounding
        return []
    certain, possible, decided = dense.driven_solutions(terms, slip)
    if not decided and len(possible) == 1 and len(certain) == 0:
        certain = possible  # a corner force that is zero, as of a guide without load: the forces are known all the same
    elif not decided:
        met["undecided"] += 1
        return []
    met[f"{len(certain)} solutions"] += 1
    if not certain:
        return [f"no forces obey Coulomb's law, and the run has {force.tolist()}"]
    every = np.array(certain)
    size = max(np.max(np.abs(every)), UNLOADED * scales[1])
    spread = np.ptp(every, axis=0)
    differs, alike = spread > 1e-5 * size, spread < 1e-7 * size
    found = []
    if np.any(np.isnan(force) & alike) or np.any(~np.isnan(force) & differs):
        nans = [name for name, value in zip(dense.columns, force) if np.isnan(value)]
        expected = [name for name, value in zip(dense.columns, differs) if value]
        found.append(f"{len(certain)} solutions; nan in {nans}, expected in {expected}")
    tolerance = FORCES * size
    settled = ~np.isnan(force)
    if settled.any() and not np.min(
        np.max(np.abs(every - force)[:, settled], axis=1)
    ) <= tolerance + np.max(spread[settled]):
        found.append(
            f"forces off by {np.min(np.max(np.abs(every - force)[:, settled], axis=1)) / size:.2g} of {size:.3g} N"
        )
    if alternatives is not None and len(certain) <= MOST_COMPARED:
        for k, name in enumerate(dense.columns):
            listed = alternatives.get(name, np.array([np.nan]))
            listed = listed[~np.isnan(listed)]
            if (
                alike[k]
                and len(listed)
                or differs[k]
                and not _same_set(listed, every[:, k], 1e-6 * size)
            ):
                found.append(
                    f"alternatives of {name}: {listed.tolist()}, expected {every[:, k].tolist() if differs[k] else 'none'}"
                )
    return found


def _start(dense: Dense, run: Trajectory) -> list[str]:
    """A run without any row has no forces at its start, or several with different frictions, or all guides at rest."""
    terms = dense.equations.at(0.0, *dense.equations.start())
    slip = np.sign(terms.slip_speed).astype(int)
    if not np.all(slip) or not np.linalg.cond(terms.J) < SINGULAR:
        return []
    certain, _, decided = dense.driven_solutions(terms, slip)
    if len(certain) == 1 and decided and run.breakdown.kind not in GIVEN_UP:
        return [f"ended at once ({run.breakdown}); there is one solution"]
    return []


def _same_set(listed: np.ndarray, expected: np.ndarray, tolerance: float) -> bool:
    return (
        len(listed) == len(expected)
        and np.max(np.abs(np.sort(listed) - np.sort(expected)), initial=0.0) <= tolerance
    )


def _end(dense: Dense, run: Trajectory, met: Counter) -> list[str]:
    """A run that ends before its time does so where the solution that it was on is no more."""
    stop = run.breakdown
    met[f"ended: {stop.kind}"] += 1
    q, _ = (part[-1] for part in dense.states(run))
    step = run.settings.get(
        "dt", 1e-5 * dense.scene.t_end
    )  # of a fixed step a stage ahead has none
    counts = []
    try:
        # follow the kinematics from the last row to the end of the run, and a little beyond
        times = np.linspace(run.t[-1], stop.time + step, 20)
        for t in times:
            q, v = dense.kinematic(t, q)
        terms = dense.equations.at(stop.time + step, q, v)
        if stop.kind in ("crawl", "not finite", "step too small", "singular"):
            start = dense.equations.at(0.0, *dense.equations.start()).J
            ahead, beyond = q, np.linalg.cond(terms.J)
            for t in stop.time + step + np.linspace(0.0, AHEAD * dense.scene.t_end, 20):
                ahead, _ = dense.kinematic(t, ahead)
                beyond = max(beyond, np.linalg.cond(dense.equations.at(t, ahead, 0 * ahead).J))
            if beyond > 30 * np.linalg.cond(start):
                met["end in a singular position"] += 1
                return []
        slip = np.sign(terms.slip_speed).astype(int)
        certain, possible, decided = dense.driven_solutions(terms, slip)
        counts = [len(certain), decided]
    except np.linalg.LinAlgError:
        met["end in a singular position"] += 1
        return []
    met[f"beyond the end: {counts[0]} solutions"] += 1
    if stop.kind in GIVEN_UP:
        return []
    if counts[0] and counts[1]:
        return [
            f"ended ({stop.kind}: {stop.reason[:60]}) at {stop.time:.6g} s; {counts[0]} solutions just beyond"
        ]
    return []
