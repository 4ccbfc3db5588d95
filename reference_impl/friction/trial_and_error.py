"""Contact forces by trial and error on the signs of the normal forces, compiled: before complementarity.

The signs of the corner forces, and which guides at rest remain so, are assumed as they were in the previous instant;
one linear solve gives the forces; every assumption that they contradict is changed, and so on (Klepp, Trial-and-error
based method for the investigation of multi-body systems with friction, J. Sound Vib. 197 (1996) 629-637). Nothing makes
it end: the assumptions may come back to what they were, with or without a consistent set elsewhere. That is found and
said.
"""

from __future__ import annotations

import numpy as np

from stiction.reference_impl.compiled.bundle import Integers, IntegerTable, Reals
from stiction.reference_impl.compiled.kernel import kernel
from stiction.reference_impl.compiled.linear_algebra import solve_in_place
from stiction.reference_impl.compiled.loops import are_equal, copy
from stiction.reference_impl.friction.enumeration import fill, revise
from stiction.reference_impl.friction.frozen_mode import solve_cells
from stiction.reference_impl.friction.outcomes import SIGN_CYCLE, SINGULAR, SOLVED
from stiction.reference_impl.multibody.mechanism import NO_GUIDE, Arrays, Workspace


@kernel(allocates=True)
def trial_and_error(
    m: Arrays, w: Workspace, slip: Integers, corner: IntegerTable, force: Reals, direction: Integers
) -> tuple[int, int, int]:
    """Find the forces of the rows in the workspace; the static coefficient holds for every guide at rest.

    `slip` as in `hlcp.assemble`. `corner` (frictional, 2): the signs assumed first; receives those of the
    solution, and is left alone where none is found. `force` and `direction` receive the row forces and the direction in
    which each guide slips or begins to, 0 for one that stays at rest.

    Returns the outcome (SOLVED; SIGN_CYCLE: an earlier set of assumptions came back; SINGULAR: so is the system of a
    set), the number of linear solves, and the first guide whose assumptions the last one contradicted, or NO_GUIDE.
    """
    nr, nf = m.rows, len(m.friction)
    size = 0 if len(m.cell) else nr + nf
    A = np.zeros((size, size))

    # the first assumptions: signs as before, and guides at rest stay there
    signs = np.zeros((nf, 2), dtype=np.int64)
    kept = np.zeros(nf, dtype=np.int64)
    for f in range(nf):
        signs[f, 0] = corner[f, 0]
        signs[f, 1] = corner[f, 1]
        direction[f] = slip[f]
        kept[f] = slip[f]
    kept_signs = signs.copy()
    trials, renew = 0, 1
    while True:
        # forces of the assumptions; large mechanisms have banded systems
        trials += 1
        if len(m.cell):
            regular = solve_cells(m, w, slip, direction, signs, True)
            copy(w.force, force)
        else:
            fill(m, w, slip, direction, signs, A, force, 0.0)
            regular = solve_in_place(A, force, w.unit, nr + nf, nr + nf)
        if not regular:
            return SINGULAR, trials, NO_GUIDE

        # all assumptions that these forces contradict are changed at once
        guide = revise(m, w, slip, direction, signs, force)
        if guide == NO_GUIDE:
            for f in range(nf):
                corner[f, 0], corner[f, 1] = signs[f, 0], signs[f, 1]
            return SOLVED, trials, guide

        # Each set of assumptions follows from the one before, so that a set that returns does so for ever. Brent (1980)
        # finds such a cycle by comparing with one set, which is renewed after 1, 2, 4, 8, .. trials.
        if are_equal(direction, kept) and are_equal(signs.reshape(-1), kept_signs.reshape(-1)):
            return SIGN_CYCLE, trials, guide
        if trials == renew:
            copy(signs.reshape(-1), kept_signs.reshape(-1))
            copy(direction, kept)
            renew *= 2
