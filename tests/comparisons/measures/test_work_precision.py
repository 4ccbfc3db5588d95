"""Orders, on series whose answer is known."""

import numpy as np
import pandas as pd
import pytest
from conftest import here

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import cost_variants
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import (
    OWN_CPU,
    Variant,
    fastest_period,
    scaled,
    time_factor,
)
from stiction.comparisons.measures.equal_error import SMALLEST, equal_error
from stiction.comparisons.measures.work_precision import HIGH, LOW, work_precision
from stiction.comparisons.studies import cost
from stiction.scenes import load_scene, scene_from_dict
from stiction.truths import slider_bar_truth

CASE = "slider-bar-case-1"
PAPER = {"method": "paper", "stabilization": "none"}


def test_longer_series_have_each_step_once():
    for variant in cost_variants():
        assert len(set(variant.ladder)) == len(variant.ladder) >= 3
    assert {v.parameter for v in cost_variants()} == {"dt", "rtol", "iterations"}
    assert sum(len(v.ladder) for v in cost_variants(depth=Depth.QUICK)) < sum(
        len(v.ladder) for v in cost_variants()
    )


@pytest.fixture(scope="module")
def smooth() -> pd.DataFrame:
    """A frictionless, smooth stretch: methods show the order that they promise.

    The load starts at its amplitude, so that no method gains an order by a start without acceleration.
    """
    variants = (
        Variant("paper", "reference", "dt", (0.08, 0.04, 0.02), settings=PAPER),
        Variant("exudyn", "exudyn", "dt", (0.02, 0.01)),
        Variant("pymunk", "pymunk", "dt", (0.02, 0.01)),
        Variant("hopeless", "reference", "dt", (99.0, 0.02), settings=PAPER),
    )
    with here():
        return (
            work_precision(
                load_scene(CASE + "-frictionless", {"load.phase": "pi/2"}),
                variants,
                t_end=2.0,
                repeats=1,
            )
            .make()
            .table
        )


@pytest.mark.parametrize(
    ("variant", "order"), [("paper", 4), ("exudyn", 2), ("pymunk", 2)]
)  # pymunk is a leapfrog scheme while no guide changes its mode
def test_orders_on_a_smooth_stretch(smooth, variant, order):
    # the next term of the error is O(h Omega) of the leading one, here up to 0.13, which moves an order by up to ln(1.13)/ln 2 = 0.18
    found = smooth[smooth["variant"] == variant]["position_order"].dropna()
    assert len(found) and found.iloc[-1] == pytest.approx(order, abs=0.25)


def test_paper_scheme_is_of_first_order_across_a_break_away(in_this_process):
    # steps that the break-away always halves, so that it is noticed dt/2 late; what follows O(dt) is O(dt^2), a tenth at most here
    scene = load_scene(CASE)
    instant = slider_bar_truth(scene, 1.0).events[0].time
    steps = tuple(instant / (n + 0.5) for n in (10, 31, 94))
    table = (
        work_precision(
            scene,
            [Variant("paper", "reference", "dt", steps, settings=PAPER)],
            t_end=42 * steps[0],
            repeats=1,
        )
        .make()
        .table
    )
    assert table["position_order"].dropna().to_numpy() == pytest.approx([1.0, 1.0], abs=0.1)


def test_failures_are_rows_with_their_reason_and_costs_are_apart(smooth):
    lost = smooth[smooth["status"] != "ok"]
    assert list(lost["variant"]) == ["hopeless"] and "99" in lost["reason"].item()
    ran = smooth[smooth["status"] == "ok"]
    assert (ran[["setup_time", "compile_time", "stepping_time"]] >= 0).all(axis=None)
    assert (
        (ran["cpu_time_low"] <= ran["cpu_time"]) & (ran["cpu_time"] <= ran["cpu_time_high"])
    ).all()
    assert ((ran[LOW] <= ran[OWN_CPU]) & (ran[OWN_CPU] <= ran[HIGH])).all()
    # the reference is counted whole, an engine of others without its adapter
    own = ran["engine"] == "reference"
    assert (ran.loc[own, OWN_CPU] == ran.loc[own, "cpu_time"]).all()
    apart = ran.loc[~own & (ran["engine"] != "moreau")]
    assert ((apart[OWN_CPU] > 0) & (apart[OWN_CPU] < apart["cpu_time"])).all() and len(apart)


def test_a_run_that_is_not_timed_is_not_drawn_and_its_error_is_known(smooth):
    def drawn(table):
        [panel] = cost.present(Results((), {}, {"cost": table})).figures[0].panels
        return {series.label: len(series.x) for series in panel.series if series.label}

    points = drawn(smooth)
    # the hopeless one is another setting of the paper's way; with a mark where our adapter does a part
    assert [label.rstrip(" *") for label in sorted(points)] == ["exudyn", "paper", "pymunk"]
    best = smooth.loc[smooth["variant"] == "pymunk", "position_error"].idxmin()
    untimed = smooth.assign(
        **{
            name: smooth[name].where(smooth.index != best)
            for name in (OWN_CPU, LOW, HIGH, "cpu_time")
        }
    )
    assert drawn(untimed) == {**points, "pymunk": points["pymunk"] - 1}

    def smallest(table):
        found = equal_error(table, pd.DataFrame(columns=["key", "round", OWN_CPU, "cpu_time"]))
        return found.loc[
            (found["variant"] == "pymunk") & (found["quantity"] == "position"), SMALLEST
        ].iloc[0]

    ends = [smallest(table) for table in (smooth, untimed)]
    assert ends[0] == ends[1] == smooth.at[best, "position_error"]


@pytest.mark.parametrize(
    "name",
    [
        f"slider-bar-case-{case}{kind}"
        for case in (1, 2, 3)
        for kind in ("", "-mus-equals-mu", "-frictionless")
    ],
)
def test_ladders_are_what_they_are_on_the_papers_cases(name):
    given = cost_variants(["pymunk"])
    assert scaled(given, load_scene(name)) == tuple(given)


@pytest.mark.parametrize(
    ("t_end", "factor"),
    [(24.0, 1.0), (1.0, 1.0), (0.99, 0.5), (0.03, 0.02), (1e-4, 1e-4), (5e-7, 5e-7)],
)
def test_steps_are_a_small_part_of_the_run(t_end, factor):
    scene = load_scene(CASE)
    assert time_factor(scene, t_end) == factor
    for variant in scaled(cost_variants(["pymunk"]), scene, t_end):
        steps = variant.ladder if variant.parameter == "dt" else (variant.settings.get("dt", 0.0),)
        assert max(steps) <= 0.02 * t_end * (
            1 + 1e-9
        )  # ladders of cost begin at twice the coarsest step of the others
        if variant.parameter != "dt":
            assert max(variant.ladder) in (
                1e-2,
                50,
                2,
            )  # tolerances and iterations have no unit of time


def test_the_fastest_period_is_that_of_loads_drives_or_springs():
    body = {"mass": 2.0, "inertia": 0.5}
    scene = {"bodies": {"a": body, "b": body}, "t_end": 100}
    assert fastest_period(scene_from_dict(scene, "free")) == np.inf
    push = {
        "type": "force",
        "body": "a",
        "direction": [1, 0],
        "law": {"type": "sine", "amplitude": 1, "frequency": 10},
    }
    assert fastest_period(
        scene_from_dict(scene | {"forces": {"push": push}}, "pushed")
    ) == pytest.approx(2 * np.pi / 10)
    turn = {"type": "angle", "bodies": ["a", "ground"], "law": {"type": "linear", "rate": -4}}
    assert fastest_period(
        scene_from_dict(scene | {"drives": {"motor": turn}}, "driven")
    ) == pytest.approx(2 * np.pi / 4)
    # two masses of 2 kg on a spring of 100 N/m swing against each other with omega^2 = k (1/m + 1/m); at an arm of 1 m 1/I comes in
    spring = {"type": "linear", "bodies": ["a", "b"], "stiffness": 100}
    assert fastest_period(
        scene_from_dict(scene | {"springs": {"s": spring}}, "sprung")
    ) == pytest.approx(2 * np.pi / 10)
    arm = spring | {"bodies": ["a", "ground"], "points": [[0, 1], [0, 0]]}
    assert fastest_period(scene_from_dict(scene | {"springs": {"s": arm}}, "arm")) == pytest.approx(
        2 * np.pi / np.sqrt(250)
    )
    coil = {"type": "torsional", "bodies": ["a", "ground"], "stiffness": 50}
    assert fastest_period(
        scene_from_dict(scene | {"springs": {"s": coil}}, "coil")
    ) == pytest.approx(2 * np.pi / 10)


def test_a_light_body_on_a_spring_does_not_make_the_run_endless():
    scene = load_scene("hard/light-slider")
    assert (
        fastest_period(scene) < 1e-3 and scene.t_end / (time_factor(scene) * 1e-2) <= 2.5 * 20_000
    )  # 1-2-5: up to 2.5 times finer
