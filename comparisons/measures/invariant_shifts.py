"""Shifts of a mechanism in position and time that do not change its equations of motion.

For example, a block is pulled by a spring whose other end, the hand, moves at constant speed. If
block and hand are shifted by the same distance, neither guide nor spring nor load changes. A
stick-slip motion of the block may therefore be periodic except for such a shift.

A shift displaces body b by d_b, rotates it by a_b, and shifts the time by s. An element of the
scene remains unchanged under conditions that are linear in (d, a, s). Let r = d_0 - d_1 be the
shift of `bodies[0]` (the slider) relative to `bodies[1]` (the guide):

- A pin, and a spring or distance drive without axis: r = 0. Otherwise the relative position of the
  points changes.
- A guide with the normal n: n . r = 0. The guide prescribes the relative angle of its bodies: a_0 =
  a_1.
- A spring with an axis u and stiffness: u . r = 0. With damping alone no condition.
- A distance drive with an axis u: u . r = rate s, where its law grows at a rate.
- An axis or direction in the axes of a body other than the ground turns with it. And the force
  along it, or the normal force, acts at the point of `bodies[0]`: r changes its torque on
  `bodies[1]`. So r = 0, unless that body cannot turn and its torque is taken up where it has no
  influence: by a guide without a length, which answers with a torque alone.
- A torsional spring with stiffness: a_0 = a_1. An angle drive: a_0 - a_1 = rate s.
- A body with a point beside its centre of mass, or with an axis or a guide in its axes: a = 0, or
  whole turns.
- Weight, forces and torques: their directions are those of the ground. No condition.

That laws of time are periodic with s, such as a sine's, is no condition here: s is a multiple of
`stiction.comparisons.measures.settling.excitation_period`, or any time where that is infinite.

The conditions are sufficient. They are not necessary where several elements make up for each other,
such as two springs with forces that add up to the same at another place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.laws import Law, Linear, law_terms
from stiction.scenes.model import Drive, LinearSpring, Revolute, TorsionalSpring, Translational

TURN = 2 * np.pi
"""A whole turn, rad."""
Condition = tuple[np.ndarray, float, bool]
"""Coefficients of a condition on (d, a), its rate, and whether whole turns make no difference."""


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
        """Return the quantities that invariant shifts do not change, except by whole turns.

        Parameters
        ----------
        t : ndarray, shape (instants,)
            Times, s.
        q : ndarray, shape (instants, 3 bodies)
            Positions.

        Returns
        -------
        ndarray, shape (instants, conditions)
            In m.
        """
        return (q @ self.rows.T - np.multiply.outer(t, self.rates)) * self.units

    def whole_turns(self, change: np.ndarray) -> np.ndarray:
        """Return the part of a change of `places` that consists of whole turns, which make no difference; m."""
        turn = TURN * self.units
        return np.where(self.turns, turn * np.round(change / turn), 0.0)

    def nearest(self, time: float, change: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """Return the invariant shift that is nearest to a change of positions.

        Parameters
        ----------
        time : float
            Shift of time, s.
        change, unit : ndarray, shape (3 bodies,)
            Change of positions, and the length in m that corresponds to one unit of each of them.

        Returns
        -------
        ndarray, shape (3 bodies,)
        """
        # Subtract the smallest correction, measured in m, with which the conditions are satisfied.
        violation = self.places(np.array([time]), change[None])[0]
        violation -= self.whole_turns(violation)
        scaled_rows = self.units[:, None] * self.rows / unit
        return change - np.linalg.lstsq(scaled_rows, violation, rcond=None)[0] / unit


def invariant_shifts(scene: Scene, size: float) -> InvariantShifts:
    """Return the conditions on the shifts of a scene; `size` is the length (m) that corresponds to one radian."""
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
    """Yield the conditions of all elements of a scene."""
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


X = (1.0, 0.0, 0.0)
"""Coefficients (x, y, angle) that select the coordinate x of a body."""
Y = (0.0, 1.0, 0.0)
"""Coefficients (x, y, angle) that select the coordinate y of a body."""
ANGLE = (0.0, 0.0, 1.0)
"""Coefficients (x, y, angle) that select the angle of a body."""


class _Rules:
    """The conditions for each type of element, see the module.

    Attributes
    ----------
    numbers : dict of str to int
        Position of each body in the scene.
    angles : dict of str to float
        Angles (rad) of the bodies, including the ground, that cannot rotate and on which a torque
        has no influence on other forces.
    """

    def __init__(self, scene: Scene):
        self.numbers = {name: number for number, name in enumerate(scene.bodies)}
        unaffected_by_torque = _free_of_torque(scene)
        self.angles = {
            body: angle
            for body, angle in _held_angles(scene).items()
            if body in unaffected_by_torque
        }

    def row(self, bodies: tuple[str, str], first: tuple[float, float, float]) -> np.ndarray:
        """Return the coefficients of a difference between two bodies, shape (3 bodies,).

        Those of the first body (x, y, angle) are given. Those of the second are their opposites.
        The ground has none.
        """
        coefficients = np.zeros((len(self.numbers), 3))
        for body, sign in zip(bodies, (1.0, -1.0)):
            if body != GROUND:
                coefficients[self.numbers[body]] += sign * np.array(first)
        return coefficients.ravel()

    def together(self, bodies: tuple[str, str]) -> Iterator[Condition]:
        """Yield the conditions that two bodies are displaced alike."""
        yield self.row(bodies, X), 0.0, False
        yield self.row(bodies, Y), 0.0, False

    def grows(self, rate: float) -> Iterator[Condition]:
        """Yield the condition 0 = rate s of a growing coordinate that no shift of bodies compensates."""
        if rate:
            yield np.zeros(3 * len(self.numbers)), rate, False

    def along(
        self,
        bodies: tuple[str, str],
        direction: tuple[float, float],
        rate: float | None,
        across: bool,
    ) -> Iterator[Condition]:
        """Yield the condition on the relative coordinate of two bodies along a direction.

        Parameters
        ----------
        bodies : (str, str)
        direction : (float, float)
            In the axes of the second body.
        rate : float or None
            Rate of the coordinate, m/s; None if it is free.
        across : bool
            True for the coordinate perpendicular to the direction, as in a guide.
        """
        if bodies[1] not in self.angles:
            # The direction rotates, or the torque of the force along it has an influence: then no
            # relative shift is invariant.
            yield from self.together(bodies)
            yield from self.grows(rate or 0.0)
        elif rate is not None:
            angle = self.angles[bodies[1]] + np.arctan2(direction[1], direction[0])
            angle += np.pi / 2 if across else 0.0
            yield self.row(bodies, (np.cos(angle), np.sin(angle), 0.0)), rate, False

    def spring(self, spring: LinearSpring | TorsionalSpring) -> Iterator[Condition]:
        """Yield the conditions of a spring and damper."""
        if isinstance(spring, TorsionalSpring):
            if spring.stiffness:
                yield self.row(spring.bodies, ANGLE), 0.0, False
            return
        if not (spring.stiffness or spring.damping):
            return
        if spring.axis is None:
            yield from self.together(spring.bodies)
        else:
            # a damper does not depend on the coordinate along its axis
            rate = 0.0 if spring.stiffness else None
            yield from self.along(spring.bodies, spring.axis, rate, across=False)

    def drive(self, drive: Drive) -> Iterator[Condition]:
        """Yield the conditions of a drive."""
        rate = _rate(drive.law)
        if drive.type == "angle":
            yield self.row(drive.bodies, ANGLE), rate, False
        elif drive.axis is not None:
            yield from self.along(drive.bodies, drive.axis, rate, across=False)
        else:
            yield from self.together(drive.bodies)
            yield from self.grows(rate)


def _rate(law: Law) -> float:
    """Return the rate of linear terms, 0 of others, which are constant, oscillate, or come to an end."""
    return sum(term.rate for term in law_terms(law) if isinstance(term, Linear))


def _oriented(scene: Scene) -> list[str]:
    """Return the bodies whose angle has an influence.

    These have a guide or an axis in their axes, or a point outside of their centre of mass.
    """
    oriented = {body for guide in scene.guides.values() for body in guide.bodies}
    for element in (*scene.joints.values(), *scene.drives.values(), *scene.springs.values()):
        if isinstance(element, (Revolute, Drive, LinearSpring)):
            oriented |= {body for body, point in zip(element.bodies, element.points) if any(point)}
        if getattr(element, "axis", None) is not None:
            oriented.add(element.bodies[1])
    oriented |= {load.body for load in scene.forces.values() if any(getattr(load, "point", ()))}
    return [body for body in scene.bodies if body in oriented]


def _linked(guides: list[Translational]) -> Iterator[tuple[str, str, float]]:
    """Yield the bodies that guides connect to the ground, in an order in which their predecessors come first.

    Each is yielded as its predecessor, its own name, and its angle minus that of its predecessor,
    rad.
    """
    # Depth-first search in the graph whose edges are guides, in both directions.
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
    """Return the angles (rad) of the bodies that cannot rotate because guides connect them to the ground."""
    angles = {GROUND: 0.0}
    for first, second, angle in _linked(list(scene.guides.values())):
        angles[second] = angles[first] + angle
    return angles


def _free_of_torque(scene: Scene) -> set[str]:
    """Return the ground, and the bodies on which a torque does not change forces in guides.

    These are connected to the ground by guides without a length, whose reaction to a torque is a
    torque. A guide with a length reacts with corner forces, which have friction.
    """
    guides = [guide for guide in scene.guides.values() if guide.length is None]
    return {GROUND, *(second for _, second, _ in _linked(guides))}
