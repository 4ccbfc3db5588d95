"""Studies that examine one case of the paper examine every other scene that they are given."""

from dataclasses import replace

import pytest
from made_up_runs import CASES, record

from stiction.cli.campaign import _breakdowns_of_papers_scheme, _failures_of_reference
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import validation_campaign
from stiction.comparisons.bench.results import SCENES_OF_PAPER, Results
from stiction.comparisons.bench.study import Scope, planned, selection, union
from stiction.comparisons.studies import studies
from stiction.reports.text import section_of
from stiction.scenes import load_scene

OWN = tuple(load_scene(name, {"t_end": 0.5}) for name in ("mass-on-belt", "block-on-incline"))
ONE_CASE = ("effects", "suppression", "threshold")


def study_named(name):
    [study] = [study for study in studies() if study.name == name]
    return study


@pytest.mark.parametrize("name", ONE_CASE)
def test_own_scenes_are_all_selected_and_of_the_papers_cases_the_first(name):
    study = study_named(name)
    own = tuple(load_scene("slider-bar-case-1", {"m1": mass}) for mass in (2.5, 3.0))
    selected = selection(Scope(own, Depth.QUICK, is_campaign=True), [study])
    assert selected.scopes[study].leading_scenes == own and not selected.reasons
    paper = Scope(tuple(validation_campaign().scenes), Depth.QUICK, is_campaign=True)
    assert selection(paper, [study]).scopes[study].leading_scenes == paper.scenes[:1]


@pytest.mark.parametrize("name", ["effects", "suppression"])
def test_every_scene_has_its_rows(name):
    study = study_named(name)
    scope = Scope(OWN, Depth.QUICK, (), repeats=1)
    results = union([planned({study: scope})[study].make()], scenes=OWN)
    table = results.table(name)
    assert list(table["scene"].unique()) == [scene.name for scene in OWN]
    section = section_of(study, results)
    assert "scene" in [column.name for column in section.tables[0].columns]


def test_a_breakdown_of_the_papers_scheme_on_another_scene_is_a_result():
    """On the paper's own cases it is a failure of the suite; a failure of the reference always is one."""
    runs = tuple(record(label, CASES[0], 0.0) for label in ("reference", "paper's scheme"))
    broken = [_with_reason(run, method) for run, method in zip(runs, ("event", "paper"))]
    elsewhere = Results(tuple(broken), {}, {}, settings={SCENES_OF_PAPER: []})
    assert len(list(_failures_of_reference(elsewhere))) == 1
    assert len(list(_breakdowns_of_papers_scheme(elsewhere))) == 1
    on_paper = Results(tuple(broken), {}, {}, settings={SCENES_OF_PAPER: list(CASES)})
    assert len(list(_failures_of_reference(on_paper))) == 2
    assert not list(_breakdowns_of_papers_scheme(on_paper))


def _with_reason(run, method):
    """The run with a setting of the reference, which could not complete it."""
    outcome = replace(run.outcome, reason="no solution at 0.1 s")
    variant = replace(run.variant, settings={"method": method})
    return replace(run, variant=variant, outcome=outcome)
