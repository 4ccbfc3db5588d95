"""Random mechanisms at rest whose frictional guides share the load of fewer freedoms.

Rest is possible while any share of the load lies inside the cones of all guides: while F, the largest least margin over all
shares (`dense_mechanics.Rest`), is positive. The position is the same as long as the mechanism rests, so that F depends
on the loads alone. Expected of a run:

- it rests exactly until F passes zero, and breaks away, or ends with a reason, there;
- its frictions are inside all cones at every row and on both sides of every event;
- masses of rods that no weight acts on have no influence on the shares.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fuzz.dense_mechanics import (
    Dense,
    Dice,
    NotAssembled,
    Rest,
    assembled,
    place_of,
    rod,
    slider_on,
    tables,
)
from stiction.scenes import InputError, Scene, Trajectory, scene_from_dict
from stiction.scenes.laws import law_kinks

T_END = 1.0
ROWS = 40
GRID = 120
INSTANT = 1e-6
"""Of a break-away, s in T_END."""
MARGIN = 1e-7
"""Of a force, relative to the largest."""


def series(dice: Dice, raw: dict, most: float) -> None:
    """Two or three sliders on one line, or on parallel ones, each joined to the next by a rod."""
    along = dice.number(-3, 3)
    direction = np.array([np.cos(along), np.sin(along)])
    count, across = dice.one_of([2, 2, 3]), dice.one_of([0.0, 0.2])
    for k in range(count):
        name = f"s{k}"
        slider_on(dice, raw, name, "ground", along, 0.0, dice.number(-1, 1), dice.friction(most))
        guide = raw["joints"][f"guide-{name}"]
        guide["point"] = (
            0.5 * k * direction
            + across * dice.number(-1, 1) * np.array([-direction[1], direction[0]])
        ).tolist()
        guide["slider_point"] = [0.0, 0.0]
        raw["bodies"][name]["position"] = guide["point"]
    for k in range(count - 1):
        pins = [dice.point(0.05) if dice.chance(0.3) else [0.0, 0.0] for _ in range(2)]
        rod(
            dice,
            raw,
            f"rod-{k}",
            tuple((f"s{k + j}", at, place_of(raw, f"s{k + j}", at)) for j, at in enumerate(pins)),
        )


def trammel(dice: Dice, raw: dict, most: float) -> None:
    """A plate, or a rod, that is pinned to sliders on two guides at an angle."""
    first = dice.number(-3, 3)
    for name, along in (("s0", first), ("s1", first + dice.number(0.4, 2.7))):
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
        "plate",
        tuple((name, [0.0, 0.0], place_of(raw, name, [0, 0])) for name in ("s0", "s1")),
    )


def stack(dice: Dice, raw: dict, most: float) -> None:
    """A slider on a slider: two guides, two freedoms."""
    slider_on(
        dice, raw, "s0", "ground", dice.number(-3, 3), 0.0, dice.number(-1, 1), dice.friction(most)
    )
    slider_on(
        dice, raw, "s1", "s0", dice.number(-3, 3), 0.2, dice.number(-1, 1), dice.friction(most)
    )


def add_dyad(dice: Dice, raw: dict, most: float, name: str) -> None:
    """One more slider, on the ground or on a body, and a rod to another body: one more guide, and no freedom."""
    bodies = [body for body in raw["bodies"] if raw["bodies"][body]["mass"]]
    host = dice.one_of(["ground", "ground", *bodies])
    slider_on(
        dice,
        raw,
        name,
        host,
        dice.number(-3, 3),
        dice.number(-0.6, 0.6),
        dice.number(-1, 1),
        dice.friction(most),
    )
    goal = dice.one_of([body for body in [*bodies, "ground"] if body != host])
    at = dice.point(0.2) if goal != "ground" else dice.point(1.0)
    rod(
        dice,
        raw,
        f"rod-{name}",
        ((name, [0.0, 0.0], place_of(raw, name, [0, 0])), (goal, at, place_of(raw, goal, at))),
    )


def draw(seed: int, index: int) -> tuple[str, Scene]:
    """The scene of a seed and an index, at rest at the start by its velocities, and the name of its family."""
    dice = Dice(4, seed, index)
    while True:
        base = dice.one_of([series, trammel, trammel, stack])
        most = dice.one_of([0.3, 0.8, 1.2])
        raw = tables(dice, T_END)
        base(dice, raw, most)
        guides = len([name for name in raw["joints"] if name.startswith("guide")])
        name = base.__name__
        if guides < 3 and (base is stack or dice.chance(0.4)):
            add_dyad(dice, raw, most, "s2")
            name += " and dyad"
        size = dice.number(2, 30)
        for body in raw["bodies"]:
            if dice.chance(0.5) or "gravity" not in raw:
                # a guide without any load hides the others
                raw["forces"][f"load-{body}"] = {
                    "type": "force",
                    "body": body,
                    "point": dice.point(0.1),
                    "direction": dice.unit(),
                    "law": dice.load(size),
                }
        if dice.chance(0.3):
            raw["springs"]["spring"] = {
                "type": "linear",
                "bodies": ["s0", "ground"],
                "points": [[0, 0], dice.point(1)],
                "stiffness": dice.number(1, 60),
                "damping": dice.number(0, 1),
                "rest_length": dice.number(0, 0.5),
            }
        try:
            scene = assembled(raw)
        except (NotAssembled, InputError):
            continue
        dense = Dense(scene)
        terms = dense.equations.at(0.0, *dense.equations.start())
        sized = terms.J / np.linalg.norm(terms.J, axis=1)[:, None]
        if np.linalg.svd(sized, compute_uv=False)[-1] < 1e-2:
            continue
        if any(
            np.linalg.norm(row - np.linalg.lstsq(terms.J.T, row, rcond=None)[0] @ terms.J) < 1e-3
            for row in terms.W
        ):
            continue  # a guide that the joints lock holds no freedom
        # all freedoms are held by guides, and in more ways than one
        rest = Rest(dense, dense.equations.start()[0])
        values = np.linalg.svd(rest.acts / np.linalg.norm(rest.acts, axis=0), compute_uv=False)
        if values[-1] > 1e-2 and rest.null.shape[1] in (1, 2):
            return name, scene


def first_loss(dense: Dense, rest: Rest) -> tuple[float, float]:
    """The first instant at which F falls below zero (inf: never; nan: F is zero for longer), and the size of the forces, N.

    F is zero for longer where a guide has no load at all: it hides when others lose theirs.

    F is searched between the kinks of the loads on a grid; where it dips near zero, its minimum is looked for.
    """
    kinks = {0.0, T_END}
    for load in dense.scene.forces.values():
        kinks |= set(law_kinks(load.law, T_END))
    t = np.unique(np.concatenate([np.linspace(0.0, T_END, GRID), sorted(kinks)]))
    F = np.array([rest.largest_least_margin(time) for time in t])
    size = max(np.max(np.abs(rest.load(time)[0])) for time in t[::10]) + 1e-300
    if np.sum(np.abs(F) < 1e-9 * size) > 2:
        return np.nan, size
    if F[0] < 0:
        return 0.0, size
    below = np.flatnonzero(F < 0)
    last = below[0] if len(below) else len(t) - 1
    for i in range(1, last):
        steps = F[i - 1] - F[i], F[i + 1] - F[i]
        if steps[0] >= 0 and steps[1] >= 0 and F[i] < 3 * max(steps):
            dip = minimize_scalar(
                rest.largest_least_margin,
                bounds=(t[i - 1], t[i + 1]),
                method="bounded",
                options={"xatol": 1e-9},
            )
            if dip.fun < 0:
                return brentq(rest.largest_least_margin, t[i - 1], dip.x, xtol=1e-13), size
    if not len(below):
        return np.inf, size
    return brentq(rest.largest_least_margin, t[last - 1], t[last], xtol=1e-13), size


def check(scene: Scene, run: Trajectory) -> tuple[list[str], str]:
    """What a run has wrong, and how its rest ends."""
    dense = Dense(scene)
    q, _ = dense.equations.start()
    rest = Rest(dense, q)
    found = []
    grows = rest.grows()
    if grows and not rest.fixed:
        expected, size = (
            np.inf,
            max(np.max(np.abs(rest.load(t)[0])) for t in np.linspace(0, T_END, 30)) + 1e-300,
        )
    elif grows:
        return cones(dense, run), "not compared"
    else:
        expected, size = first_loss(dense, rest)
    if np.isnan(expected):
        return cones(dense, run), "unloaded"
    left = [event.time for event in run.events if event.kind == "slip"]
    if len(run.t) and any(run[f"{guide.name}.mode"][0] for guide in dense.guides):
        left = [0.0]
    if run.breakdown is not None:
        left.append(run.breakdown.time)
    ended = min(left, default=np.inf)
    if run.breakdown is not None and ended == run.breakdown.time and ended < expected:
        # rest is possible: the law must allow a motion, too
        motions = beginning_motions(dense, q, ended)
        if not (run.breakdown.kind == "several solutions" and motions):
            found.append(
                f"ended at {ended:.9g} s, {run.termination[:60]}; rest is possible up to {expected:.9g} s, and {motions} motions"
            )
    elif ended != expected and not abs(ended - expected) <= INSTANT * T_END:
        # a margin that grazes zero has no instant: then it must be zero, but for the error of forces, at both
        between = np.linspace(min(ended, expected), min(max(ended, expected), T_END), 60)
        worst = np.inf if grows else max(abs(rest.largest_least_margin(t)) for t in between)
        if not worst <= MARGIN * size:
            how = f"; {run.termination[:50]}" if run.breakdown else ""
            found.append(
                f"rest ends at {ended:.9g} s{how}; expected {expected:.9g} s; F in between up to {worst:.3g} of {size:.3g} N"
            )
    found += cones(dense, run)
    kind = "all rest" if expected == np.inf else "at once" if expected == 0.0 else "breaks away"
    return found, kind + (f", {run.breakdown.kind}" if run.breakdown else "")


def beginning_motions(dense: Dense, q: np.ndarray, t: float) -> int:
    """Number of contact modes in which guides at rest begin to slip by Coulomb's law, with the static coefficient.

    Each guide rests, or slips either way; signs of corner forces are tried. Modes whose guides at rest share a load
    have singular equations and are left aside.
    """
    terms, mass, found = dense.equations.at(t, q, np.zeros_like(q)), dense.equations.mass, 0
    rows, count = terms.J.shape[0], len(dense.guides)
    choices = [
        [
            (0, 1, 1),
            *(
                (d, s1, s2)
                for d in (1, -1)
                for s1 in (1, -1)
                for s2 in ((1, -1) if guide.length else (1,))
            ),
        ]
        for guide in dense.guides
    ]
    for mode in product(*choices):
        resting = [g for g in range(count) if mode[g][0] == 0]
        if len(resting) == count:
            continue
        held = np.concatenate([terms.J, terms.W[resting]])
        acts = held.copy()
        for g, (guide, (d, s1, s2)) in enumerate(zip(dense.guides, mode)):
            if d:
                on_T = -guide.mus * d * (s2 - s1) / guide.length if guide.length else 0.0
                on_R = (
                    -guide.mus * d * ((s1 + s2) / 2 if guide.length else s1)
                    + on_T * guide.width / 2 * guide.mus * d
                )
                acts[guide.row] += on_R * terms.W[g]
                acts[guide.row + 1] += on_T * terms.W[g]
        system = held / mass @ acts.T
        if np.linalg.cond(system) > 1e9:
            continue
        right = -np.concatenate([terms.gamma, terms.w[resting]]) - held @ (terms.QE / mass)
        x = np.linalg.solve(system, right)
        a = (terms.QE + acts.T @ x) / mass
        least, size = np.inf, np.max(np.abs(x)) + 1e-300
        for g, (guide, (d, s1, s2)) in enumerate(zip(dense.guides, mode)):
            R, T = x[guide.row], x[guide.row + 1]
            if d == 0:
                least = min(least, -guide.excess(R, T, x[rows + resting.index(g)]))
                continue
            lever = guide.width / 2 * guide.mus * d * R
            n1, n2 = (
                (R / 2 - (T + lever) / guide.length, R / 2 + (T + lever) / guide.length)
                if guide.length
                else (R, 0.0)
            )
            least = min(
                least,
                s1 * n1,
                s2 * n2 if guide.length else np.inf,
                size if d * (terms.W[g] @ a + terms.w[g]) > 0 else -size,
            )
        found += least >= -1e-7 * size
    return found


def cones(dense: Dense, run: Trajectory) -> list[str]:
    """Where frictions of a run are outside their cones, or not those of slip."""
    found = []
    if run.breakdown is not None and run.breakdown.time == 0.0:
        return found
    force = dense.forces(run)
    size = np.nanmax(np.abs(force), initial=0.0)
    for guide in dense.guides:
        for where, values in [
            ("rows", run),
            *(
                (f"event at {event.time:.6g}", side)
                for event in run.events
                for side in (event.before, event.after)
            ),
        ]:
            R, T, f = (
                np.atleast_1d(values[f"{guide.name}.{label}"])
                for label in ("normal_force", "moment", "friction")
            )
            d = np.atleast_1d(values[f"{guide.name}.mode"])
            beyond = np.where(
                d == 0, guide.excess(R, T, f), np.abs(f - guide.slipping_friction(R, T, d))
            )
            if not np.max(beyond) <= 1e-6 * size:
                found.append(
                    f"{guide.name}, {where}: friction {np.max(beyond):.3g} N outside its cone, of {size:.3g} N"
                )
    return found[:3]


def with_other_rods(scene: Scene, dice: Dice) -> Scene:
    """The scene without weight, with other masses of its rods."""
    raw = {
        **scene._raw,
        "gravity": [0.0, 0.0],
        "bodies": {
            name: {
                **body,
                **(
                    {"mass": dice.number(1e-3, 10), "inertia": dice.number(1e-3, 10)}
                    if name.startswith("rod")
                    else {}
                ),
            }
            for name, body in scene._raw["bodies"].items()
        },
    }
    return scene_from_dict(raw, scene.name)
