"""Every contact mode of a mechanism, written from the law of friction alone: direction of slip and surface of each corner of every guide."""

from itertools import product

import numpy as np

MOST_MODES = 1500


def contact_modes(guides, slip):
    """Every mode as arrays (modes, guides): direction, coefficient, signs of the corners."""
    choices = []
    for f, guide in enumerate(guides):
        signs = list(product((1, -1), repeat=2)) if guide["length"] > 0 else [(1, 1), (-1, -1)]
        moving = (
            [(1, guide["mus"]), (-1, guide["mus"])] if slip[f] == 0 else [(slip[f], guide["mu"])]
        )
        choices.append(
            ([(0, 0.0, 1, 1)] if slip[f] == 0 else [])
            + [(d, mu, *s) for d, mu in moving for s in signs]
        )
    if np.prod([len(choice) for choice in choices], dtype=float) > MOST_MODES:
        return None
    return np.array(list(product(*choices)), dtype=float).transpose(2, 0, 1)


def corners(guide, R, T, kappa):
    """n1, n2 of a guide whose friction is kappa (N+ + N-)."""
    if guide["length"] == 0:
        return R / 2, R / 2
    N = T - guide["width"] / 2 * kappa * R
    return R / 2 - N / guide["length"], R / 2 + N / guide["length"]


def consistent_forces(m, w, slip):
    """Row forces of every consistent contact mode with a well-conditioned system, and whether all systems were; None: too many.

    In units in which every row has the mobility 1, so that one number bounds rounding in all of them.
    """
    modes = contact_modes(m.friction, slip)
    if modes is None:
        return None
    rows, count = m.rows, modes.shape[1]
    unit = 1 / np.sqrt(np.diag(w.G))
    A, b = (
        np.repeat((w.G * unit * unit[:, None])[None], count, axis=0),
        np.repeat((w.right * unit)[None], count, axis=0),
    )
    for f, guide in enumerate(m.friction):
        d, mu, s1, s2 = modes[:, :, f]
        moves, t, row = d != 0, rows + f, guide["row"]
        A[moves, t], b[moves, t] = 0.0, 0.0
        A[moves, t, t] = 1.0
        # f + mu d (s1 n1 + s2 n2) = 0 with n1, n2 = R/2 -+ (T + (b/2) mu d R)/a
        on_R, on_T = (s1 + s2) / 2, np.zeros(count)
        if guide["length"] > 0:
            on_T = (s2 - s1) / guide["length"]
            on_R = on_R + on_T * guide["width"] / 2 * mu * d
        A[moves, t, row] += (mu * d * on_R * unit[row] / unit[t])[moves]
        if guide["length"] > 0:
            A[moves, t, row + 1] += (mu * d * on_T * unit[row + 1] / unit[t])[moves]
    regular = np.linalg.cond(A) < 1e10
    solved = np.linalg.solve(A[regular], b[regular][:, :, None])[:, :, 0]
    forces, modes, fits = solved * unit, modes[:, regular], np.ones(regular.sum(), dtype=bool)
    floor = 1e-7 * np.max(np.abs(solved), axis=1)  # cond 1e10 times rounding, and a reserve
    for f, guide in enumerate(m.friction):
        d, mu, s1, s2 = modes[:, :, f]
        row, t = guide["row"], rows + f
        R, T, friction = forces[:, row], forces[:, row + 1], forces[:, t]
        load = floor * unit[row] + (
            floor * unit[row + 1] / guide["length"] if guide["length"] > 0 else 0.0
        )
        n1, n2 = corners(guide, R, T, -mu * d)
        moves = d != 0
        fits &= ~moves | ((s1 * n1 >= -load) & (s2 * n2 >= -load))
        for way in (1, -1):
            capacity = guide["mus"] * sum(map(np.abs, corners(guide, R, T, -way * guide["mus"])))
            fits &= moves | (-way * friction <= capacity + load + floor * unit[t])
        if slip[f] == 0:
            along = (forces @ w.G[t] - w.right[t]) * unit[t]
            fits &= ~moves | (d * along >= -floor)
    return forces[fits], bool(regular.all())
