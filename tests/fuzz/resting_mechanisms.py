"""Random mechanisms of one degree of freedom that friction brings to rest; the reference held to their motion.

Two or three frictional guides: a rod between two sliders; a plate on two sliders, with a rod to a third; a crank that
drives two sliders by rods; a guide on a rocking link, or on another slider. When one guide is held, all are. Every
mechanism is run with each stabilization and compared with `enumerated_motion.simulate`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count, product
from typing import Any

import numpy as np
from random_mechanisms import SeededDice

from fuzz.scene_outcomes import SceneOutcome, event_differences
from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import Scene, Trajectory, scene_from_dict
from stiction.scenes.columns import BODY_COLUMNS
from stiction.scenes.fields import GROUND
from stiction.scenes.trajectory import stacked
from stiction.truths.dense_equations import Terms
from stiction.truths.enumerated_motion import CORNERS, Contact, Instant, Motion, simulate

STABILIZATIONS = ("none", "baumgarte", "projection")
RTOLS = (1e-6, 1e-8, 1e-10, 1e-12)
TOLERANCE = 1e-12
"""Tolerance of a step of the independent motion."""
CLOSEST = 1e-6
"""Seconds between two switches below which a mechanism is not drawn: errors may exchange them."""
CLEAR_OF_JAMMING = 0.2
"""Determinant of the equations for friction; 1 without friction, 0 where a motion is not unique (Painleve)."""
CLEAR_OF_SINGULAR = 0.05
"""Smallest singular value of the constraints' Jacobian with rows of length 1: forces magnified twentyfold at most."""
CLEAR_OF_LIMIT = 1e-3
"""Distance from the limit of static friction, relative to the largest load: a million times the error."""
AT_REST_BEFORE = 1e-9
"""Speed, relative to the largest, below which a mechanism is at rest at an event: what errors leave of one."""
CLEAR_OF_GRAZING = 0.1
"""Rate (1/s) at which a slip, relative to the largest, passes zero: slower ones magnify errors tenfold and more."""
LONGEST = 5.0
"""Seconds within which a drawn mechanism is at rest."""
RESERVE = 1e3
"""Error of a run over rtol, relative to the size: a hundred steps, magnified by ten."""
OWN_ERROR = 1e-9
"""The same of the independent motion, whose steps have 1e-12."""
AT_REST = 1e-11
"""m/s: rounding of the motion at rest. Forces in balance leave accelerations of 1e-15 of 10 m/s^2, a hundred times that
with unlike masses and levers; ten seconds at rest add them up. A guide that slips has another mode."""


class Draft:
    """Tables of a scene, put together from points and directions in ground axes, which are complex numbers."""

    def __init__(self, dice: SeededDice):
        down, mu = dice.number(0, 2 * np.pi), dice.number(0.04, 0.3)
        self.dice, self.sliders = dice, 0
        self.friction = {"mu": mu, "mus": round(mu * dice.one_of([1.0, dice.number(1, 1.4)]), 6)}
        self.raw: dict[str, Any] = {
            "gravity": [9.81 * np.cos(down), 9.81 * np.sin(down)],
            "bodies": {},
            "joints": {},
            "springs": {},
            "forces": {},
        }

    def near(self, reach: float) -> complex:
        return complex(self.dice.number(-reach, reach), self.dice.number(-reach, reach))

    def turned(self, low: float = -3, high: float = 3) -> complex:
        return np.exp(1j * self.dice.number(low, high))

    def body(self, name: str, *points: complex) -> None:
        """A body about some points, its axes turned at random."""
        mass, size = (
            self.dice.number(0.5, 3),
            max(0.2, max(abs(a - b) for a in points for b in points)),
        )
        centre = np.mean(points) + self.near(0.1 * size)
        self.raw["bodies"][name] = {
            "mass": mass,
            "inertia": mass * size**2 * self.dice.number(0.08, 0.2),
            "position": [centre.real, centre.imag],
            "angle": self.dice.number(-3, 3),
        }

    def own(self, name: str, point: complex) -> list[float]:
        """A point in the axes of a body."""
        body = self.raw["bodies"].get(name, {"position": (0, 0)})
        point = (point - complex(*body["position"])) * np.exp(-1j * self.angle(name))
        return [point.real, point.imag]

    def angle(self, name: str) -> float:
        return self.raw["bodies"][name]["angle"] if name != GROUND else 0.0

    def pin(self, first: str, second: str, point: complex) -> None:
        self.raw["joints"][f"pin-{first}-{second}"] = {
            "type": "revolute",
            "bodies": [first, second],
            "points": [self.own(first, point), self.own(second, point)],
        }

    def slider(self, at: complex, along: complex, guide: str = GROUND) -> str:
        """A slider about a point, on a guide of the given direction that passes near it."""
        name, self.sliders = f"slider-{self.sliders}", self.sliders + 1
        self.body(name, at)
        on, line, shape = at + self.near(0.04), along * np.exp(-1j * self.angle(guide)), {}
        if self.dice.integer(0, 3):
            length = self.dice.number(0.15, 0.5)
            shape = {"length": length, "width": round(self.dice.number(0, 0.6) * length, 6)}
        self.raw["joints"][f"guide-{name}"] = {
            "type": "translational",
            "slider": name,
            "guide": guide,
            "direction": [line.real, line.imag],
            "point": self.own(guide, on + self.dice.number(-0.3, 0.3) * along),
            "slider_point": self.own(name, on),
            "angle": self.angle(name) - self.angle(guide),
            **self.friction,
            **shape,
        }
        return name

    def rod(self, body: str, end: complex, along: complex) -> None:
        """A rod from a body's point to a slider on the ground, whose guide makes a small angle with the rod."""
        name, other = f"rod-{self.sliders}", end + self.dice.number(0.6, 1.1) * along
        self.body(name, end, other)
        self.pin(body, name, end)
        self.pin(name, self.slider(other, along * self.turned(-0.4, 0.4)), other)


def trammel(a: Draft) -> None:
    """A rod between two sliders."""
    ends = a.near(0.2), a.near(0.2) + a.dice.number(0.5, 1) * a.turned()
    a.body("bar", *ends)
    along = a.turned()
    for end, line in zip(ends, (along, along * a.turned(0.8, 2.3))):
        a.pin("bar", a.slider(end, line), end)


def plate(a: Draft) -> None:
    """A plate on two sliders, with a rod from a third point to a third slider."""
    trammel(a)
    a.rod("bar", a.near(0.5), a.turned())


def cranks(a: Draft) -> None:
    """A crank that drives two sliders by rods."""
    ends = [a.dice.number(0.15, 0.3) * a.turned() for _ in range(2)]
    a.body("crank", 0j, *ends)
    a.pin("crank", GROUND, 0j)
    for end in ends:
        a.rod("crank", end, a.turned())


def rocker(a: Draft) -> None:
    """A crank whose pin slides on a rocking link, which drives a second slider by a rod."""
    end, foot = a.dice.number(0.15, 0.3) * a.turned(), a.dice.number(0.4, 0.8) * a.turned()
    a.body("crank", 0j, end)
    a.body("link", foot, end)
    a.pin("crank", GROUND, 0j)
    a.pin("link", GROUND, foot)
    along = (end - foot) / abs(end - foot)
    a.pin("crank", a.slider(end, along * a.turned(-0.3, 0.3), "link"), end)
    a.rod("link", (foot + end) / 2 + a.near(0.1), along * a.turned(1.2, 1.9))


def yoke(a: Draft) -> None:
    """A crank whose pin slides on a slider of the ground, perhaps with a rod to a third."""
    end, along = a.dice.number(0.2, 0.5) * a.turned(), a.turned()
    a.body("crank", 0j, end)
    a.pin("crank", GROUND, 0j)
    first = a.slider(end + a.near(0.2), along)
    a.pin("crank", a.slider(end, along * a.turned(0.8, 2.3), first), end)
    if a.dice.chance():
        a.rod(first, end + a.near(0.3), along * a.turned(-0.5, 0.5))


FAMILIES = (trammel, cranks, plate, rocker, yoke)


def freedom(contact: Contact, terms: Terms) -> np.ndarray:
    """The direction N that the constraints of a mechanism of one freedom leave: J N = 0, N^T M N = 1."""
    root = np.sqrt(contact.equations.mass)
    basis = np.linalg.svd(terms.J / root)[2]  # the last right vector is M^1/2 N
    return basis[-1] / root


def is_clear(motion: Motion) -> bool:
    """Return whether a motion comes to rest, and small errors, of the motion or of a run, do not make it another one."""
    if motion.breakdown is not None or not motion.rest:
        return False
    m, mass = motion.contact, motion.contact.equations.mass
    times = np.array(sorted({event.time for event in motion.events}))
    speeds = m.equations.at(motion.t, motion.q, motion.v).slip_speed
    if np.any(np.diff(times) < CLOSEST) or any(
        event.kind == "reversal" and event.rate < CLEAR_OF_GRAZING * np.max(np.abs(speeds))
        for event in motion.events
    ):
        return False
    for step in motion.steps:
        q, v = np.split(step.state(step.end), 2)
        terms = m.equations.at(step.end, q, v)
        rows = terms.J / np.sqrt(mass)
        rows = rows / np.linalg.norm(rows, axis=1)[:, None]
        if np.linalg.svd(rows, compute_uv=False)[-1] < CLEAR_OF_SINGULAR:
            return False
        if least_determinant(m, terms, step.mode.slip) < CLEAR_OF_JAMMING:
            return False
    # wherever all guides are at rest, they stay or leave clearly
    for t, q, v, speed in zip(motion.t, motion.q, motion.v, speeds):
        if np.max(np.abs(speed)) < AT_REST_BEFORE * np.max(np.abs(speeds)):
            terms = m.equations.at(t, q, np.zeros_like(v))
            margin = m.largest_margin(terms, np.zeros_like(v))
            if abs(margin) < CLEAR_OF_LIMIT * np.max(np.abs(terms.Q)):
                return False
    return True


def least_determinant(m: Contact, terms: Terms, slip: np.ndarray) -> float:
    """Smallest determinant of J M^-1 B over that of J M^-1 J^T, for any signs of the corner forces.

    B^T are the forces of the rows' multipliers with the frictions that they cause: 1 - mu W.. for one guide.
    """
    rows, mass = terms.J, m.equations.mass
    plain = np.linalg.det(rows / mass @ rows.T)
    signs = [((1, 1), (-1, -1)) if not a else CORNERS for a in m.length]
    least = np.inf
    for choice in product(*signs):
        acts = rows.copy()
        for g, (r, a, b, s) in enumerate(zip(m.row, m.length, m.width, choice)):
            push = -m.mu[g] * slip[g]  # n1 + n2 = R, n2 - n1 = (2/a) (T - (b/2) push R)
            if not a:
                acts[r] += push * s[0] * terms.W[g]
                continue
            on_R, on_T = (s[0] + s[1]) / 2, (s[1] - s[0]) / a
            acts[r] += push * (on_R - on_T * b / 2 * push) * terms.W[g]
            acts[r + 1] += push * on_T * terms.W[g]
        least = min(least, np.linalg.det(rows / mass @ acts.T) / plain)
    return float(least)


def drawn(seed: int, i: int) -> tuple[Scene, Motion]:
    """Mechanism i of a seed: the first of its draws whose motion is clear and ends at rest within `LONGEST`."""
    family = FAMILIES[i % len(FAMILIES)]
    for attempt in count():
        dice = SeededDice((seed, i, attempt))
        a = Draft(dice)
        family(a)
        bodies, name = list(a.raw["bodies"]), f"{family.__name__} {i} of seed {seed}"
        if dice.chance():
            a.raw["springs"]["spring"] = {
                "type": "linear",
                "bodies": [dice.one_of(bodies), GROUND],
                "points": [[0, 0], [dice.number(-1, 1), 2]],
                "stiffness": dice.number(0, 20),
                "damping": dice.number(0, 1),
                "rest_length": dice.number(0, 2),
            }
        if dice.chance():
            a.raw["springs"]["twist"] = {
                "type": "torsional",
                "bodies": [dice.one_of(bodies), GROUND],
                "stiffness": dice.number(0, 3),
                "damping": dice.number(0, 0.2),
                "rest_angle": dice.number(-2, 2),
            }
        if dice.chance():
            a.raw["forces"]["load"] = {
                "type": "force",
                "body": dice.one_of(bodies),
                "direction": [dice.number(-1, 1), 1],
                "point": [dice.number(-0.1, 0.1), 0],
                "law": {"type": "constant", "value": dice.number(-10, 10)},
            }
        scene = scene_from_dict(a.raw, name)
        m = Contact(scene)
        q, v = m.equations.start()
        speed = dice.one_of([0.0, dice.number(-2, 2)]) * np.sqrt(m.equations.mass.sum())
        rates = speed * freedom(m, m.equations.at(0.0, q, v))
        for body, rate in zip(bodies, rates.reshape(-1, 3).tolist()):
            a.raw["bodies"][body] |= {"velocity": rate[:2], "angular_velocity": rate[2]}
        scene = scene_from_dict(a.raw, name)
        motion = simulate(scene, LONGEST, TOLERANCE)
        if is_clear(motion):
            scene = scene_from_dict(a.raw | {"t_end": round(1.1 * motion.rest + 0.2, 3)}, name)
            return scene, motion
    raise AssertionError("endless")


AGREES = "agrees"
"""Events, positions and forces within the bound; all guides at rest at the end, balanced, in their cones."""
SLIPS = "slips at rest"
"""A guide is not at rest at the end, though the mechanism is."""
OTHER_EVENTS = "other events"
"""Stick, slip or reversals are others, or at other times."""
OTHER_MOTION = "other motion"
"""A position, a normal force or a friction of the motion is another, or the place of rest."""
NO_BALANCE = "no balance at rest"
"""Forces at rest are not in balance, or not in the static cones of their surfaces."""
STOPS = "stops"
"""A typed breakdown, though there is one motion."""


def judge(scene: Scene, motion: Motion, run: Trajectory, rtol: float) -> SceneOutcome:
    """Hold a run to the motion: the first outcome that is not agreement."""
    about = f"{scene.name}, {run.settings['stabilization']['method']}"
    if run.breakdown is not None:
        return SceneOutcome(STOPS, str(run.breakdown), about)
    bound = max(RESERVE * rtol, OWN_ERROR)
    for outcome, found in (
        (SLIPS, _slips(motion, run)),
        (OTHER_EVENTS, _events(motion, run, bound)),
        (OTHER_MOTION, _motion(motion, run, bound)),
        (NO_BALANCE, _balance(motion, run, bound)),
    ):
        for error, detail in found:  # in units of what is allowed
            if not error <= 1:
                return SceneOutcome(outcome, detail, about)
    return SceneOutcome(AGREES, about=about)


def _slips(motion: Motion, run: Trajectory) -> Iterator[tuple[float, str]]:
    for name in motion.contact.names:
        mode, speed = run[f"{name}.mode"][-1], run[f"{name}.slip_velocity"][-1]
        yield (
            np.inf if mode else abs(speed) / AT_REST,
            f"{name}: mode {mode}, {speed:.2g} m/s at the end",
        )


def _events(motion: Motion, run: Trajectory, bound: float) -> Iterator[tuple[float, str]]:
    for name in motion.contact.names:
        expected = [
            event for event in motion.events if event.joint == name and event.kind != "corner"
        ]
        found = [event for event in run.events if event.joint == name and event.kind != "corner"]
        shifts = _shifts(motion, expected, bound)
        for i, (one, other, error) in enumerate(event_differences(expected, found)):
            shift = shifts[i] if error < np.inf else 1.0
            yield error / shift, f"{name}, event {i + 1}: expected {one}, found {other}"


def _shifts(motion: Motion, events: Sequence[Instant], bound: float) -> list[float]:
    """What an error of a slip's speed, relative to the largest speed, shifts events by, s."""
    speeds = motion.contact.equations.at(motion.t, motion.q, motion.v).slip_speed
    return [bound * (1 + float(np.max(np.abs(speeds))) / event.rate) for event in events]


def _columns(motion: Motion, run: Trajectory, *names: str) -> np.ndarray:
    """Columns of the guides, of shape (instants, names, guides)."""
    guides = motion.contact.names
    return stacked(run.columns, guides, names).reshape(-1, len(guides), len(names)).swapaxes(1, 2)


def _motion(motion: Motion, run: Trajectory, bound: float) -> Iterator[tuple[float, str]]:
    """Forces jump at events: instants within ten times what an event may be shifted by are left out.

    Of a motion that is shorter the place of rest alone is compared.
    With Baumgarte's stabilization the forces answer the drift, too: they may differ by `_answer`.
    """
    q = stacked(run.columns, motion.contact.equations.scene.bodies, BODY_COLUMNS[0])
    forces = _columns(motion, run, "normal_force", "friction")
    switches = [event for event in motion.events if event.kind != "corner"]
    shifts = _shifts(motion, switches, bound)
    rows = [
        k
        for k, t in enumerate(run.t)
        if t < motion.rest
        and all(abs(t - event.time) > 10 * shift for event, shift in zip(switches, shifts))
    ]
    known = [motion.at(run.t[k]) for k in rows]
    true = [(q, np.array([forces.R, forces.f])) for q, forces in known]
    size, load = (
        max(1.0, np.max(np.abs(motion.q[-1]))),
        max((np.max(np.abs(force)) for _, force in true), default=0.0),
    )
    for k, (position, force) in zip(rows, true):
        away, other = np.max(np.abs(q[k] - position)), np.max(np.abs(forces[k] - force))
        yield away / (bound * size), f"position at {run.t[k]:.6g} s by {away:.2g}"
        words = f"normal force or friction at {run.t[k]:.6g} s by {other:.2g} N of {load:.3g} N"
        yield other / (bound * load + _answer(motion, run, k)), words
    away = np.max(np.abs(q[-1] - motion.q[-1]))
    yield away / (bound * size), f"place of rest by {away:.2g}"


def _answer(motion: Motion, run: Trajectory, k: int) -> float:
    """Largest multiplier (N, N m) by which Baumgarte's terms answer the drift at row k; 0 for other stabilizations.

    J M^-1 J^T dlambda = 2 alpha Phi' + beta^2 Phi, eq. (25) of the paper less that without drift, with the rows of pins
    and across guides.
    """
    law, m = run.settings["stabilization"], motion.contact.equations
    if law["method"] != "baumgarte":
        return 0.0
    q, v = (stacked(run.columns, m.scene.bodies, labels)[k] for labels in BODY_COLUMNS[:2])
    terms = m.at(run.t[k], q, v)
    accelerated = 2 * law["alpha"] * terms.phi_dot + law["beta"] ** 2 * terms.phi
    return float(np.max(np.abs(np.linalg.solve(terms.J / m.mass @ terms.J.T, accelerated))))


def _balance(motion: Motion, run: Trajectory, bound: float) -> Iterator[tuple[float, str]]:
    """Guides share a load in ways not determined: forces are in balance, and in the static cone of each surface."""
    m = motion.contact
    q = stacked(run.columns, m.equations.scene.bodies, BODY_COLUMNS[0])[-1]
    terms = m.equations.at(run.t[-1], q, np.zeros_like(q))
    reactions = np.zeros(len(terms.J))
    for name, row in m.equations.pins.items():
        reactions[row : row + 2] = [run[f"{name}.{key}"][-1] for key in ("fx", "fy")]
    [normal, moment, friction] = _columns(motion, run, "normal_force", "moment", "friction")[-1]
    reactions[m.row], reactions[np.array(m.row) + 1] = normal, moment
    size = np.max(np.abs(terms.Q)) + np.max(np.abs([normal, moment, friction]))
    left = np.max(np.abs(terms.Q + reactions @ terms.J + friction @ terms.W))
    yield left / (bound * size), f"{left:.2g} of {size:.3g} N is not in balance"
    for i, name in enumerate(m.names):
        held, pressed, split = [friction[i]], [abs(normal[i])], 0.0
        if m.length[i]:
            held = [run[f"{name}.friction_{side}"][-1] for side in ("lower", "upper")]
            F = [run[f"{name}.F{corner}"][-1] for corner in (1, 2, 3, 4)]
            pressed = [F[0] + F[1], F[2] + F[3]]
            split = max(
                -min(F), abs(sum(held) - friction[i]), abs(pressed[0] - pressed[1] - normal[i])
            )
        excess = max(split, *(abs(f) - m.mus[i] * n for f, n in zip(held, pressed)))
        yield (
            excess / (bound * size),
            f"{name}: friction {held} N of surfaces with {pressed} N, mus = {m.mus[i]}",
        )


def runs(scene: Scene, rtols: Sequence[float]) -> Iterator[tuple[float, Trajectory]]:
    """Runs of the reference, at each tolerance with each stabilization."""
    for rtol, method in product(rtols, STABILIZATIONS):
        yield (
            rtol,
            ReferenceEngine().simulate(
                scene,
                rtol=rtol,
                stabilization=method,
                output_step=scene.t_end / 50,
                event_values=False,
            ),
        )


def judge_drawn(seed: int, i: int, rtols: Sequence[float]) -> list[SceneOutcome]:
    """Judge mechanism i of a seed.

    Some mechanisms magnify the error of the motion a thousandfold. Where a run disagrees, a motion with a tighter
    tolerance decides.
    """
    scene, motion = drawn(seed, i)
    found, again = [], None
    for rtol, run in runs(scene, rtols):
        verdict = judge(scene, motion, run, rtol)
        if verdict.outcome != AGREES:
            again = again or simulate(scene, LONGEST, TOLERANCE / 10)
            verdict = judge(scene, again, run, rtol)
        found.append(verdict)
    return found
