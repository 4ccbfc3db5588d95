"""Random mechanisms: what must hold for all of them, checked from the scene and the columns alone.

Where several guides carry each other the equations may have two solutions or none (Painleve), which the reference reports and these tests
leave out. That guises of a mechanism agree is checked in test_guises.py.
"""

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from random_mechanisms import SeededDice, moderate_scene
from reference_checks import balance_residual, energy_defect

from stiction.comparisons.hard.checks import friction_excess
from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.integration.coulomb_audit import audit
from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import scene_from_dict

T_END, RTOL = 1.5, 1e-9
mechanisms = st.integers(0, 2**32 - 1).map(lambda seed: moderate_scene(SeededDice(seed)))


def run(raw):
    scene = scene_from_dict(raw)
    trajectory = ReferenceEngine().simulate(
        scene, t_end=T_END, rtol=RTOL, stabilization="projection", output_step=0.03
    )
    assume(
        not trajectory.termination.startswith(
            (
                "no solution of the HLCP was found",
                "the HLCP has several solutions",
                "contact modes follow each other",
            )
        )
    )
    assert trajectory.termination == "end"
    return scene, trajectory


# some 25 hold each kind of joint, spring and law several times
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(mechanisms)
def test_forces_balance_and_obey_coulomb_and_energy_is_accounted_for(raw):
    scene, trajectory = run(raw)
    # momentum: rounding of the linear solves, with a reserve of 10^4 over one epsilon for ill-conditioned mechanisms
    assert balance_residual(scene, trajectory.t, trajectory.columns) < 2e-12
    assert (
        friction_excess(scene, trajectory.columns) < 1e-9
    )  # moments of rounding size, divided by short sliders
    for name in scene.frictional_guides:
        mode, speed = trajectory[f"{name}.mode"], trajectory[f"{name}.slip_velocity"]
        # a stuck slider creeps by the integration error only, a slipping one slips in the direction of its mode
        size = 1 + np.max(np.abs(speed))
        assert np.all(np.abs(speed[mode == 0]) < 1e3 * RTOL * size)
        assert np.all(mode * speed >= -1e3 * RTOL * size)
    mechanism = Mechanism(scene, "projection")
    found = audit(trajectory, mechanism, 40)
    assert found.unsolved == 0
    assert found.complementarity < 1e-10
    # the frozen mode has the accelerations of the complementarity problem
    assert found.acceleration < 1e-8
    # T + V against the work of friction, drive, dampers and loads: the local tolerance times the number of steps, with
    # a reserve for forces that change fast within a panel of the quadrature
    assert energy_defect(scene, T_END, RTOL) < 1e-6
