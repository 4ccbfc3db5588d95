"""Driven mechanisms with frictional guides beside all forces that obey Coulomb's law in their motion."""

from collections import Counter

import numpy as np
import pytest

from fuzz.driven_mechanisms import ROWS, T_END, check, draw, draw_with_dry_pins, dwells
from fuzz.seeds import seed_or_fresh
from stiction.engines.protocol import BadTrajectory
from stiction.engines.reference.engine import ReferenceEngine

SETTINGS = {
    solver: {"rtol": 1e-9, "solver": solver}
    for solver in ("automatic", "lemke", "enumeration", "trial")
}
SETTINGS["paper"] = {"dt": T_END / 400}


def checked(seed, count, names):
    """What is wrong in so many scenes, each with what repeats it, and what rows were met."""
    wrong, met = [], Counter()
    for index in range(count):
        family, scene = draw(seed, index)
        for name in names:
            try:
                run = ReferenceEngine().simulate(
                    scene, t_end=T_END, output_step=T_END / ROWS, **SETTINGS[name]
                )
            except BadTrajectory as error:
                wrong.append(f"driven_mechanisms.draw({seed}, {index}), {family}, {name}: {error}")
                continue
            found, rows = check(scene, run)
            met += rows
            wrong += [
                f"driven_mechanisms.draw({seed}, {index}), {family}, {name}: {word}"
                for word in found
            ]
    return wrong, met


@pytest.mark.parametrize(
    ("seed", "count", "names"),
    [
        (1, 30, ["automatic"]),
        (2, 6, list(SETTINGS)),
        pytest.param(None, 2000, ["automatic"], marks=pytest.mark.long),
        pytest.param(None, 400, list(SETTINGS), marks=pytest.mark.long),
    ],
)
def test_forces_are_all_that_obey_the_law(seed, count, names):
    seed = seed_or_fresh(seed)
    wrong, met = checked(seed, count, names)
    assert not wrong, "\n".join(wrong)
    assert met["1 solutions"] > 5 * count


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 8), pytest.param(None, 100, marks=pytest.mark.long)]
)
def test_slider_cranks_with_friction_in_guide_and_pins(seed, count):
    """Constant bounds shift the loads: forces exist, and are unique, where the second method finds them so."""
    seed, wrong, met = seed_or_fresh(seed), [], Counter()
    for index in range(count):
        scene = draw_with_dry_pins(seed, index)
        try:
            run = ReferenceEngine().simulate(
                scene, t_end=T_END, output_step=T_END / ROWS, rtol=1e-9
            )
        except BadTrajectory as error:
            wrong.append(f"draw_with_dry_pins({seed}, {index}): {error}")
            continue
        found, rows = check(scene, run)
        met += rows
        wrong += [f"draw_with_dry_pins({seed}, {index}): {word}" for word in found]
    assert not wrong, "\n".join(wrong)
    assert met["1 solutions"] > 5 * count


@pytest.mark.parametrize(
    ("seed", "index"),
    [
        (5, 222),  # steps went over the jam, and friction acted along the slip
        (5, 3),  # two solutions meet where a normal force is zero, and end
        (5, 4),  # so they do, and a third goes on
        (5, 77),  # a force grows without bound, and another solution goes on
        (5, 53),  # four solutions with a moment that is zero in all of them
        (9, 1045),  # guides without any load beside one whose force passes zero
        (9, 1179),
    ],
)  # two corner forces pass zero one after the other
def test_what_failed_before(seed, index):
    _, scene = draw(seed, index)
    run = ReferenceEngine().simulate(scene, t_end=T_END, output_step=T_END / ROWS, rtol=1e-9)
    found, _ = check(scene, run)
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("seed", "count"), [(3, 10), pytest.param(None, 300, marks=pytest.mark.long)]
)
def test_motors_that_dwell_leave_open_what_they_share(seed, count):
    seed = seed_or_fresh(seed)
    for index in range(count):
        family, scene = draw(seed, index)
        scene = dwells(scene)
        run = ReferenceEngine().simulate(scene, t_end=0.1, output_step=0.05, rtol=1e-9)
        found, met = check(scene, run)
        assert not found and not run.events and met["at rest"] == len(run.t), (
            f"draw({seed}, {index}), {family}: {found}"
        )
        assert np.max(run["drift.position"]) < 1e-12
