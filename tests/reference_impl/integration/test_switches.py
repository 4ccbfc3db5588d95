"""Laws of time that switch: loads that step, and drives that dwell."""

import numpy as np
import pytest
from fuzz.several_freedoms import RESERVE, differences, random_scene
from hypothesis import given, settings
from hypothesis import strategies as st

from stiction.engines.reference.engine import ReferenceEngine
from stiction.scenes import load_scene, scene_from_dict
from stiction.scenes.laws import evaluate_law
from stiction.scenes.trajectory_file import load_trajectory
from stiction.truths.enumerated_motion import TOLERANCE, simulate

G = 10.0
RTOL = 1e-10


def block(mu, mus, t_end, load=None, drive=None):
    """A block of 1 kg on a horizontal guide, pushed by a load or moved by a drive."""
    raw = {
        "t_end": t_end,
        "gravity": [0, -G],
        "bodies": {"block": {"mass": 1, "inertia": 1}},
        "joints": {"guide": {"type": "translational", "slider": "block", "mu": mu, "mus": mus}},
    }
    if load:
        raw["forces"] = {
            "push": {"type": "force", "body": "block", "direction": [1, 0], "law": load}
        }
    if drive:
        bodies = ["block", "ground"]
        raw["drives"] = {
            "motor": {"type": "distance", "bodies": bodies, "axis": [1, 0], "law": drive}
        }
    return scene_from_dict(raw)


def staircase_motion(times, forces, mu, mus, t_end):
    """Return position, velocity and events of the block under a force that is constant between `times`.

    Each part is a rest, or a motion of constant acceleration that ends at the next time or at rest.
    """
    x = v = 0.0
    events = []
    slip = 0
    for begin, end, force in zip(times, [*times[1:], t_end], forces):
        t = begin
        while t < end:
            if slip == 0:
                if abs(force) <= mus * G:
                    break
                slip = int(np.sign(force))
                events.append((t, "slip"))
            a = force - slip * mu * G
            stop = t - v / a if v * a < 0 else np.inf
            last = min(stop, end)
            x, v = x + v * (last - t) + 0.5 * a * (last - t) ** 2, v + a * (last - t)
            t = last
            if stop <= end:
                v = 0.0
                reverses = abs(force) > mus * G
                events.append((t, "reversal" if reverses else "stick"))
                slip = int(np.sign(force)) if reverses else 0
    return x, v, events


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(0.05, 1.0), min_size=1, max_size=6),
    st.lists(st.floats(-10, 10), min_size=7, max_size=7),
    st.floats(0.1, 0.4),
    st.floats(1.0, 1.5),
)
def test_a_block_under_a_staircase(gaps, forces, mu, ratio):
    """The closed form, event by event. Forces within 1e-6 of the capacity are moved away from it."""
    mus = ratio * mu
    forces = [f + 1e-5 if abs(abs(f) - mus * G) < 1e-6 else f for f in forces]
    times = np.cumsum([0.0, *gaps])
    forces = forces[: len(times)]
    t_end = float(times[-1]) + 1.0
    knots = [0.0, *np.repeat(times[1:], 2), t_end]
    values = np.repeat(forces, 2)
    scene = block(mu, mus, t_end, {"type": "table", "times": knots, "values": values.tolist()})
    run = ReferenceEngine().simulate(scene, rtol=RTOL, output_step=t_end)
    x, v, events = staircase_motion(times.tolist(), forces, mu, mus, t_end)
    # at most 7 parts of 1 s, each wrong by the tolerance of its steps
    assert run["block.x"][-1] == pytest.approx(x, abs=1e3 * RTOL * (1 + abs(x)))
    assert run["block.vx"][-1] == pytest.approx(v, abs=1e3 * RTOL * (1 + abs(v)))
    found = [(event.time, event.kind) for event in run.events if event.time > 0]
    expected = [(t, kind) for t, kind in events if t > 0]
    assert [kind for _, kind in found] == [kind for _, kind in expected]
    np.testing.assert_allclose(
        [t for t, _ in found], [t for t, _ in expected], rtol=0, atol=1e3 * RTOL
    )
    assert [switch.time for switch in run.switches] == times[1:].tolist()


MOVES = {
    "cycloid": {"type": "cycloid", "distance": 0.2, "start": 0.5, "duration": 1.0},
    "trapezoid": {
        "type": "trapezoid",
        "distance": -0.2,
        "start": 0.5,
        "duration": 1.0,
        "ramp": 0.2,
    },
    "polynomial": {"type": "polynomial", "distance": 0.2, "start": 0.5, "duration": 1.0},
    "clamped table": {
        "type": "table",
        "times": [0.5, 0.75, 1.0, 1.5],
        "values": [0, 0.1, 0.15, 0.2],
        "interpolation": "cubic",
        "ends": "clamped",
    },
}


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-9, 1e-10, 1e-12])
@pytest.mark.parametrize("name", MOVES)
def test_a_block_that_a_drive_moves_between_dwells(name, rtol):
    """It rests exactly during the dwells; in between the effort is m a + mu m g sgn(v), also at both ends."""
    mu, t_end = 0.3, 2.0
    scene = block(mu, mu, t_end, drive=MOVES[name])
    run = ReferenceEngine().simulate(scene, rtol=rtol, output_step=0.03125)
    assert [(event.kind, event.time) for event in run.events] == [("slip", 0.5), ("stick", 1.5)]
    moves = (run.t >= 0.5) & (run.t < 1.5)
    np.testing.assert_array_equal(run["guide.mode"] != 0, moves)
    # the rounding of the law at the end of the move
    np.testing.assert_allclose(run["block.vx"][~moves], 0.0, rtol=0, atol=1e-14)

    law = scene.drives["motor"].law
    x, v, a = np.array([evaluate_law(law, t) for t in run.t]).T
    direction = np.sign(law.values[-1] if name == "clamped table" else law.distance)
    # within a step, the samples have the error of its dense output
    np.testing.assert_allclose(run["block.x"], x, rtol=0, atol=10 * rtol)
    expected = a + direction * mu * G
    np.testing.assert_allclose(run["motor.effort"][moves], expected[moves], rtol=0, atol=1e-9)
    # while both are at rest, a motor and friction share the load in any way
    assert np.isnan(run["motor.effort"][~moves]).all()


def slider_crank_that_dwells():
    """The slider-crank of the catalogue with friction in its guide, and a motor that rises, dwells and returns."""
    scene = load_scene("slider-crank")
    crank = scene.drives["motor"]
    terms = [
        {"type": "cycloid", "distance": 2.0, "start": 0.1, "duration": 0.3},
        {"type": "polynomial", "distance": -2.0, "start": 0.6, "duration": 0.2},
    ]
    at_rest = {
        name: body.model_copy(update={"velocity": (0.0, 0.0), "angular_velocity": 0.0})
        for name, body in scene.bodies.items()
    }
    start, *_ = evaluate_law(crank.law, 0.0)
    law = {"type": "sum", "terms": [{"type": "constant", "value": start}, *terms]}
    raw = scene.model_copy(update={"bodies": at_rest}).model_dump(mode="json")
    raw["drives"]["motor"]["law"] = law
    raw["joints"]["guide"]["mu"] = 0.2
    raw["joints"]["guide"]["mus"] = 0.2
    return scene_from_dict(raw, "slider-crank that dwells")


def test_a_slider_crank_that_dwells():
    """The slider follows the closed form of its kinematics, and rests exactly in the dwells."""
    moving = slider_crank_that_dwells()
    run = ReferenceEngine().simulate(moving, t_end=1.0, rtol=1e-10, output_step=0.0125)
    assert run.breakdown is None

    # The slider's position by its kinematics: two lengths and the angle of the crank.
    a, b = _lengths(moving)
    angle = np.array([evaluate_law(moving.drives["motor"].law, t)[0] for t in run.t])
    x = a * np.cos(angle) + np.sqrt(b**2 - (a * np.sin(angle)) ** 2)
    offset = run["slider.x"][0] - x[0]
    np.testing.assert_allclose(run["slider.x"] - offset, x, rtol=0, atol=1e-9)
    dwells = (run.t < 0.1) | ((run.t >= 0.4) & (run.t < 0.6)) | (run.t >= 0.8)
    np.testing.assert_array_equal(run["guide.mode"][dwells], 0)
    assert np.all(run["guide.mode"][~dwells & (run.t > 0.1)] != 0)
    assert np.max(np.abs(run["guide.slip_velocity"][dwells])) < 1e-13
    kinds = [event.kind for event in run.events if event.kind != "corner"]
    assert kinds == ["slip", "stick", "slip", "stick"]


def _lengths(scene):
    """Return the lengths of crank and rod, m."""
    lengths = []
    for body in ("crank", "rod"):
        points = [
            joint.points[joint.bodies.index(body)]
            for joint in scene.pins.values()
            if body in joint.bodies
        ]
        lengths.append(float(np.hypot(*np.subtract(*points))))
    return lengths


def scene_with_switches(seed, i):
    """Random scene i whose loads step, and are constant in between."""
    scene = random_scene(seed, i)
    rng = np.random.default_rng((seed, i, 7))
    raw = scene.model_dump(mode="json")
    for load in raw["forces"].values():
        size, *_ = np.abs(evaluate_law(scene.forces[next(iter(scene.forces))].law, 0.3))
        times = np.sort(rng.uniform(0.05, 0.55, 3))
        knots = [0.0, *np.repeat(times, 2), 2.0]
        values = np.repeat(rng.normal(scale=max(size, 1.0), size=4), 2)
        load["law"] = {"type": "table", "times": knots, "values": values.tolist()}
    return scene_from_dict(raw, f"random scene {i} of seed {seed} with switches")


@pytest.mark.parametrize("i", range(4))  # hundreds in the long tests
def test_random_mechanisms_under_steps(i):
    _agrees(scene_with_switches(3, i), 0.6)


@pytest.mark.long
@pytest.mark.parametrize("block_of_scenes", range(10))
def test_hundreds_of_random_mechanisms_under_steps(block_of_scenes):
    for i in range(100, 300)[block_of_scenes::10]:
        _agrees(scene_with_switches(4, i), 0.6)


def _agrees(scene, t_end):
    motion = simulate(scene, t_end)
    assert motion.violation < RESERVE * TOLERANCE
    run = ReferenceEngine().simulate(
        scene, t_end=t_end, rtol=1e-10, stabilization="projection", output_step=t_end
    )
    assert run.breakdown or not motion.breakdown
    assert differences(scene, motion, run, 1e-10) == []


def test_switches_are_stored_with_both_sides(tmp_path):
    load = {"type": "table", "times": [0, 1, 1, 2], "values": [2, 2, 5, 5]}
    run = ReferenceEngine().simulate(block(0.3, 0.3, 2.0, load), output_step=0.5)
    [switch] = run.switches
    assert (switch.time, switch.kind, switch.joint) == (1.0, "switch", "push")
    assert switch.before["guide.friction"] == pytest.approx(-2.0)
    assert switch.jump("block.ax") == pytest.approx(2.0)
    run.save(tmp_path / "run.parquet")
    assert load_trajectory(tmp_path / "run.parquet").switches == run.switches
    # the output sample, and both sides of the break-away and of the switch
    accelerations = run.to_frame(events=True).set_index("t")["block.ax"][1.0]
    assert accelerations.tolist() == pytest.approx([2.0, 0.0, 2.0, 0.0, 2.0])
