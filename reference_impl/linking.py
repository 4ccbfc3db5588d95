"""Workspaces for kernels that call others apart."""

from __future__ import annotations

from functools import cache

import numpy as np

from reference_impl import contact_solvers, hlcp, mode_choice, mode_search, right_hand_side, step, uniqueness
from reference_impl.apart import CHOOSE_MODE, HAS_SEVERAL, RIGHT_HAND_SIDE, SOLUTIONS, SOLVE_CONTACT, SOLVE_HLCP, TAKE_STEP
from reference_impl.kinematics import Workspace, workspace
from reference_impl.mechanism import Arrays


def linked_workspace(arrays: Arrays) -> Workspace:
    """A workspace that has the addresses of the kernels that are called apart."""
    w = workspace(arrays)
    w.code[:] = _addresses()
    return w


@cache
def _addresses() -> np.ndarray:
    addresses = {
        SOLUTIONS: mode_search.solutions_address, SOLVE_HLCP: hlcp.solve_address,
        SOLVE_CONTACT: contact_solvers.solve_contact_address, HAS_SEVERAL: uniqueness.has_several_address,
        CHOOSE_MODE: mode_choice.choose_mode_address, RIGHT_HAND_SIDE: right_hand_side.right_hand_side_address,
        TAKE_STEP: step.take_step_address}
    return np.array([addresses[place]() for place in sorted(addresses)])
