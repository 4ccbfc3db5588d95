"""Creep laws against engines that have them: a block on a level guide, pushed where its surfaces rub, so that nothing tips it."""

import numpy as np
import pytest

from stiction.comparisons.studies.hold_data import FORMS
from stiction.engines import load_engine
from stiction.scenes import scene_from_dict

MASS, INERTIA, LENGTH, WIDTH, MU, G, STEP = 2.0, 0.1, 0.6, 0.1, 0.2, 9.81, 1e-3
BOUND, CONTACTS = MU * MASS * G, 2
PARTS = [0.1, 0.5, 0.9]
ROUND = 1e-5
"""Of the creep: contacts settle within some hundredths of a second by their own damping, and half a second is left for it."""
linear_zone, soft_norm = FORMS["linear_zone"], FORMS["soft_norm"]


def near_rigid_friction(load, contacts, inverse_mass, step):
    """1e-3 w h F/n: Drake's "sap" contacts, in discrete steps the soft norm's e of the bound if that is more.

    Friction is regularized by R = 1e-3 w, v = R times the impulse h F/n of one of n contacts, w = |W|/3 with W the 3 x 3 block of
    J M^-1 J' (Castro, Permenter & Han 2022, "An unconstrained convex formulation of compliant contact", Sec. V).
    """
    return 1e-3 * inverse_mass * step * load / contacts


def convex_contact(load, contacts, inverse_mass, impedance, damping, impratio):
    """(1/d - 1) a F/(n b r): MuJoCo's contacts with elliptic cones.

    The law is x = accel - aref + R f, and zero inside of the cone, with aref = -b v and R = (1/d - 1) a/r across the normal (manual,
    "Constraint model": solver parameters, ``impratio``). At rest accel = 0, and n contacts share F. a is J M^-1 J' along the normal.
    """
    return (1.0 / impedance - 1.0) * inverse_mass * load / (contacts * damping * impratio)


def creep(name, part, *, mu=MU, dt=STEP, t_end=0.5, **settings):
    """Speed at the end, with this part of the bound as load, m/s."""
    pytest.importorskip({"drake": "pydrake"}.get(name, name))
    scene = scene_from_dict(
        {
            "gravity": [0, -G],
            "bodies": {"slider": {"mass": MASS, "inertia": INERTIA}},
            "joints": {
                "guide": {
                    "type": "translational",
                    "slider": "slider",
                    "direction": [1.0, 0.0],
                    "mu": mu,
                    "length": LENGTH,
                    "width": WIDTH,
                }
            },
            "forces": {
                "push": {
                    "type": "force",
                    "body": "slider",
                    "direction": [1.0, 0.0],
                    "point": [0.0, -WIDTH / 2],
                    "law": {"type": "constant", "value": part * mu * MASS * G},
                }
            },
        }
    )
    return load_engine(name).simulate(scene, dt=dt, t_end=t_end, fidelity="contact", **settings)[
        "guide.slip_velocity"
    ][-1]


def contact_block():
    """J M^-1 J' of a lower corner along normal and guide, 1/kg: the lever of its normal is half the length, of its friction half the width."""
    levers = np.array([LENGTH / 2, WIDTH / 2])
    return np.eye(2) / MASS + np.outer(levers, levers) / INERTIA


@pytest.mark.parametrize("part", PARTS)
class TestInRuns:
    @pytest.mark.parametrize("zone", [1e-3, 1e-4])
    def test_linear_zone(self, part, zone):
        assert creep("exudyn", part, friction_zone=zone) == pytest.approx(
            linear_zone(part, zone), rel=ROUND
        )

    @pytest.mark.parametrize(
        "settings",
        [{}, {"approximation": "similar"}, {"method": "continuous", "dt": None, "rtol": 1e-6}],
    )
    def test_soft_norm(self, part, settings):
        assert creep("drake", part, stiction_tolerance=1e-3, **settings) == pytest.approx(
            soft_norm(part, 1e-3), rel=ROUND
        )

    def test_near_rigid_friction(self, part):
        """The third direction is out of the plane, where nothing moves."""
        w = np.linalg.norm(contact_block()) / 3
        law = {"inverse_mass": w, "step": STEP}
        residual = (
            1e-6 * MU * G * STEP
        )  # Drake's solver ends at 1e-6 of the momenta; here of what friction takes in a step
        assert creep("drake", part, approximation="sap") == pytest.approx(
            near_rigid_friction(part * BOUND, CONTACTS, **law), abs=residual
        )
        floor = near_rigid_friction(BOUND, CONTACTS, **law)
        assert creep("drake", part, stiction_tolerance=1e-9) == pytest.approx(
            soft_norm(part, floor), abs=residual
        )

    @pytest.mark.parametrize("impratio", [1.0, 10.0])
    def test_convex_contact(self, part, impratio):
        law = {"inverse_mass": contact_block()[0, 0], "impratio": impratio}
        of_a_step = creep("mujoco", part, friction_damping="step", impratio=impratio)
        assert of_a_step == pytest.approx(
            convex_contact(part * BOUND, CONTACTS, impedance=2 / 3, damping=1 / STEP, **law),
            rel=ROUND,
        )
        settings = {"time_constant": 0.02, "impedance": 0.95}
        plain = creep("mujoco", part, impratio=impratio, t_end=1.0, **settings)
        assert plain == pytest.approx(
            convex_contact(
                part * BOUND, CONTACTS, impedance=0.95, damping=2 / (0.95 * 0.02), **law
            ),
            rel=ROUND,
        )


def test_the_coefficient_has_no_part_in_it():
    """The same part of the bound at ten times mu."""
    assert creep("exudyn", 0.5, mu=0.05) == pytest.approx(creep("exudyn", 0.5, mu=0.5), rel=ROUND)


def test_an_engine_that_holds_is_found_out():
    """Bullet's friction is a velocity constraint with a bound: to rounding it rests where any of these laws has a creep."""
    assert abs(creep("pybullet", 0.5)) < 1e-12


@pytest.mark.parametrize(
    ("law", "g"), [(linear_zone, lambda x: x), (soft_norm, lambda x: x / np.sqrt(x * x + 1))]
)
def test_the_law_carries_the_load_at_its_creep(law, g):
    for part in (0.0, 1e-6, 0.5, 0.999):
        assert g(law(part, 1e-3) / 1e-3) == pytest.approx(part, rel=1e-9)
