"""The study of cost: its numbers from the tables by other code, missing data, and the runs that it plans."""

import json
from functools import cache
from types import SimpleNamespace

import pandas as pd
import pytest
from made_up_runs import words, wrongly_written

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import cost_variants, extent, variants
from stiction.comparisons.bench.presentation import ANSWER_LENGTH
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.study import Scope
from stiction.comparisons.bench.timing.timed_runs import OTHERS
from stiction.comparisons.bench.timing.visits import WIDE
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    EVENTS_BY,
    FRICTION_BY,
    OWN_CPU,
    Coefficients,
    Record,
    Variant,
)
from stiction.comparisons.measures.equal_error import INTEGRATION, UNKNOWN, equal_error
from stiction.comparisons.measures.work_precision import TIMING
from stiction.comparisons.studies.cost import STUDY, plan
from stiction.engines import Outcome
from stiction.reports.text import section_of
from stiction.scenes import load_scene

CASES = [f"slider-bar-case-{number}" for number in (1, 2, 3)]
STEPS = (1e-2, 2.5e-3, 1e-3)
ENGINES = {
    "reference": ("reference", "joint"),
    "paper's scheme": ("reference", "joint"),
    "pymunk": ("pymunk", "joint"),
    "PyBullet": ("pybullet", "joint"),
    "slow": ("slow", "joint"),
    "pymunk, contact": ("pymunk", "contact"),
    "not there": ("other", "joint"),
}
OWN_PART = {"pymunk": 0.5, "PyBullet": 0.25, "slow": 0.5, "pymunk, contact": 0.8}


def material():
    return {name: table.copy() for name, table in first_order().items()}


def cost_of_case_1():
    """What is said of a time, and its table, is of the first case."""
    return material()["cost"].query(f"scene == {CASES[0]!r}")


def with_equal_error(cost, times=None):
    return {
        "cost": cost,
        "equal-error": equal_error(cost, times_of(cost) if times is None else times),
    }


@cache
def first_order():
    """Errors of first order, times as their inverse; the slow engine stays above 1 mm, one is not installed."""
    rows = []
    for number, scene in enumerate(CASES, 1):
        for place, (variant, (engine, fidelity)) in enumerate(ENGINES.items(), 1):
            for step in STEPS:
                there = variant != "not there"
                size = {"slow": 10.0, "reference": 1e-2}.get(variant, 1.0) * 0.5 * number * step
                total = place * 1e-4 / step
                row = {
                    "scene": scene,
                    "variant": variant,
                    "engine": engine,
                    "fidelity": fidelity,
                    "parameter": "dt",
                    "step": step,
                    "truth": scene,
                    COEFFICIENTS: str(Coefficients.BOTH),
                    "status": "missing",
                    "reason": "No module",
                    "key": f"{scene}/{variant}/{step:g}",
                    "position_uncertainty": 1e-14,
                }
                if there:
                    row |= {
                        "status": "ok",
                        "reason": "",
                        "settings": json.dumps({"method": variant}),
                        "cpu_time": total,
                        OWN_CPU: total * OWN_PART.get(variant, 1.0),
                        "setup_time": 1e-3 * place,
                        "compile_time": 0.02,
                        "repeats": 5,
                        "position_error": size,
                        TIMING: "unsure" if step == 1e-2 and variant == "pymunk" else "",
                    }
                rows.append(row)
    return with_equal_error(pd.DataFrame(rows))


def times_of(cost):
    """The same times in five rounds."""
    return pd.DataFrame(
        [
            {"key": row["key"], "round": number, "cpu_time": row["cpu_time"], OWN_CPU: row[OWN_CPU]}
            for row in cost.dropna(subset="cpu_time").to_dict("records")
            for number in range(1, 6)
        ]
    )


def records(tables):
    first = tables["cost"].drop_duplicates("variant")
    runs = {
        row.key: SimpleNamespace(settings={"method": row.variant}) if row.status == "ok" else None
        for row in first.itertuples()
    }
    return tuple(
        Record(
            row.key,
            row.scene,
            Variant(row.variant, row.engine, "dt", STEPS, row.fidelity),
            row.step,
            Outcome("", row.status, runs[row.key]),
        )
        for row in first.itertuples()
    )


def results_of(tables):
    return Results(records(tables), {}, tables)


def shown_of(tables):
    """The section of the study, all of whose numbers are those of the tables."""
    results = results_of(tables)
    section = section_of(STUDY, results)
    assert not section.numbers or not wrongly_written(section, results)
    return section


def rows_of(tables):
    return STUDY.presented(results_of(tables)).rows


def times_to_target(section):
    [headline] = section.headlines
    return headline.cells


def test_numbers_are_those_of_the_tables():
    results = results_of(material())
    section = section_of(STUDY, results)
    assert not wrongly_written(section, results)
    assert len(times_to_target(section)) == 6 and "nan" not in words(section)
    assert all(each.caption for each in (*section.tables, *section.figures))


def test_time_to_a_millimetre_is_the_total_one_in_the_first_case():
    """By hand: the error is step / 2: 1 mm is met at a step of 2 ms, between two runs whose times go as 1 / step."""
    section, rows = shown_of(material()), rows_of(material())
    assert [number.text for number in section.numbers][:4] == ["≤ 10", "100", "150", "200"]
    assert len(section.answer) <= ANSWER_LENGTH
    assert [(one["variant"], 1e3 * float(one["time"])) for one in rows["own"]] == [
        ("reference", pytest.approx(10)),
        ("paper's scheme", pytest.approx(100)),
    ]
    assert [1e3 * float(one["time"]) for one in rows["joints"]] == pytest.approx([150, 200])
    assert [1e3 * float(one["time"]) for one in rows["contacts"]] == pytest.approx([300])
    assert rows["without"] == ["slow"]
    # What is said of it is limited to the steps that were tried.
    [one] = rows["off_target"]
    assert (one["variant"], float(one["step"])) == ("slow", min(STEPS))
    assert "with the steps that were tried" in words(section)
    assert times_to_target(section) == {
        "reference": "≤ 10",
        "paper's scheme": "100",
        "pymunk": "150 (75)",
        "PyBullet": "200 (50)",
        "slow": "> 500",
        "pymunk, contact": "300 (240)",
    }
    assert (rows["unsure"], rows["timed"]) == (3, 54)
    assert "3 of 54 runs" in words(section) and "≤ 20 ms" in section.beside
    set_up = rows["set_up"]
    assert (float(set_up["reference"]), float(set_up["engines"])) == (1e-3, 6e-3)


def test_tables_have_totals_with_the_engines_part_and_no_engine_that_is_not_installed():
    shown = shown_of(material())
    tables = {table.name: table for table in shown.tables}
    assert list(tables) == [
        "cost",
        f"cost-{CASES[1]}",
        f"cost-{CASES[2]}",
        "cost-limits",
        "cost-all",
    ]
    row = dict(
        zip(
            tables["cost"].heads(brief=True),
            next(cells for cells in tables["cost"].cells(brief=True) if cells[0] == "pymunk"),
        )
    )
    assert (
        row["10 mm [ms]"] == "≤ 30 (15)"
        and row["1 mm [ms]"] == "150 (75)"
        and row["0.1 mm [ms]"] == "–"
    )
    assert not any(
        "not there" in cells for table in shown.tables for cells in map(tuple, table.cells())
    )


def test_methods_that_may_be_compared_share_a_panel_and_what_the_adapter_does_is_marked():
    cost = material()["cost"]
    cost[[FRICTION_BY, EVENTS_BY]] = "engine"
    cost.loc[cost["variant"] == "pymunk", FRICTION_BY] = "engine + adapter"
    cost.loc[cost["variant"] == "slow", EVENTS_BY] = "adapter"
    [figure] = shown_of({"cost": cost}).figures
    labels = [[series.label for series in panel.series if series.label] for panel in figure.panels]
    joint = ["reference", "paper's scheme", "pymunk *", "PyBullet", "slow *"]
    assert list(map(sorted, labels)) == [sorted(joint)] * 3 + [
        ["pymunk, contact"]
    ] * 3 and figure.columns == len(CASES)


@pytest.mark.parametrize("part, mark", [(0.9, ""), (1.1, "~")])
def test_a_time_with_a_wide_interval_is_marked_where_it_stands(part, mark):
    """One round of five is slower by so much of what is wide; the load by others is said once."""
    cost = cost_of_case_1()
    times = times_of(cost)
    slower = 1 + part * WIDE * (times["round"] == 1)
    times = times.assign(
        **{name: times[name] * slower for name in ("cpu_time", OWN_CPU)},
        **{OTHERS: 0.1 * times["round"]},
    )
    tables = with_equal_error(cost, times) | {"times": times}
    shown = shown_of(tables)
    assert float(rows_of(tables)["load"]) == 0.5 and "up to 0.5" in words(shown)
    cells = times_to_target(shown)
    assert cells["reference"] == f"≤ {mark}10" and cells["pymunk"] == f"{mark}150 (75)"
    assert (
        dict((row[0], row[2]) for row in shown.tables[0].cells(brief=True))["pymunk"]
        == f"{mark}150 (75)"
    )


def test_errors_below_the_uncertainty_of_the_truth_have_a_bound():
    """The reference is at 5e-6 m; of a truth that is known to 2e-5 m, its time to 1e-5 m is at least that to 1e-4 m."""
    first, *_ = shown_of(
        with_equal_error(cost_of_case_1().assign(**{"position_uncertainty": 2e-5}))
    ).tables
    cells = {row[0]: row[1:] for row in first.cells(brief=True)}
    assert cells["reference"] == ["≤ 10", "≤ 10", "≤ 10", "≥ 10", "≥ 10"]
    assert cells["pymunk"][1:3] == ["150 (75)", "–"]


def test_a_limit_turns_with_one_case():
    tables = material()
    limits = {table.name: table for table in shown_of(tables).tables}[
        "cost-limits"
    ].frame.set_index("variant")
    assert set(limits["limit"]) == {INTEGRATION} and limits["order"].tolist() == pytest.approx(
        [1.0] * 6
    )
    level = tables["cost"]["variant"].eq("pymunk") & tables["cost"]["scene"].eq(CASES[2])
    tables["cost"].loc[level, "position_error"] = 1e-2
    turned = with_equal_error(tables["cost"])
    shown, rows = shown_of(turned), rows_of(turned)
    limits = {table.name: table for table in shown.tables}["cost-limits"].frame.set_index("variant")
    assert limits["limit"]["pymunk"] == UNKNOWN
    assert (rows["falling"], rows["methods"]) == (5, 6)
    assert rows["limited"] == [{"limit": UNKNOWN, "variants": ["pymunk"]}]
    assert "5 of 6 methods" in words(shown) and "inconclusive (pymunk)" in words(shown)


def test_bounds_stay_bounds_when_they_are_rounded():
    """The reference is exact in 1.06 of its 10 ms, and the slow engine's finest run takes 0.96 of its 500 ms."""
    cost = cost_of_case_1()
    for variant, factor in (("reference", 1.06), ("slow", 0.998)):
        cost.loc[cost["variant"] == variant, ["cpu_time", OWN_CPU]] *= factor
    tables = with_equal_error(cost)
    shown = shown_of(tables)
    cells = times_to_target(shown)
    assert cells["reference"] == "≤ 11" and cells["slow"] == "> 490"
    assert (
        dict((row[0], row[1]) for row in shown.tables[0].cells(brief=True))["reference"] == "≤ 11"
    )


def test_our_own_solver_of_contacts_is_no_engine():
    tables = material()
    for table in tables.values():
        table.loc[table["variant"] == "pymunk, contact", "engine"] = "moreau"
    assert rows_of(material())["contacts"] and not rows_of(tables)["contacts"]
    assert "with contacts" in words(shown_of(material()))
    assert "with contacts" not in words(shown_of(tables))


def test_an_error_that_falls_over_all_cases_and_rises_in_one_is_named():
    cost = material()["cost"]
    last = cost["variant"].eq("PyBullet") & cost["scene"].eq(CASES[2]) & cost["step"].eq(STEPS[-1])
    cost.loc[last, "position_error"] = 4e-3  # 15, 3.8 and 1.5 mm before
    level = rows_of(with_equal_error(cost))["level"]
    assert level == [{"variant": "PyBullet", "scene": CASES[2]}]
    assert "rises: PyBullet in" in words(shown_of(with_equal_error(cost)))
    assert not rows_of(material())["level"] and "rises" not in words(shown_of(material()))


@pytest.mark.parametrize(
    "gone", [["equal-error"], [], ["repeats"], ["setup_time", "compile_time", TIMING]]
)
def test_what_is_missing_is_left_out(gone):
    tables = material()
    tables["cost"] = tables["cost"].drop(columns=[name for name in gone if name in tables["cost"]])
    shown = shown_of({name: table for name, table in tables.items() if name not in gone})
    assert shown.answer and not any(
        "nan" in text or not text for text in (shown.answer, *shown.findings)
    )
    assert not any(
        "nan" in cell for table in shown.tables for cells in table.cells() for cell in cells
    )


def test_no_timed_run_is_said_without_numbers():
    failed = (
        material()["cost"].assign(status="failed", reason="gave up").drop(columns="position_error")
    )
    section = shown_of({"cost": failed})
    assert section.answer and not section.numbers
    assert not rows_of({"cost": failed})["measured"]


def test_without_times_to_errors_nothing_is_claimed_of_them():
    """A time that is not known does not mean that no run is as accurate."""
    section = shown_of({"cost": material()["cost"]})
    rows = rows_of({"cost": material()["cost"]})
    assert rows["methods"] == 0 and not rows["any"]
    assert "slow" not in words(section) and "not known" in section.answer


def test_accelerations_under_our_integrator_are_compared_with_own_steps():
    """Errors of two engines: 1e-9 and 2e-9 m integrated, 0.5 mm and 5 mm by their own steps."""
    cost = cost_of_case_1()
    finest = cost[cost["step"] == STEPS[-1]]
    parts = [cost]
    for engine, error in (("pymunk", 1e-9), ("slow", 2e-9)):
        parts.append(
            finest[finest["variant"] == engine].assign(
                variant=f"{engine}, accelerations",
                parameter="rtol",
                step=1e-9,
                settings=json.dumps({"method": "accelerations"}),
                position_error=error,
                key=f"{engine}/accelerations",
            )
        )
    table = pd.concat(parts, ignore_index=True)
    tables = with_equal_error(table)
    compared = rows_of(tables)["accelerations"]
    assert compared["variants"] == ["pymunk", "slow"]
    assert float(compared["integrated"]) == 2e-9
    assert float(compared["stepped"]) == pytest.approx(0.5e-3)
    assert rows_of(material())["accelerations"] is None
    assert "pymunk and slow" in words(shown_of(tables))


@pytest.mark.parametrize("depth", list(Depth))
def test_plan_times_all_cases_and_elsewhere_what_is_compared(depth):
    scenes = tuple(load_scene(name) for name in CASES)
    comparison = plan(Scope(scenes, depth, engines=("pybullet",)))
    made = {tuple(ladder.split("/", 1)) for ladder in comparison.ladders}
    of_scene = {scene: {variant for where, variant in made if where == scene} for scene in CASES}
    chosen, compared = (
        {one.label for one in ways(("pybullet",), depth)} for ways in (cost_variants, variants)
    )
    others = chosen if depth == Depth.FULL else chosen & compared
    assert of_scene[CASES[0]] == chosen and of_scene[CASES[1]] == of_scene[CASES[2]] == others
    assert ({where for where, _ in made} > set(CASES)) == (depth == Depth.FULL)
    assert comparison.rounds == extent(depth).repeats
    alone = plan(Scope(scenes[:1], depth, engines=()))
    assert {series.split("/", 1)[0] for series in alone.ladders} == {CASES[0]}
