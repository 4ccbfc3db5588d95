"""Settings and arguments that an engine does not have are errors that say what was found and what was expected."""

import pytest
from conftest import installed

from stiction.scenes import InputError, load_scene

FIXED_STEP = ("pymunk", "pybullet", "mujoco", "drake", "dart")
JOINT, CONTACT, BRISTLES = {}, {"fidelity": "contact"}, {"method": "bristles"}
CONTINUOUS = {"fidelity": "contact", "method": "continuous"}
ACCELERATIONS = {"method": "accelerations"}
WRONG = [
    (FIXED_STEP, JOINT, {"speed": 3}, "speed: .* has no such setting at joint fidelity; expected one of .*passes"),
    (FIXED_STEP, JOINT, {"passes": 0}, "passes: found 0; expected a whole number >= 1"),
    (FIXED_STEP, JOINT, {"passes": 2.5}, "passes: found 2.5"),
    (FIXED_STEP, JOINT, {"rtol": 1e-6}, "rtol: found 1e-06; .* has a fixed step, expected dt"),
    (FIXED_STEP, JOINT, {"dt": -1.0}, "dt: found -1.0; expected seconds, > 0"),
    (FIXED_STEP, JOINT, {"t_end": float("nan")}, "t_end: found nan"),
    (FIXED_STEP, JOINT, {"output_step": 0.0}, "output_step: found 0.0"),
    (FIXED_STEP[1:], ACCELERATIONS, {"dt": 1e-3}, "method=accelerations: found dt"),
    (FIXED_STEP[1:], ACCELERATIONS, {"rtol": 1e-6, "fidelity": "contact"}, "method=accelerations: .*; expected rtol alone"),
    (FIXED_STEP[1:], ACCELERATIONS, {"rtol": 1e-6, "iterations": 5}, "method=accelerations: .*; expected rtol alone"),
    (("mujoco",), JOINT, {"impedance": 1.0}, "MuJoCo's own limit"),
    (("mujoco",), JOINT, {"impedance": 0.0}, "impedance: found 0.0"),
    (("mujoco",), JOINT, {"solver": "Dantzig"}, "solver: found 'Dantzig'; expected one of PGS, Newton, CG"),
    (("mujoco",), CONTACT, {"noslip": "on"}, "no such setting at contact fidelity"),
    (("mujoco",), CONTACT, {"solver": "PGS"}, "expected one of Newton, CG"),
    (("mujoco",), CONTACT, {"impedance": 1.0}, "MuJoCo's own limit"),
    (("mujoco",), CONTACT, {"slip_reference": 0.9}, "slip_reference: found 0.9; expected at least 1"),
    (("mujoco",), CONTACT, {"impratio": 0.0}, "impratio: found 0.0; expected a number > 0"),
    (("mujoco",), CONTACT, {"noslip_iterations": 10}, "noslip_iterations: found 10 with elliptic cones; expected cone=pyramidal"),
    (("dart",), CONTACT, {"iterations": 0}, "iterations: found 0; expected a whole number"),
    (("dart",), CONTACT, {"shape": "capsule"}, "expected one of spheres, box"),
    (("dart",), CONTACT, {"detector": "bullet"}, "expected one of ODE, FCL, Bullet, DART"),
    (("dart",), CONTACT, {"passes": 2}, "no such setting at contact"),
    *((("drake",), CONTACT, {name: 0.0}, f"{name}: found 0.0; expected a number > 0") for name in ("near_rigid", "stiction_tolerance")),
    (("drake",), CONTINUOUS, {"dt": 1e-3}, "found dt or joint fidelity"),
    (("drake",), CONTINUOUS, {"fidelity": "joint"}, "found dt or joint fidelity"),
    (("drake",), CONTINUOUS, {"passes": 2}, "passes: drake has no such setting"),
    *((("drake",), CONTINUOUS, {name: 0.0}, f"{name}: found 0.0") for name in ("stiffness", "stiction_tolerance", "longest_step")),
    (("exudyn",), JOINT, {"rtol": 1e-6}, "rtol"),
    (("exudyn",), JOINT, {"dt": 0.0}, "dt"),
    (("exudyn",), JOINT, {"iterations": 3}, "iterations.*spectral_radius"),
    (("exudyn",), JOINT, {"spectral_radius": 1.5}, "spectral_radius: found 1.5; expected 0 .. 1"),
    (("exudyn",), JOINT, {"output_step": -1.0}, "output_step"),
    (("exudyn",), JOINT, {"contact_stiffness": 1e6}, "contact_stiffness"),
    (("exudyn",), BRISTLES, {"fidelity": "contact"}, "no such setting at contact"),
    (("exudyn",), BRISTLES, {"bristle_stiffness": -1.0}, "bristle_stiffness"),
    (("exudyn",), BRISTLES, {"integrator": "euler"}, "found 'euler'; expected one of generalized-alpha"),
    (("exudyn",), BRISTLES, {"contact_stiffness": 1e7}, "no such setting"),
    (("siconos",), CONTACT, {"theta": 0.4}, "theta: found 0.4; expected 0.5 .. 1"),
    (("siconos",), CONTACT, {"theta": "abc"}, "theta: found 'abc'; expected a number"),
    (("siconos",), CONTACT, {"clearance": 0.0}, "clearance: found 0"),
    (("siconos",), CONTACT, {"block": "newton"}, "block: found 'newton'; expected one of nsgs"),
    (("siconos",), CONTACT, {"iterations": 2.5}, "iterations: found 2.5; expected a whole number")]


@pytest.mark.parametrize(("engine", "chosen", "settings", "words"), [(engine, *row) for engines, *row in WRONG for engine in engines])
def test_bad_settings(engine, chosen, settings, words):
    with pytest.raises(InputError, match=words):
        installed(engine).simulate(load_scene("slider-bar-case-1-mus-equals-mu"), **{"t_end": 0.1, **chosen, **settings})
