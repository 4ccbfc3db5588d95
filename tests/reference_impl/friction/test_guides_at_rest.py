"""Which guides rest and leave together, on mechanisms whose freedoms are counted by hand.

A rod of length L whose ends slide in two guides has one freedom: the rod's angle p. Both slip velocities are a factor times p', so that
both guides are held or none is, whatever rounding says of either.

A block B of mass m that lies on a block A of mass m on the ground has two freedoms. A load F on B is passed on to A whole, so that B leaves A
at mus_B m g, and A the ground at mus_A 2 m g. If the second is just the larger, B leaves first. With mu below mus the law would allow A to
leave in its place: B + A then accelerate by (F - 2 mu_A m g) / (2 m), and what B needs to go along with A is less than F.
"""

import numpy as np
import pytest
from reference_checks import simulate

from stiction.reference_impl.multibody.mechanism import Mechanism
from stiction.scenes import scene_from_dict

L, G = 1.0, 9.81
TOLERANCES, STABILIZATIONS = (1e-6, 1e-9, 1e-12), ("none", "baumgarte", "projection")


def falling_rod(turn: float) -> dict:
    """A rod between two sliders in guides along `turn` and at a right angle to it, falling from 60 degrees."""
    c, s = np.cos(turn), np.sin(turn)

    def at(x: float, y: float) -> list[float]:
        return [float(c * x - s * y), float(s * x + c * y)]

    p, slider = np.deg2rad(60.0), {"mass": 0.5, "inertia": 1e-3, "angle": turn}
    guide = {"type": "translational", "length": 0.1, "width": 0.05, "mu": 0.1, "angle": 0.0}
    return {
        "gravity": at(0.0, -9.81),
        "bodies": {
            "rod": {
                "mass": 1.0,
                "inertia": L**2 / 12,
                "position": at(L / 2 * np.cos(p), L / 2 * np.sin(p)),
                "angle": float(np.pi - p + turn),
            },
            "A": {**slider, "position": at(L * np.cos(p), 0.0)},
            "B": {**slider, "position": at(0.0, L * np.sin(p))},
        },
        "joints": {
            "pin-a": {"type": "revolute", "bodies": ["rod", "A"], "points": [[-L / 2, 0], [0, 0]]},
            "pin-b": {"type": "revolute", "bodies": ["rod", "B"], "points": [[L / 2, 0], [0, 0]]},
            "along": {**guide, "slider": "A", "direction": at(1.0, 0.0), "angle": turn},
            "across": {**guide, "slider": "B", "direction": at(0.0, 1.0), "angle": turn},
        },
    }


@pytest.mark.parametrize("stabilization", STABILIZATIONS)
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_both_guides_of_one_freedom_stop_and_stay_together(turn, stabilization):
    found = []
    for rtol in TOLERANCES:
        run = simulate(
            scene_from_dict(falling_rod(turn), "rod"),
            t_end=5.0,
            rtol=rtol,
            output_step=0.05,
            stabilization=stabilization,
        )
        assert run.breakdown is None
        last = [event for event in run.events if event.kind != "corner"][-2:]
        assert [event.kind for event in last] == ["stick", "stick"] and last[0].time == last[1].time
        resting = run.t > last[0].time
        for name in ("along", "across"):
            assert np.all(run[f"{name}.mode"][resting] == 0)
            # rounding of the speeds of some m/s, which nothing makes grow
            assert np.max(np.abs(run[f"{name}.slip_velocity"][resting])) < 1e-12
        found.append(
            (
                [(event.kind, event.joint) for event in run.events],
                last[0].time,
                [run[f"{name}.normal_force"][-1] for name in ("along", "across")],
            )
        )
    tight = found[-1]
    for rtol, (kinds, time, normal) in zip(TOLERANCES, found):
        assert kinds == tight[0]
        assert abs(time - tight[1]) < 1e3 * rtol
        assert np.allclose(normal, tight[2], rtol=1e3 * rtol, atol=0.0)


def test_rods_that_springs_connect_stop_each_at_its_own_time():
    """A mechanism of several cells (`banded_systems`): soft springs join the rods, no row does."""
    scene, count = {"gravity": [0, -9.81], "bodies": {}, "joints": {}, "springs": {}}, 4
    for k in range(count):
        rod = falling_rod(0.3 * k)
        scene["bodies"] |= {
            f"{name}{k}": {**body, "position": [body["position"][0] + 5.0 * k, body["position"][1]]}
            for name, body in rod["bodies"].items()
        }
        for name, joint in rod["joints"].items():
            joint = (
                {**joint, "bodies": [f"{body}{k}" for body in joint["bodies"]]}
                if "bodies" in joint
                else {**joint, "slider": f"{joint['slider']}{k}", "point": [5.0 * k, 0.0]}
            )
            scene["joints"][f"{name}{k}"] = joint
        turned = (
            [[0, -9.81]] if k == 0 else [[9.81 * np.sin(0.3 * k), -9.81 * np.cos(0.3 * k) + 9.81]]
        )
        scene.setdefault("forces", {}).update(
            {
                f"{name}{k}": {
                    "type": "force",
                    "body": name,
                    "direction": turned[0],
                    "law": {
                        "type": "constant",
                        "value": float(body["mass"] * np.hypot(*turned[0])),
                    },
                }
                for name, body in scene["bodies"].items()
                if name.endswith(str(k)) and k > 0
            }
        )
    scene["springs"] = {
        f"link{k}": {
            "type": "linear",
            "bodies": [f"rod{k}", f"rod{k + 1}"],
            "stiffness": 1e-3,
            "rest_length": 5.0,
        }
        for k in range(count - 1)
    }
    run = simulate(scene_from_dict(scene, "rods"), t_end=6.0, rtol=1e-9, output_step=0.05)
    assert run.breakdown is None
    stops = {}
    for k in range(count):
        own = [
            event
            for event in run.events
            if event.joint in (f"along{k}", f"across{k}") and event.kind != "corner"
        ][-2:]
        assert [event.kind for event in own] == ["stick", "stick"] and own[0].time == own[1].time
        stops[k] = own[0].time
        for name in (f"along{k}", f"across{k}"):
            assert np.max(np.abs(run[f"{name}.slip_velocity"][run.t > stops[k]])) < 1e-12
    assert len(set(stops.values())) == count


def test_guides_of_one_freedom_in_a_large_cell_stop_and_stay_together():
    """The falling rod with a light chain of 12 pendulums on its end: one cell that is solved as a band."""
    turn, scene, held = 0.7, falling_rod(0.7), "A"
    (x, y), down = scene["bodies"]["A"]["position"], (np.sin(turn), -np.cos(turn))
    for k in range(12):
        middle = [float(x + 0.05 * (2 * k + 1) * down[0]), float(y + 0.05 * (2 * k + 1) * down[1])]
        scene["bodies"][f"link{k}"] = {
            "mass": 1e-3,
            "inertia": 1e-6,
            "position": middle,
            "angle": turn,
        }
        scene["joints"][f"hinge{k}"] = {
            "type": "revolute",
            "bodies": [f"link{k}", held],
            "points": [[0, 0.05], [0, -0.05] if k else [0, 0]],
        }
        held = f"link{k}"
    scene = scene_from_dict(scene, "rod-with-chain")
    assert len(Mechanism(scene).arrays.cell) == 1
    run = simulate(
        scene, t_end=4.6, rtol=1e-6, output_step=0.01, stabilization="projection"
    )  # it comes to rest at 4.2 s
    changes = {
        guide: [
            (event.kind, event.time)
            for event in run.events
            if event.joint == guide and event.kind in ("stick", "slip")
        ]
        for guide in ("along", "across")
    }
    assert len(changes["along"]) >= 8 and changes["along"] == changes["across"]


def stacked(kinetic: float) -> dict:
    """Two blocks of 1 kg, one on the other, with a growing load on the upper; friction while slipping is `kinetic` times that at rest."""
    guide = {"type": "translational", "direction": [1, 0]}
    return {
        "gravity": [0, -G],
        "bodies": {"A": {"mass": 1.0, "inertia": 0.01}, "B": {"mass": 1.0, "inertia": 0.01}},
        "joints": {
            "ground-A": {**guide, "slider": "A", "mu": kinetic * 0.202, "mus": 0.202},
            "A-B": {**guide, "slider": "B", "guide": "A", "mu": kinetic * 0.4, "mus": 0.4},
        },
        "forces": {
            "load": {
                "type": "force",
                "body": "B",
                "direction": [1, 0],
                "law": {"type": "sine", "amplitude": 5.0, "frequency": 1.0},
            }
        },
    }


@pytest.mark.parametrize(("kinetic", "others"), [(1.0, 0), (0.5, 1)])
def test_a_break_away_says_where_another_mode_was_consistent(kinetic, others):
    run = simulate(scene_from_dict(stacked(kinetic), "stacked"), t_end=1.5, rtol=1e-9)
    first = run.events[0]
    assert (first.kind, first.joint, first.other_modes) == ("slip", "A-B", others)
    assert first.time == pytest.approx(np.arcsin(0.4 * G / 5.0), abs=1e-9)
    assert first.after["ground-A.mode"] == 0
