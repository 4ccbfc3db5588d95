"""Shifts of a mechanism in place and time that leave its equations of motion as they are, read off its scene.

A block that a spring pulls, on a hand of constant speed, is in the same state again after block and hand have moved on
together: neither guide, spring nor load tells one place from the other. Such a motion is periodic but for the shift.

A shift moves body b by d_b, turns it by a_b, and moves the clock by s. Each element of the scene is the same after it
under conditions that are linear in (d, a, s). With r = d_0 - d_1, the shift of `bodies[0]` (the slider) against
`bodies[1]` (the guide):

- A pin, and a spring or distance drive without axis: r = 0. Without it the points are elsewhere as seen from the other.
- A guide: n . r = 0, n its normal. The angle of slider less guide is given: a_0 = a_1.
- A spring with an axis u and stiffness: u . r = 0. With damping alone no condition.
- A distance drive with an axis u: u . r = rate s, where its law grows at a rate.
- An axis or direction in the axes of a body other than the ground turns with it. And the force along it, or the normal
  force, acts at the point of `bodies[0]`: r changes its torque on `bodies[1]`. So r = 0, unless that body cannot turn
  and its torque is taken up where it has no influence: by a guide without a length, which answers with a torque alone.
- A torsional spring with stiffness: a_0 = a_1. An angle drive: a_0 - a_1 = rate s.
- A body with a point beside its centre of mass, or with an axis or a guide in its axes: a = 0, or whole turns.
- Weight, forces and torques: their directions are those of the ground. No condition.

That laws of time are periodic with s, such as a sine's, is no condition here: s is a multiple of
`stiction.comparisons.measures.settling.excitation_period`, or any time where that is infinite.

The conditions are sufficient. They are not necessary where several elements make up for each other, such as two springs
with forces that add up to the same at another place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Law, Linear
from stiction.scenes.model import Drive, LinearSpring, Revolute, TorsionalSpring, Translational

TURN = 2 * np.pi
"""rad."""
Condition = tuple[np.ndarray, float, bool]
"""A row of the conditions, its rate, and whether whole turns of it count as nothing."""


@dataclass(frozen=True)
class InvariantShifts:
    """Conditions `rows` (d, a) = `rates` s on a shift by (d, a) in a time s, which leaves the equations unchanged.

    Attributes
    ----------
    rows : ndarray, shape (conditions, 3 bodies)
        On x (m), y (m) and angle (rad) of each body, as in positions q.
    rates : ndarray, shape (conditions,)
        m/s or rad/s.
    turns : ndarray of bool, shape (conditions,)
        True where whole turns make no difference.
    units : ndarray, shape (conditions,)
        Metres in a unit of each condition.
    """

    rows: np.ndarray
    rates: np.ndarray
    turns: np.ndarray
    units: np.ndarray

    def places(self, t: np.ndarray | float, q: np.ndarray) -> np.ndarray:
        """What of positions makes a difference, in m: (instants, conditions), from q of (instants, 3 bodies).

        Positions that are an invariant shift apart have the same places, but for whole turns.
        """
        return (q @ self.rows.T - np.multiply.outer(t, self.rates)) * self.units

    def whole_turns(self, change: np.ndarray) -> np.ndarray:
        """The whole turns in a change of places, which make no difference; m."""
        turn = TURN * self.units
        return np.where(self.turns, turn * np.round(change / turn), 0.0)

    def nearest(self, time: float, change: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """The invariant shift in a time (s) that is nearest to a change of positions, shape (3 bodies,).

        `unit` are metres in a unit of each position.
        """
        # what the change lacks of the conditions, taken off by the smallest correction in metres
        missed = self.places(np.array([time]), change[None])[0]
        missed -= self.whole_turns(missed)
        scaled = self.units[:, None] * self.rows / unit
        return change - np.linalg.lstsq(scaled, missed, rcond=None)[0] / unit


def invariant_shifts(scene: Scene, size: float) -> InvariantShifts:
    """Return the conditions on a shift of a scene; `size` is the length (m) that goes with a radian."""
    conditions = list(_conditions(scene))
    count = 3 * len(scene.bodies)
    rows = np.array([row for row, _, _ in conditions]).reshape(-1, count)
    is_length = np.any(np.delete(rows, np.s_[2::3], axis=1) != 0.0, axis=1)
    return InvariantShifts(
        rows,
        np.array([rate for _, rate, _ in conditions], dtype=float),
        np.array([turns for _, _, turns in conditions], dtype=bool),
        np.where(is_length, 1.0, size),
    )


def _conditions(scene: Scene) -> Iterator[Condition]:
    """The conditions of every element."""
    rules = _Rules(scene)
    for joint in scene.joints.values():
        if isinstance(joint, Revolute):
            yield from rules.together(joint.bodies)
        else:
            yield from rules.along(joint.bodies, joint.direction, 0.0, across=True)
            yield rules.row(joint.bodies, ANGLE), 0.0, False
    for spring in scene.springs.values():
        yield from rules.spring(spring)
    for drive in scene.drives.values():
        yield from rules.drive(drive)
    for body in _oriented(scene):
        yield rules.row((body, GROUND), ANGLE), 0.0, True


X, Y, ANGLE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
"""Coefficients of the coordinates of a body."""


class _Rules:
    """Conditions of elements of a scene, as rows on the coordinates of its bodies."""

    def __init__(self, scene: Scene):
        self.places = {name: number for number, name in enumerate(scene.bodies)}
        held, free_of_torque = _held_angles(scene), _free_of_torque(scene)
        self.angles = {body: angle for body, angle in held.items() if body in free_of_torque}

    def row(self, bodies: tuple[str, str], first: tuple[float, float, float]) -> np.ndarray:
        """Coefficients of x, y and angle of the first body, and their opposites of the second; the ground has none."""
        coefficients = np.zeros((len(self.places), 3))
        for body, sign in zip(bodies, (1.0, -1.0)):
            if body != GROUND:
                coefficients[self.places[body]] += sign * np.array(first)
        return coefficients.ravel()

    def together(self, bodies: tuple[str, str]) -> Iterator[Condition]:
        """Two bodies move on as one."""
        yield self.row(bodies, X), 0.0, False
        yield self.row(bodies, Y), 0.0, False

    def grows(self, rate: float) -> Iterator[Condition]:
        """No shift makes up for a coordinate that grows: 0 = rate s."""
        if rate:
            yield np.zeros(3 * len(self.places)), rate, False

    def along(
        self,
        bodies: tuple[str, str],
        direction: tuple[float, float],
        rate: float | None,
        across: bool,
    ) -> Iterator[Condition]:
        """A coordinate along a direction in the axes of the second body changes at a rate; None leaves it free.

        `across`: the coordinate is the one across the direction, which is then the guide's.
        """
        if bodies[1] not in self.angles:
            # the direction turns, or the torque of the force along it matters: no relative shift
            yield from self.together(bodies)
            yield from self.grows(rate or 0.0)
        elif rate is not None:
            angle = self.angles[bodies[1]] + np.arctan2(direction[1], direction[0])
            angle += np.pi / 2 if across else 0.0
            yield self.row(bodies, (np.cos(angle), np.sin(angle), 0.0)), rate, False

    def spring(self, spring: LinearSpring | TorsionalSpring) -> Iterator[Condition]:
        if isinstance(spring, TorsionalSpring):
            if spring.stiffness:
                yield self.row(spring.bodies, ANGLE), 0.0, False
        elif spring.axis is not None:
            if spring.stiffness or spring.damping:
                yield from self.along(
                    spring.bodies, spring.axis, 0.0 if spring.stiffness else None, across=False
                )
        elif spring.stiffness or spring.damping:
            yield from self.together(spring.bodies)

    def drive(self, drive: Drive) -> Iterator[Condition]:
        rate = _rate(drive.law)
        if drive.type == "angle":
            yield self.row(drive.bodies, ANGLE), rate, False
        elif drive.axis is not None:
            yield from self.along(drive.bodies, drive.axis, rate, across=False)
        else:
            yield from self.together(drive.bodies)
            yield from self.grows(rate)


def _rate(law: Law) -> float:
    """The rate of a law that grows; 0 of one that is constant or swings."""
    return law.rate if isinstance(law, Linear) else 0.0


def _oriented(scene: Scene) -> list[str]:
    """The bodies whose angle matters: with a guide or an axis in their axes, or a point beside their centre of mass."""
    oriented = {body for guide in scene.guides.values() for body in guide.bodies}
    for element in (*scene.joints.values(), *scene.drives.values(), *scene.springs.values()):
        if isinstance(element, (Revolute, Drive, LinearSpring)):
            oriented |= {body for body, point in zip(element.bodies, element.points) if any(point)}
        if getattr(element, "axis", None) is not None:
            oriented.add(element.bodies[1])
    oriented |= {load.body for load in scene.forces.values() if any(getattr(load, "point", ()))}
    return [body for body in scene.bodies if body in oriented]


def _linked(guides: list[Translational]) -> Iterator[tuple[str, str, float]]:
    """Pairs of bodies with the angle of the second less the first, from the ground on, as far as guides link them."""
    # Depth-first search over the graph of guides, which are passed in both directions.
    reached, waiting = {GROUND}, [GROUND]
    while waiting:
        body = waiting.pop()
        for guide in guides:
            directions = (
                (guide.guide, guide.slider, guide.angle),
                (guide.slider, guide.guide, -guide.angle),
            )
            for first, second, angle in directions:
                if first == body and second not in reached:
                    reached.add(second)
                    waiting.append(second)
                    yield first, second, angle


def _held_angles(scene: Scene) -> dict[str, float]:
    """Angles (rad) of the bodies that cannot turn, as guides lead from the ground to them."""
    angles = {GROUND: 0.0}
    for first, second, angle in _linked(list(scene.guides.values())):
        angles[second] = angles[first] + angle
    return angles


def _free_of_torque(scene: Scene) -> set[str]:
    """The ground, and bodies whose guides pass a torque on to it without an influence on forces.

    A guide without a length answers a torque with a torque. One with a length does so with corner forces.
    """
    guides = [guide for guide in scene.guides.values() if guide.length is None]
    return {GROUND, *(second for _, second, _ in _linked(guides))}
