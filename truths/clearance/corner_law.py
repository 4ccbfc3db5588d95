"""Law of the corners of a slider in a gap: Signorini's condition and Coulomb's law, solved by enumeration.

The same law holds for impulses and velocities at an impact, and for forces and accelerations between impacts. Of every
corner that takes part, let N >= 0 be the normal reaction and T the friction, xi and tau the rates that they act on:

    0 <= N  _|_  xi >= 0 ,      |T| <= mu N ,   T = -mu N where tau > 0 ,   T = mu N where tau < 0 ,

    (xi, tau) = free + response (N, T) .

At an impact (Moreau's law with Newton's coefficient e of restitution; Flores, Leine & Glocker 2010) xi = u_N+ + e u_N-
and tau = u_T+, since the restitution of the tangential velocity is zero. Between impacts xi and tau are the
accelerations of a corner, and only a corner at rest has its friction decided by tau: one that slides has the sign of
its slip velocity.

Each corner is open (N = T = 0), sticks (xi = tau = 0) or slips (xi = 0, T = -mu s N). In every combination the law is
a system of linear equations and inequalities. All combinations are tried, at most 4^4, so that a second solution is
found as well as none. Combinations whose equations are singular are left out: two corners that stick on one line share
their friction in any proportion, and the extreme shares are solutions of combinations in which one of them slips with
no velocity.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import product

import numpy as np

_SINGULAR = 1e-11
"""Reciprocal condition of the equations of a combination, below which they determine no solution.

It is far above the rounding 1e-16 of a matrix of rank less than its size, and far below the ratio of the inertias that
the corners of a mechanism feel.
"""
_TOLERANCE = 1e-9
"""Violation of an inequality, relative to the largest quantity of its kind, that counts as rounding.

A corner on the limit between two states (a take-off, the begin of slip) is known with the error of the time of that
event, about 1e-13 relative; the condition of the equations adds two or three digits.
"""
_SAME = 1e-7
"""Relative difference of rates below which two combinations are the same motion: some tolerances of an inequality."""


class CornerState(Enum):
    """State of a corner: open, or in contact and sticking or slipping in one direction."""

    OPEN = "open"
    STICK = "stick"
    FORWARD = "slips forwards"
    BACKWARD = "slips backwards"

    @property
    def direction(self) -> int:
        """Direction of slip, 0 for a corner that does not slip."""
        return {CornerState.FORWARD: 1, CornerState.BACKWARD: -1}.get(self, 0)

    @property
    def is_closed(self) -> bool:
        """Whether the corner is in contact."""
        return self is not CornerState.OPEN


AT_REST = (CornerState.STICK, CornerState.FORWARD, CornerState.BACKWARD, CornerState.OPEN)
"""States of a corner without slip velocity, in the order in which they are preferred if they are the same motion."""


def states_of_slip(direction: int) -> tuple[CornerState, ...]:
    """Return the states that a corner can have whose slip velocity has the sign `direction` (1 or -1)."""
    slips = CornerState.FORWARD if direction > 0 else CornerState.BACKWARD
    return (slips, CornerState.OPEN)


@dataclass(frozen=True)
class Reactions:
    """A solution of the law for k corners.

    Attributes
    ----------
    states : tuple of CornerState
        State of each corner.
    normal, friction : ndarray, shape (k,)
        Normal reactions and frictions, N s at an impact, N between impacts.
    normal_rate, slip_rate : ndarray, shape (k,)
        The rates xi and tau, m/s at an impact, m/s^2 between impacts.
    """

    states: tuple[CornerState, ...]
    normal: np.ndarray
    friction: np.ndarray
    normal_rate: np.ndarray
    slip_rate: np.ndarray

    def is_same_motion(self, other: Reactions, scale: float) -> bool:
        """Whether two solutions have the same rates, to rounding relative to `scale`."""
        difference = max(
            np.max(np.abs(self.normal_rate - other.normal_rate), initial=0.0),
            np.max(np.abs(self.slip_rate - other.slip_rate), initial=0.0),
        )
        return bool(difference <= _SAME * scale)


def reactions_in(
    states: Sequence[CornerState], response: np.ndarray, free: np.ndarray, mu: float
) -> Reactions | None:
    """Return the reactions of corners in given states, from the equations alone.

    Parameters
    ----------
    states : sequence of CornerState, length k
        State of each corner.
    response : ndarray, shape (2 k, 2 k)
        Rates per reaction, normal directions first, then tangential ones.
    free : ndarray, shape (2 k,)
        Rates without reactions.
    mu : float
        Coefficient of friction.

    Returns
    -------
    Reactions or None
        None if the equations are singular.
    """
    k = len(states)
    closed = [i for i, state in enumerate(states) if state.is_closed]
    sticking = [i for i, state in enumerate(states) if state is CornerState.STICK]
    # Columns of `directions` are the reactions per unknown: a normal reaction brings its slip friction
    # along, a sticking corner has its friction as an unknown of its own.
    directions = np.zeros((2 * k, len(closed) + len(sticking)))
    for column, i in enumerate(closed):
        directions[i, column] = 1.0
        directions[k + i, column] = -mu * states[i].direction
    for column, i in enumerate(sticking, start=len(closed)):
        directions[k + i, column] = 1.0
    rows = [*closed, *(k + i for i in sticking)]
    reaction = np.zeros(2 * k)
    if rows:
        matrix = response[rows] @ directions
        try:
            inverse = np.linalg.inv(matrix)
        except np.linalg.LinAlgError:
            return None
        if np.max(np.abs(inverse)) * np.max(np.abs(matrix)) * _SINGULAR >= 1.0:
            return None
        reaction = directions @ (inverse @ -free[rows])
    rate = free + response @ reaction
    # What the equations make zero is zero, without their rounding.
    rate[rows] = 0.0
    return Reactions(tuple(states), reaction[:k], reaction[k:], rate[:k], rate[k:])


def solutions(
    response: np.ndarray,
    free: np.ndarray,
    mu: float,
    choices: Sequence[Sequence[CornerState]],
    slip_is_open: Sequence[bool],
) -> list[list[Reactions]]:
    """Return all solutions of the law, grouped by motion: those of a group have the same rates.

    Parameters
    ----------
    response, free, mu
        As for `reactions_in`.
    choices : sequence of sequences of CornerState
        States that each corner can have, in the order of preference.
    slip_is_open : sequence of bool
        True for a corner whose direction of slip must agree with its slip rate: every corner at an impact, and those
        without slip velocity between impacts.
    """
    scale = float(np.max(np.abs(free), initial=np.finfo(float).tiny))
    motions: list[list[Reactions]] = []
    for candidate in _candidates(response, free, mu, choices, slip_is_open, scale):
        for motion in motions:
            if candidate.is_same_motion(motion[0], scale):
                motion.append(candidate)
                break
        else:
            motions.append([candidate])
    return motions


def _candidates(
    response: np.ndarray,
    free: np.ndarray,
    mu: float,
    choices: Sequence[Sequence[CornerState]],
    slip_is_open: Sequence[bool],
    scale: float,
) -> Iterator[Reactions]:
    """Yield the reactions in each combination of states that fulfils all inequalities of the law."""
    for states in product(*choices):
        candidate = reactions_in(states, response, free, mu)
        if candidate is not None and _fulfils_law(candidate, mu, slip_is_open, scale):
            yield candidate


def _fulfils_law(
    candidate: Reactions, mu: float, slip_is_open: Sequence[bool], scale: float
) -> bool:
    """Return whether reactions and rates fulfil the inequalities of the law, to rounding."""
    largest = np.max(np.abs([candidate.normal, candidate.friction]), initial=0.0)
    no_reaction = _TOLERANCE * largest
    no_rate = _TOLERANCE * scale
    if np.any(candidate.normal < -no_reaction) or np.any(candidate.normal_rate < -no_rate):
        return False
    if np.any(np.abs(candidate.friction) > mu * candidate.normal + no_reaction):
        return False
    for state, rate, is_open in zip(candidate.states, candidate.slip_rate, slip_is_open):
        if is_open and state.direction * rate < -no_rate:
            return False
    return True
