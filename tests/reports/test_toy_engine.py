"""A new engine is one new file: by its address it appears on the terminal, in the report, on the page and in the paper."""

import json
from functools import partial

import pandas as pd
import pytest
from conftest import invoke
from report_material import CASE, T_END, record, save_one, timed, unsaved_figures, validation_of

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import variant, variants
from stiction.engines import load_engine
from stiction.reports import report_of, write_report
from stiction.reports.page import write_run_page
from stiction.reports.page_one import answer_lines
from stiction.reports.paper import folder, write_paper
from stiction.reports.run_folder.stored_run import read_run
from stiction.scenes import load_scene

TOY = '''
"""An engine in one file: the paper's scheme by a name of its own."""

from dataclasses import replace

from stiction import Capabilities, Engine, load_engine


class Toy(Engine):
    name, version = "toy", "0.7.3"
    capabilities = Capabilities(
        fidelities=("joint",),
        static_coefficient={"joint": True},
        friction_law={"joint": "Coulomb, as the paper writes it"},
        reactions="engine",
        order="1",
    )

    def refusal(self, scene, fidelity):
        return None

    def locates_events(self, fidelity, settings):
        return True

    def run(self, scene, *, t_end, dt, rtol, fidelity, output_step, settings):
        made = load_engine("reference").simulate(
            scene, t_end=t_end, dt=dt, output_step=output_step, method="paper"
        )
        law = {"friction_law": self.capabilities.friction_law["joint"]}
        return replace(
            made, engine=self.name, version=self.version, settings={"dt": dt, **law}
        )
'''
ADDRESS, STEP = "onefile:Toy", 2.5e-3


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """The engine's file is in a folder that Python looks into, and nothing else names it."""
    place = tmp_path_factory.mktemp("one file")
    (place / f"{ADDRESS.partition(':')[0]}.py").write_text(TOY)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(place)
        yield ADDRESS


@pytest.fixture(scope="module")
def results(address, truths):
    """Of the reference and the toy, by the variant that a validation gives to any engine."""
    scene, reference = load_scene(CASE), load_engine("reference")
    tight = timed(reference.simulate(scene, t_end=T_END, rtol=1e-9, stabilization="projection"))
    toy = timed(load_engine(address).simulate(scene, t_end=T_END, dt=STEP))
    [own] = [one for one in variants([address], Depth.QUICK) if one.engine == address]
    assert own.fidelity == "joint" and STEP in own.ladder
    return validation_of(
        [record(variant("reference"), 1e-9, value=tight), record(own, STEP, value=toy)], truths
    )


@pytest.fixture(scope="module")
def run(results, tmp_path_factory):
    place = tmp_path_factory.mktemp("toy engine") / "run"
    with unsaved_figures():
        write_report(report_of(results), place)
    return read_run(place)


def test_it_is_on_the_terminal(address, results, in_this_process):
    listed = invoke("engines", address).stdout
    assert all(part in listed for part in ("toy", "0.7.3", "Coulomb, as the paper writes it"))
    ended = invoke("run", CASE, "--engine", address, "--t-end", "0.5", "--dt", "0.01")
    assert "toy 0.7.3" in ended.stdout
    assert any(ADDRESS in line for line in answer_lines(report_of(results)))


def test_it_is_in_the_report_and_its_data(run):
    text = (run.folder / "report.md").read_text()
    first = text.partition("\n## ")[0]
    assert ADDRESS in first
    rows = pd.read_csv(run.folder / "data" / "accuracy.csv")
    own = rows[rows["engine"].str.fullmatch(ADDRESS)]
    assert len(own) and set(own["version"]) == {"0.7.3"} and set(own["status"]) == {"ok"}
    # the file's method is the paper's scheme, whose break-away comes a step late: an error, and a small one
    assert own["position_error"].between(1e-6, 1e-2).all()
    assert set(own["friction_by"]) == {"engine"}


def test_it_is_on_the_page(run, tmp_path):
    write_run_page(run, tmp_path / "run.html")
    assert f">{ADDRESS}" in (tmp_path / "run.html").read_text()


def test_it_is_in_the_paper(run, tmp_path, monkeypatch):
    monkeypatch.setattr(folder, "save_all", partial(save_one, name=""))
    paper = write_paper(run, tmp_path / "paper").parent
    assert ADDRESS in (paper / "paper.tex").read_text()
    sections = json.loads((paper / "paper.json").read_text())["sections"]
    cells = [
        cell
        for section in sections
        for table in section["tables"]
        for row in table["rows"]
        for cell in row
    ]
    assert any(ADDRESS in str(cell) for cell in cells)
