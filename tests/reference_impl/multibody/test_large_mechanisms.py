"""Large scenes: parts that do not act on each other, and mechanisms whose rows form cells and bands."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from mechanism_families import barred_chain, closed_loop, independent_slider_bars, sprung_chain
from reference_checks import energy_defect
from scipy.integrate import solve_ivp

from stiction.engines.reference.engine import ReferenceEngine
from stiction.reference_impl.friction.mode_choice import choose_mode
from stiction.reference_impl.friction.uniqueness import gain_of_mode
from stiction.reference_impl.integration.right_hand_side import right_hand_side
from stiction.reference_impl.multibody.mechanism import DENSE, MOST_ROWS, Mechanism, workspace
from stiction.reference_impl.multibody.subsystems import independent_parts
from stiction.scenes import SceneError, load_scene, scene_from_dict, vary
from stiction.truths import slider_bar_truth

ENGINE = ReferenceEngine()


def together(first, second):
    """The elements of two scenes in one scene that has all else from the first."""
    tables, more = (scene.model_dump(exclude_none=True) for scene in (first, second))
    for section in ("bodies", "joints", "drives", "springs", "forces"):
        tables[section] |= more[section]
    return scene_from_dict(tables, "together")


@pytest.mark.parametrize("apart", [1e-9, 1e-7, 1e-5, 1e-3])
def test_events_of_different_guides_are_told_apart_however_near(apart):
    """Springs without stiffness make four slider-bars one mechanism, in which each moves as it would alone.

    At this rtol an event is good to 4e-11 s against the truth, in either run.
    """
    run = ENGINE.simulate(
        sprung_chain(4, stiffness=0.0, damping=0.0, phase=apart), t_end=8, rtol=1e-9, output_step=8
    )
    for k in range(4):
        change = {"stabilization": {"method": "projection"}, "load.phase": apart * k}
        alone = ENGINE.simulate(
            load_scene("slider-bar-case-1", change), t_end=8, rtol=1e-9, output_step=8
        )
        own = [event for event in run.events if event.joint == f"guide{k}"]
        assert [event.kind for event in own] == [event.kind for event in alone.events]
        assert np.allclose(
            [event.time for event in own],
            [event.time for event in alone.events],
            rtol=0,
            atol=1e-10,
        )
    assert run.cost.counters["rejected"] < len(run.events) / 4


class TestIndependentParts:
    @pytest.mark.parametrize("arguments", [{"rtol": 1e-9}, {"dt": 1e-2}])
    def test_each_moves_as_it_would_alone(self, arguments):
        changes = [{}, {"load1.amplitude": 4}, {"guide2.mu": 0.01}]
        whole = vary(
            independent_slider_bars(3),
            {key: value for change in changes for key, value in change.items()},
        )
        run = ENGINE.simulate(whole, t_end=6, **arguments)
        total = 0
        for k, change in enumerate(changes):
            own = {key.replace(str(k), ""): value for key, value in change.items()}
            alone = ENGINE.simulate(
                load_scene("slider-bar-case-1", {"stabilization": {"method": "projection"}, **own}),
                t_end=6,
                **arguments,
            )
            for name, values in alone.columns.items():
                if not name.startswith("drift."):
                    element, _, column = name.partition(".")
                    assert np.array_equal(run[f"{element}{k}.{column}"], values)
            times = [event.time for event in run.events if event.joint == f"guide{k}"]
            assert times == [event.time for event in alone.events]
            total += alone.cost.counters["rhs"]
        assert run.cost.counters["rhs"] == total
        assert all(a.time <= b.time for a, b in pairwise(run.events))

    def test_columns_in_the_order_of_the_scene(self):
        scene = independent_slider_bars(2)
        run = ENGINE.simulate(scene, t_end=0.1, rtol=1e-6)
        elements = list(dict.fromkeys(name.partition(".")[0] for name in run.columns))
        assert elements == [*scene.bodies, *scene.joints, *scene.drives, "drift"]
        frame = run.to_frame(events=True)
        assert list(frame.columns[1:]) == list(run.columns)

    def test_springs_connect_and_the_ground_does_not(self):
        assert len(independent_parts(independent_slider_bars(4))) == 4
        assert len(independent_parts(sprung_chain(4))) == 1

    def test_breakdown_of_one_ends_all(self):
        broken = load_scene("uniqueness-lost")
        alone = ENGINE.simulate(broken, t_end=broken.t_end, rtol=1e-8)
        assert alone.breakdown is not None
        shared = {key: broken._raw.get(key) for key in ("gravity", "stabilization")}
        other = vary(independent_slider_bars(1), shared)
        for whole in (together(broken, other), together(other, broken)):
            run = ENGINE.simulate(whole, t_end=broken.t_end, rtol=1e-8)
            assert (
                run.breakdown.kind == alone.breakdown.kind
                and run.breakdown.guide == alone.breakdown.guide
            )
            assert run.breakdown.time == pytest.approx(alone.breakdown.time, rel=1e-9)
            assert len(run.t) == len(alone.t) and {
                len(column) for column in run.columns.values()
            } == {len(run.t)}
            assert all(event.time <= run.breakdown.time for event in run.events)

    def test_all_inconsistent_starts_are_reported(self):
        scene = vary(
            independent_slider_bars(3), {"slider0.position.1": 0.1, "slider2.position.1": 0.1}
        )
        with pytest.raises(SceneError) as caught:
            ENGINE.simulate(scene, t_end=1, rtol=1e-6)
        keys = {problem.key for problem in caught.value.problems}
        assert {"start.guide0.normal_force", "start.guide2.normal_force"} <= keys and not any(
            "1." in key for key in keys
        )

    def test_rows_are_limited_in_a_part_only(self):
        n = MOST_ROWS // 5 + 1
        assert (
            ENGINE.simulate(independent_slider_bars(n), t_end=1e-3, rtol=1e-6).termination == "end"
        )
        with pytest.raises(SceneError, match="constraint equations"):
            Mechanism(independent_slider_bars(n))


def dense(arrays):
    """The same mechanism, solved as one dense system."""
    return arrays.replaced(cell=arrays.cell[:0], separate=())


class TestCells:
    @pytest.mark.parametrize(
        ("build", "n", "cells"), [(sprung_chain, 6, 6), (barred_chain, 5, 1), (closed_loop, 5, 1)]
    )
    def test_same_forces_as_one_dense_system(self, build, n, cells):
        mechanism = Mechanism(build(n))
        m = mechanism.arrays
        assert len(m.cell) == cells and m.rows > DENSE
        q, v = mechanism.initial_state()
        y, random = np.concatenate([q, v]), np.random.default_rng(1)
        for _ in range(10):
            slip, corner = random.integers(-1, 2, n), random.choice([-1, 1], (n, 4))
            found = []
            for arrays in (m, dense(m)):
                w, dy = workspace(arrays), np.zeros_like(y)
                right_hand_side(arrays, w, 0.3, y, slip, corner, dy)
                found.append((dy, w.force, w.event, gain_of_mode(arrays, w, slip)[0]))
            for banded, full in zip(*found):
                assert banded == pytest.approx(full, rel=1e-9, abs=1e-9 * np.max(np.abs(full)))

    @pytest.mark.parametrize(
        ("build", "n"), [(sprung_chain, 6), (barred_chain, 5), (closed_loop, 5)]
    )
    def test_same_contact_mode_as_lemkes_method(self, build, n):
        mechanism = Mechanism(build(n))
        q, v = mechanism.initial_state()
        for seed in range(5):
            random = np.random.default_rng(seed)
            rest_speed = np.where(random.random(n) < 0.5, np.inf, 0.0)
            found = []
            for arrays in (mechanism.arrays, dense(mechanism.arrays)):
                w, slip, corner = (
                    workspace(arrays),
                    np.zeros(n, dtype=np.int64),
                    np.ones((n, 2), dtype=np.int64),
                )
                outcome = choose_mode(arrays, w, seed, q, v, slip, corner, rest_speed)
                found.append((outcome, slip.tolist()))
            assert found[0] == found[1]

    @pytest.mark.parametrize("mus", [0.03, 0.04])
    @pytest.mark.parametrize("n", [2, 5])
    def test_copies_in_the_same_state_move_as_one(self, n, mus):
        """All change their contact modes in the same instants, and no spring between them is ever strained."""
        chain = vary(sprung_chain(n, phase=0.0), {f"guide{k}.mus": mus for k in range(n)})
        truth = slider_bar_truth(load_scene("slider-bar-case-1", {"guide.mus": mus}))
        run = ENGINE.simulate(chain, t_end=truth.t_end, rtol=1e-9)
        assert run.termination == "end"
        for k in range(n):
            # rtol is local: over 24 s errors of some ten times that add up
            np.testing.assert_allclose(run[f"slider{k}.x"], truth(run.t)["slider.x"], atol=2e-8)
            own = [(event.time, event.kind) for event in run.events if event.joint == f"guide{k}"]
            assert [kind for _, kind in own] == [event.kind for event in truth.events]
            np.testing.assert_allclose(
                [time for time, _ in own], [event.time for event in truth.events], atol=1e-7
            )

    def test_sprung_chain_without_friction(self):
        # (m1 + m2) x'' = m1 L/2 w0^2 cos(w0 t) - k (x - L0) + F0 sin(Omega t + phase) + springs, by SciPy
        n, stiffness, damping = 6, 0.5, 0.05
        scene = vary(
            sprung_chain(n, stiffness, damping),
            {f"guide{k}.{key}": None for k in range(n) for key in ("mu", "mus")},
        )
        run = ENGINE.simulate(scene, t_end=5, rtol=1e-11, output_step=0.5)
        assert run.cost.counters["hlcp"] == 0
        phase, w0 = 0.37 * np.arange(n), np.pi / 4

        def rhs(t, y):
            x, rate = np.split(y, 2)
            pull = stiffness * np.diff(x) + damping * np.diff(rate)
            force = 2 * w0**2 * np.cos(w0 * t) - (x - 0.25) + 3 * np.sin(0.5 * np.pi * t + phase)
            return np.concatenate([rate, (force + np.append(pull, 0) - np.append(0, pull)) / 3])

        exact = solve_ivp(
            rhs,
            (0, 5),
            np.concatenate([np.full(n, 0.25), np.zeros(n)]),
            "DOP853",
            run.t,
            rtol=1e-12,
            atol=1e-12,
        )
        for k in range(n):
            assert run[f"slider{k}.x"] == pytest.approx(
                exact.y[k], abs=1e-9
            )  # two integrations to 1e-11 and 1e-12

    @pytest.mark.parametrize("build", [barred_chain, closed_loop])
    def test_energy_of_bars(self, build):
        assert energy_defect(build(6), 1.0, 1e-10) < 1e-8  # a hundred steps of the tolerance


class TestMemory:
    """Memory is that of what is kept: output instants and events, not steps."""

    @staticmethod
    def peak(scene, **arguments) -> tuple[int, dict]:
        ENGINE.simulate(scene, **{**arguments, "t_end": arguments["t_end"] / 10})
        tracemalloc.start()
        try:
            run = ENGINE.simulate(scene, **arguments)
            return tracemalloc.get_traced_memory()[1], run.cost.counters
        finally:
            tracemalloc.stop()

    def test_does_not_grow_with_steps(self):
        scene = load_scene("slider-bar-case-1-frictionless")
        (short, few), (long, many) = (
            self.peak(scene, t_end=t, output_step=t / 50, rtol=1e-10, stabilization="none")
            for t in (5.0, 100.0)
        )
        assert many["steps"] > 10 * few["steps"]
        assert long < 1.1 * short
