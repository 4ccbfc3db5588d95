"""The example solvers, built and run: right on the slider-bar as far as their order goes, and by every law of the format."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from reference_checks import LAWS

from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.engines import Refused, load_engine
from stiction.scenes import load_scene, scene_from_dict
from stiction.scenes.laws import evaluate_law

SOLVERS = Path(__file__).parents[3] / "docs" / "examples" / "solvers"


@pytest.fixture(scope="session")
def solvers(tmp_path_factory):
    """A copy of their folder, C built as its page says."""
    folder = tmp_path_factory.mktemp("solvers") / "solvers"
    shutil.copytree(SOLVERS, folder, ignore=shutil.ignore_patterns("solver"))
    if shutil.which("cc"):
        subprocess.run(
            [
                "cc",
                "-std=c99",
                "-Wall",
                "-Wextra",
                "-Werror",
                "-Wno-missing-field-initializers",
                "-O2",
                "-o",
                "solver",
                "solver.c",
                "-lm",
            ],
            cwd=folder,
            check=True,
        )
    return folder


@pytest.fixture(params=["c", "python", "octave"])
def solver(request, solvers):
    needed = {"c": "cc", "python": "python3", "octave": "octave-cli"}[request.param]
    if not shutil.which(needed):
        pytest.skip(f"no {needed} on the path: the example solver in {request.param} is not run")
    return str(solvers / f"{request.param}.toml")


@pytest.mark.parametrize("case", [1, 3])
def test_slider_bar_within_the_error_of_events_a_step_late(solver, case):
    """An event may be up to h late. The slider then has the acceleration of before for too long: its velocity is off by h |jump of it| from
    each event on, its position by that times the time since. The smooth motion between them adds errors of second order: h^2 times the
    largest third derivative, over the time."""
    scene, t_end, h = (
        load_scene(f"slider-bar-case-{case}"),
        1.2,
        5e-3 if "octave" in Path(solver).name else 1.25e-3,
    )
    truth = ground_truth(scene)
    found = load_engine(solver).simulate(scene, t_end=t_end, dt=h)
    t, exact = found.t, truth(found.t)
    third = max(np.max(np.abs(np.gradient(exact[f"{body}.ax"], t))) for body in scene.bodies)
    events = [(event.time, abs(event.jump("slider.ax"))) for event in truth.events]
    assert any(time < t_end and jump > 0 for time, jump in events)
    for column, power in (("slider.vx", 0), ("slider.x", 1)):
        late = sum(h * jump * (t - time + h) ** power * (t >= time - h) for time, jump in events)
        assert np.all(
            np.abs(found[column] - exact[column])
            <= late + h**2 * third * np.maximum(t, h) ** (1 + power)
        ), column


def test_every_law_as_a_torque_and_as_a_drive(solver):
    """A torque makes the angular acceleration, here the mean of its values half a step before and behind; a drive sets the angular velocity
    at the end of a step to its rate (the steps make up for an angle that is off by the rounding of the midpoint rule, h^2)."""
    bodies = {f"b{i}": {"mass": 1, "inertia": 0.5, "position": [i, 0]} for i in range(len(LAWS))}
    spun = scene_from_dict(
        {
            "t_end": 1,
            "bodies": bodies,
            "forces": {
                f"f{i}": {"type": "torque", "body": f"b{i}", "law": law}
                for i, law in enumerate(LAWS)
            },
        },
        name="torques",
    )
    h = 0.01
    found = load_engine(solver).simulate(spun, dt=h, output_step=h)
    for i, load in enumerate(spun.forces.values()):
        values = [
            np.mean(
                [evaluate_law(load.law, t + side * h / 2)[0] for side in ((-1, 1) if k else (1,))]
            )
            / 0.5
            for k, t in enumerate(found.t)
        ]
        np.testing.assert_allclose(found[f"b{i}.alpha"], values, rtol=1e-9, atol=1e-9)
    for law in LAWS:
        if law.get("interpolation") == "linear":
            continue
        probe = (
            scene_from_dict(
                {
                    "bodies": {"b": bodies["b0"]},
                    "forces": {"f": {"type": "torque", "body": "b", "law": law}},
                }
            )
            .forces["f"]
            .law
        )
        start, rate, _ = evaluate_law(probe, 0.0)
        driven = scene_from_dict(
            {
                "t_end": 1,
                "bodies": {"b": {**bodies["b0"], "angle": start, "angular_velocity": rate}},
                "drives": {"motor": {"type": "angle", "bodies": ["b", "ground"], "law": law}},
            },
            name="driven",
        )
        found = load_engine(solver).simulate(driven, dt=h, output_step=h)
        angles, rates, seconds = np.array([evaluate_law(probe, t) for t in found.t]).T
        size = np.max(np.abs(np.gradient(seconds, found.t)), initial=0.0) + np.max(np.abs(seconds))
        assert np.max(np.abs(found["b.angle"] - angles)) <= h**2 * size + 1e-12
        assert np.max(np.abs(found["b.omega"] - rates)) <= h * size + 1e-12


def test_redundant_constraints_are_refused(solver):
    with pytest.raises(Refused, match="depend on each other"):
        load_engine(solver).simulate(load_scene("hard/parallelogram-flat"), t_end=0.1, dt=1e-2)
