"""States onto the constraints: guides at rest stay where they are and have no slip velocity, few rows or many."""

import numpy as np
import pytest
from mechanism_families import barred_chain, closed_loop, sprung_chain

from stiction.reference_impl.multibody.dynamics import row_form
from stiction.reference_impl.multibody.mechanism import Mechanism, workspace
from stiction.reference_impl.multibody.projection import project
from stiction.reference_impl.multibody.trajectory_columns import guide_motion
from stiction.scenes import load_scene

OFF = 1e-6
"""m, rad, m/s: by which a state is off its constraints."""


def projected(m, q, v, slip, holds):
    """State and workspace behind a projection of a state that is off by random errors of the size OFF."""
    random = np.random.default_rng(2)
    q, v, w = (
        q + OFF * random.standard_normal(len(q)),
        v + OFF * random.standard_normal(len(v)),
        workspace(m),
    )
    before = displacements(m, q, v)
    row_form(m, w, 0.3, q, v)
    project(m, w, 0.3, q, v, slip, holds, 5)
    row_form(m, w, 0.3, q, v)
    return q, v, w, displacements(m, q, v) - before


def displacements(m, q, v):
    """Of the frictional guides, in their order."""
    guides = sorted(
        (constraint["friction"], k)
        for k, constraint in enumerate(m.constraint)
        if constraint["friction"] >= 0
    )
    return np.array([guide_motion(m, k, q[None], v[None])[0][0] for _, k in guides])


@pytest.mark.parametrize(
    "build",
    [
        lambda: load_scene("hold-turning-bar"),
        lambda: sprung_chain(6),
        lambda: barred_chain(5),
        lambda: closed_loop(5),
    ],
)
@pytest.mark.parametrize("dense", [True, False])
def test_a_guide_at_rest_stays_where_it_is_and_has_no_slip_velocity(build, dense):
    mechanism = Mechanism(build())
    m = (
        mechanism.arrays.replaced(cell=mechanism.arrays.cell[:0], separate=())
        if dense
        else mechanism.arrays
    )
    (q, v), rests = mechanism.initial_state(), np.arange(len(m.friction)) % 3 == 0
    _, _, w, moved = projected(m, q, v, np.where(rests, 0, 1), True)
    assert (
        max(np.abs(w.phi).max(), np.abs(w.phi_dot).max(), np.abs(w.slip_speed[rests]).max()) < 1e-13
    )
    assert np.abs(moved[rests]).max() < 10 * OFF**2
    _, _, w, moved = projected(m, q, v, np.where(rests, 0, 1), False)
    assert min(np.abs(w.slip_speed[rests]).min(), np.abs(moved[rests]).min()) > 0.01 * OFF
