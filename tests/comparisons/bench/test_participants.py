"""Participants are data: an engine of another package has the same steps and tables as the suite's own."""

from pathlib import Path

import pytest
from conftest import invoke

from stiction.comparisons.bench.campaign import load_campaign
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import (
    cost_variants,
    participants,
    threshold_variants,
    validation_campaign,
    variants,
)
from stiction.comparisons.bench.runner import prepare
from stiction.comparisons.bench.variants import Variant
from stiction.comparisons.hard.table import hard_variants
from stiction.comparisons.measures.work_precision import work_precision
from stiction.comparisons.studies.effects import effects_variants
from stiction.engines import Capabilities, Engine, engine_names, load_engine
from stiction.engines.pymunk.engine import PymunkEngine
from stiction.scenes import load_scene

OWN = {"reference", "moreau", "exudyn", "pymunk", "pybullet", "mujoco", "drake", "dart", "newton"}


class Plugged(PymunkEngine):
    """As an engine of another package would be."""

    name = "plugged"


class Adaptive(Engine):
    name, version = "adaptive", "1"
    capabilities = Capabilities(
        ("joint",), {"joint": True}, {"joint": "none"}, "engine", "8", adaptive=True
    )

    def refusal(self, scene, fidelity):
        return "never"

    def run(self, scene, **_):
        raise AssertionError("was refused")


class Compiled(Plugged):
    def prepare(self):
        Path("prepared").touch()


class Unprepared(Plugged):
    def prepare(self):
        raise ValueError("no compiler")


@pytest.fixture
def plugged(tmp_path, monkeypatch):
    package = tmp_path / "plugged-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: plugged\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(f"[stiction.engines]\nplugged = {__name__}:Plugged\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert engine_names()[-1] == "plugged"
    return "plugged"


def ladders(found, engine):
    return {
        variant.fidelity: variant.ladder
        for variant in found
        if variant.engine == engine and variant.parameter == "dt"
    }


@pytest.mark.parametrize("ways", [variants, cost_variants, threshold_variants])
@pytest.mark.parametrize("depth", list(Depth))
def test_plugged_in_engine_has_the_ladders_of_ours_at_each_fidelity(plugged, ways, depth):
    found = ways(None, depth)
    assert {variant.engine for variant in found} == OWN | {plugged}
    fidelities = set(load_engine(plugged).capabilities.fidelities)
    assert set(ladders(found, plugged)) == fidelities == set(ladders(found, "pymunk"))
    assert ladders(found, plugged)["joint"] == ladders(found, "pymunk")["joint"]
    assert [variant.engine for variant in ways([], depth)] == ["reference"] * len(ways([], depth))
    assert {variant.engine for variant in ways([plugged], depth)} == {"reference", plugged}


def test_plugged_in_engine_is_in_every_comparison(plugged):
    labels = {plugged, f"{plugged}, contact"}
    assert labels <= {variant.label for variant in hard_variants()}
    assert labels <= {variant.label for variant in hard_variants([plugged])}
    assert labels <= {variant.label for variant in effects_variants([plugged])}
    adaptive = f"{__name__}:Adaptive"
    assert {variant.label for variant in load_campaign().of_engine(adaptive).variants} == {adaptive}


def test_an_adaptive_engine_has_tolerances_and_one_that_is_missing_a_row():
    [adaptive] = [
        variant for variant in variants([f"{__name__}:Adaptive"]) if variant.engine != "reference"
    ]
    reference = variants([])[0]
    assert (adaptive.parameter, adaptive.ladder) == ("rtol", reference.ladder)
    [missing] = [
        variant for variant in variants(["nobody_has_this:Engine"]) if variant.engine != "reference"
    ]
    assert (missing.label, missing.fidelity) == ("nobody_has_this:Engine", "joint")


def test_tables_of_the_plugged_in_engine(plugged, in_this_process):
    """Its numbers are those of the engine that it is derived from, rung by rung."""
    few = [
        Variant(variant.label, variant.engine, "dt", variant.ladder[:1])
        for variant in cost_variants(["pymunk", plugged])
        if variant.engine != "reference"
        and variant.fidelity == "joint"
        and variant.parameter == "dt"
    ]
    table = (
        work_precision(load_scene("slider-bar-case-1"), few, t_end=1.0, repeats=1)
        .make()
        .table.set_index("engine")
    )
    assert set(table["status"]) == {"ok"}
    assert table.at[plugged, "position_error"] == table.at["pymunk", "position_error"] > 0
    ended = invoke(
        "compare",
        "drift",
        "slider-bar-case-1",
        "--engines",
        f"{plugged},pymunk",
        "--quick",
        "--t-end",
        "1",
    )
    assert f"{plugged}, contact" in ended.stdout, ended.output


def test_variants_of_the_file_are_whole():
    campaign = validation_campaign()
    assert [scene.name for scene in campaign.scenes] == [f"slider-bar-case-{i}" for i in (1, 2, 3)]
    assert {variant.engine for variant in campaign.variants} == OWN
    assert all(variant.ladder or variant.cost for variant in campaign.variants)
    assert all(
        isinstance(rung, int)
        for variant in campaign.variants
        if variant.parameter == "iterations"
        for rung in variant.cost
    )
    assert len({variant.label for variant in participants()}) == len(participants())


def test_engines_are_prepared_before_their_runs_have_a_time_limit(plugged, compiled):
    prepare([f"{__name__}:Compiled", "nobody_has_this:Engine", f"{__name__}:Unprepared"])
    assert Path("prepared").exists()
