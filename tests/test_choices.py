"""What is a choice of few, a tier, a status, a fidelity, is a member of its enum, and its value is what is stored."""

import ast
import inspect
import json
import sqlite3
import tomllib
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tomli_w

import stiction
from stiction.comparisons.bench.environment import origin
from stiction.comparisons.bench.planned_runs import Metric, Row
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.regression.baseline import (
    DEFAULT,
    BaselineError,
    load_baseline,
    write_baseline,
)
from stiction.comparisons.regression.history import open_history
from stiction.comparisons.studies import studies
from stiction.engines.status import STATUS_LABELS, Status
from stiction.reports.run_folder.data import write_frame
from stiction.reports.text import section_of
from stiction.scenes.fidelity import FIDELITY_LABELS, Fidelity, fidelity_of
from stiction.truths import TIER_LABELS, Tier

LABELS = {Tier: TIER_LABELS, Status: STATUS_LABELS, Fidelity: FIDELITY_LABELS}
COLUMNS = {"tier": Tier, "truth_tier": Tier, "status": Status, "fidelity": Fidelity}
"""Enums by the columns of tables whose values are their members."""
STORED = {
    Tier: [
        "proven",
        "closed form",
        "independent high-precision solution",
        "published",
        "our own run",
        "none",
    ],
    Status: [
        "ok",
        "refused",
        "failed",
        "timed out",
        "crashed",
        "missing",
        "not run",
        "incomplete",
        "wrong",
        "no steady state",
        "not found",
    ],
    Fidelity: ["joint", "contact"],
}
"""Values in files that were written before there were enums: they must not change."""
ROOT = Path(stiction.__file__).parent.parent
PACKAGES = ("stiction", "scenes", "truths", "reference_impl", "engines", "comparisons", "reports")
OTHERS = ("solver.status",)
"""What has a name of these kinds, and is none of these enums: how a step of a solver of SciPy ended."""


@pytest.mark.parametrize("choice", LABELS)
def test_values_are_those_of_files_and_each_member_says_what_it_means(choice):
    assert [str(one) for one in choice] == STORED[choice]
    assert list(LABELS[choice]) == list(choice) and all(one.label for one in choice)
    [body] = [node.body for node in ast.parse(inspect.getsource(choice)).body]
    for member, words in zip(body, body[1:]):
        if isinstance(member, ast.Assign):
            assert isinstance(words, ast.Expr) and words.value.value.strip(), ast.unparse(member)


def literal_comparisons(text):
    """Comparisons of a status, a tier or a fidelity with a literal: lines, and what is compared."""
    values = {str(one) for choice in LABELS for one in choice}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in (
            "eq",
            "ne",
            "isin",
            "replace",
            "count",
        ):
            sides = [node.func.value, *node.args]
        else:
            continue
        said = [
            part.value
            for side in sides
            for part in ast.walk(side)
            if isinstance(part, ast.Constant)
        ]
        text_of = ast.unparse(node)
        if any(name in text_of for name in OTHERS):
            continue
        is_choice = any(word in text_of for word in ("status", "tier", "fidelity", "fidelities"))
        if is_choice and values & {one for one in said if isinstance(one, str)}:
            yield node.lineno, text_of


def test_no_code_compares_with_a_literal():
    found = [
        (str(path.relative_to(ROOT)), *where)
        for package in PACKAGES
        for path in sorted((ROOT / package).glob("**/*.py"))
        for where in literal_comparisons(path.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        'row.status == "ok"', 'table["status"].isin(["failed", UNMADE])', 'truth.tier != "none"',
        'run.fidelity in ("joint",)', 'rows["status"].replace("ok", other)',
    ],
)  # fmt: skip
def test_a_comparison_with_a_literal_would_be_found(text):
    assert len(list(literal_comparisons(text))) == 1


@pytest.mark.parametrize("choice", LABELS)
def test_members_are_written_as_their_values(choice, tmp_path):
    members, stored = list(choice), STORED[choice]
    frame = pd.DataFrame(
        {"status": members, "key": [f"run {number}" for number in range(len(members))]}
    )
    write_frame(frame, tmp_path / "a.parquet", map(quantity_of, frame))
    frame.to_csv(tmp_path / "a.csv", index=False)
    column = pq.read_schema(tmp_path / "a.parquet").field("status").type
    assert pa.types.is_string(column) or pa.types.is_large_string(column)
    for read in (
        pd.read_parquet(tmp_path / "a.parquet"),
        pd.read_csv(tmp_path / "a.csv", keep_default_na=False),
    ):
        assert [type(value) for value in read["status"]] == [str] * len(members)
        assert list(read["status"]) == stored
        assert [(read["status"] == one).sum() for one in members] == [1] * len(members)
        assert read["status"].isin(members).all()
    assert json.loads(json.dumps(members)) == stored
    assert tomllib.loads(tomli_w.dumps({"of": members}))["of"] == stored
    database = sqlite3.connect(":memory:")
    found = [database.execute("SELECT ?, typeof(?)", (one, one)).fetchone() for one in members]
    assert found == [(value, "text") for value in stored] and type(found[0][0]) is str


def test_tables_have_members_alone(validation):
    seen = {column: set() for column in COLUMNS}
    for table in validation.tables.values():
        for column in COLUMNS.keys() & set(table):
            for value in table[column].dropna():
                seen[column].add(COLUMNS[column](value))
    for record in validation.records:
        assert isinstance(record.outcome.status, Status)
        seen["status"].add(record.describe()["status"])
    assert {Status.OK, Status.MISSING, Status.CRASHED} <= seen[
        "status"
    ] and Tier.HIGH_PRECISION in seen["truth_tier"]
    assert seen["fidelity"]


def test_the_committed_baseline_has_members_alone_and_is_written_as_it_was(tmp_path):
    baseline = load_baseline()
    write_baseline(baseline, tmp_path / "again.toml")
    again, committed = (
        tomllib.loads(path.read_text(encoding="utf-8"))
        for path in (tmp_path / "again.toml", DEFAULT)
    )
    assert again == committed
    runs = list(baseline.runs.values())
    assert {type(run.status) for run in runs} == {Status} and len({run.status for run in runs}) > 1
    tiers = {metric.tier for run in runs for metric in run.metrics.values()}
    assert {type(tier) for tier in tiers} == {Tier} and Tier.NONE not in tiers and len(tiers) > 2


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ('status = "ok"', 'status = "okay"', "okay"),
        ('tier = "closed form"', 'tier = "closed"', "closed"),
        ('tier = "closed form"', 'tier = "none"', "none"),
    ],
)
def test_a_baseline_with_another_word_is_refused(old, new, found, tmp_path):
    text = DEFAULT.read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "other.toml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(BaselineError, match=f"found '{found}'"):
        load_baseline(str(file))


def test_a_history_returns_members(tmp_path):
    row = Row(
        "a/b/dt=0.1", "id", "a", "b", "e", "1", Fidelity.CONTACT, "dt", 0.1, Status.OK, "", None,
        (Metric("position_error", "accuracy", 1.0, 0.1, Tier.CLOSED_FORM),),
    )  # fmt: skip
    with open_history(tmp_path / "nights.sqlite") as history:
        night = history.begin("c", "digest", origin())
        history.append(night, row)
        [read] = history.rows(night)
        plain = history.connection.execute("SELECT status, fidelity FROM runs").fetchone()
    assert read == row and type(read.status) is Status and type(read.metrics[0].tier) is Tier
    assert plain == ("ok", "contact")


def test_python_takes_the_values_as_text():
    scene = stiction.load_scene("pendulum")
    engine = stiction.load_engine("reference")
    run = engine.simulate(scene, t_end=0.01, fidelity="joint")
    assert run.fidelity is Fidelity.JOINT and engine.capabilities.fidelities == (Fidelity.JOINT,)
    given = replace(
        engine.capabilities,
        fidelities=("joint", "contact"),
        static_coefficient={"joint": True, "contact": True},
        friction_law={"joint": "Coulomb", "contact": "Coulomb"},
    )
    assert [type(one) for one in given.fidelities] == [Fidelity, Fidelity]
    assert stiction.Outcome("a", "timed out").status is Status.TIMED_OUT
    with pytest.raises(ValueError, match="late"):
        stiction.Outcome("a", "late")
    with pytest.raises(stiction.InputError, match="found 'rigid'; expected one of joint, contact"):
        engine.simulate(scene, fidelity="rigid")
    assert fidelity_of("contact") is Fidelity.CONTACT


def written(results):
    """Numbers, rows, groups and cells that studies make of results."""
    found = {}
    for study in studies():
        said = section_of(study, results)
        found[study.name] = (
            [number.text for number in said.numbers],
            [(table.name, table.rows, table.right(), table.cells()) for table in said.tables],
            [headline.cells for headline in said.headlines],
        )
    return found


def test_other_words_for_members_change_no_result(validation, monkeypatch):
    """Of all that studies write only the words change, where they stand in cells."""
    before = json.dumps(written(validation), default=str)
    for labels in LABELS.values():
        for one in labels:
            monkeypatch.setitem(labels, one, f"Zeta{labels[one]}")
    after = json.dumps(written(validation), default=str)
    assert "Zeta" in after and after.replace("Zeta", "") == before
