"""Integrals over a motion with events."""

import numpy as np


def quadrature(truth, order=40, pieces=8):
    """Instants and weights that integrate columns over time: Gauss-Legendre, with every interval between events
    in `pieces` parts, so that no jump or kink lies within one."""
    x, w = np.polynomial.legendre.leggauss(order)
    ends = np.unique([0.0, *(event.time for event in truth.events), truth.t_end])
    ends = np.append(np.concatenate([np.linspace(a, b, pieces + 1)[:-1] for a, b in zip(ends, ends[1:])]), ends[-1])
    half, middle = np.diff(ends)[:, None] / 2, (ends[1:] + ends[:-1])[:, None] / 2
    return (middle + half * x).ravel(), (half * w).ravel()
