"""Page one fits a page, its numbers stand in the data, and it ranks nothing that may not be ranked; tables and figures of a report can be read."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from report_material import CASE, record, unsaved_figures

from stiction.comparisons.studies.equal_error import INTEGRATION, MODEL, TRUTH, UNKNOWN, equal_error
from stiction.comparisons.studies.work_precision import HIGH, LOW
from stiction.comparisons.results import Results
from stiction.comparisons.hard import hard_cases
from stiction.comparisons.hard.examination import judge
from stiction.comparisons.truth import Truth
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import EVENTS_BY, FRICTION_BY, MUS_EQUALS_MU, OWN_CPU, Variant
from stiction.engines import Outcome
from stiction.reports import write_report
from stiction.reports.figures import drawings
from stiction.reports.figures.differences import difference_figures, largest_differences
from stiction.reports.figures.ladders import accuracy_figures
from stiction.reports.figures.style import MARKERS, Drawing, looks, rc
from stiction.reports.markdown.cost_page import times_table
from stiction.comparisons.methods import methods
from stiction.reports.markdown.findings import findings
from stiction.reports.markdown.ladder_ends import ladder_ends
from stiction.reports.markdown.page_one import ABOUT, COLUMNS, numbers, page_one
from stiction.reports.markdown.page_one import WIDTH as PAGE_WIDTH
from stiction.comparisons.presentation.cells import MISSING
from stiction.reports.markdown.tables import WIDTH, fitted
from stiction.comparisons.presentation.traced_text import COUNT, NAME, RATIO, value
from stiction.scenes import InputError, Trajectory

NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
MOST_BYTES, MOST_LINES, MOST_ROWS = 60_000, 60, 10


def cost_table() -> pd.DataFrame:
    """Made-up ladders: an event-driven reference, an engine of first order, a contact model whose error stays."""
    rows = [("reference", "reference", "rtol", step, "joint", error, seconds, "") for step, error, seconds in ((1e-6, 1e-6, 1e-3), (1e-9, 1e-9, 2e-3))]
    rows += [("other", "other", "dt", step, "joint", 0.3 * step, 1e-4 / step, "") for step in (1e-2, 5e-3, 2.5e-3)]
    rows += [("soft, contact", "soft", "dt", step, "contact", 1e-3, 1e-4 / step, MUS_EQUALS_MU) for step in (1e-2, 5e-3, 2.5e-3)]
    table = pd.DataFrame(rows, columns=["variant", "engine", "parameter", "step", "fidelity", "position error [m]", OWN_CPU, "truth"])
    return table.assign(scene=CASE, truth=CASE + table["truth"], status="ok", reason="", repeats=5, settings='{"dt": 0.002}', key=table["variant"] + table["step"].astype(str), **{
        "cpu [s]": table[OWN_CPU], LOW: 0.9 * table[OWN_CPU], HIGH: 1.1 * table[OWN_CPU], "position uncertainty [m]": 1e-14,
        "order, position [-]": [np.nan, np.nan, np.nan, 1.0, 1.0, np.nan, 0.0, 0.0]})


def equal_table() -> pd.DataFrame:
    """Times to errors of the made-up ladders, timed in five rounds."""
    cost = cost_table()
    return equal_error(cost, pd.DataFrame([{"key": row["key"], "round": number, OWN_CPU: factor * row[OWN_CPU], "cpu [s]": factor * row["cpu [s]"]}
                                           for row in cost.to_dict("records") for number, factor in enumerate((1.0, 0.9, 1.1, 0.95, 1.02), 1)]))


def hard_table() -> pd.DataFrame:
    verdicts = {"reference": "rrr", "paper's scheme": "rwo", "other": "rfd"}
    words = {"r": "right", "w": "wrong", "o": "declined", "f": "failed", "d": "degraded"}
    rows = [(f"case {i}", variant, "reference" if variant != "other" else "other", words[letter]) for variant, letters in verdicts.items() for i, letter in enumerate(letters)]
    return pd.DataFrame(rows, columns=["case", "variant", "engine", "verdict"]).assign(
        topic="t", scene="s", must="m", fidelity="joint", about="", size=np.nan, limit=np.nan, **{"cpu [s]": 1.0})


@pytest.fixture(scope="module")
def full(validation):
    return replace(validation, tables={**validation.tables, "cost": cost_table(), "equal-error": equal_table(), "hard": hard_table()})


@pytest.fixture(scope="module")
def folder(full, tmp_path_factory):
    with unsaved_figures():
        return write_report(full, tmp_path_factory.mktemp("page one") / "run").parent


def test_report_can_be_read(folder):
    text = (folder / "report.md").read_text()
    assert len(text.encode()) <= MOST_BYTES
    page, *parts = re.split(r"\n## ", text)
    assert len(page.splitlines()) <= MOST_LINES and page.splitlines()[2].startswith("![The mechanism")
    lines = [line for part in parts for line in part.splitlines() if line.startswith("|")]
    assert lines and max(map(len, lines)) <= WIDTH
    for part in parts:
        for table in re.findall(r"(?:^\|.*\n)+", part, re.M):
            assert table.count("\n") - 2 <= MOST_ROWS or part.startswith("Where do methods")
        shown = [part.find(mark) for mark in ("![", "\n|")]
        assert -1 in shown or shown[0] < shown[1]  # the figure first
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert links and all((folder / link).is_file() for link in links)
    assert {"hard.md", "failures.md", "data/accuracy.csv", "data/cost.csv"} <= set(links)


def shows(text: str, true: float) -> bool:
    """Whether a number rounded as in the text may be this one."""
    digits = re.fullmatch(r"-?(\d+)(?:\.(\d+))?(?:e([+-]?\d+))?", text)
    unit = 10.0 ** (int(digits[3] or 0) - len(digits[2] or ""))
    significant = len((digits[1] + (digits[2] or "")).strip("0")) or 1
    unit = max(unit, 10.0 ** (np.floor(np.log10(abs(float(text)))) + 1 - significant)) if float(text) else unit  # 980 stands for 975 to 985
    return abs(float(text) - abs(true)) <= 0.500001 * unit or abs(float(text) - true) <= 0.500001 * unit


def test_every_number_of_page_one_is_in_the_data(full, folder):
    told = numbers(full)
    assert len(told) > 30 and {number.how for number in told} == {"value", COUNT, RATIO, NAME}
    for number in told:
        csv = pd.read_csv(folder / "data" / f"{number.table}.csv")
        seen = re.findall(NUMBER, number.text)
        if number.how == COUNT:
            for column, wanted in number.where.items():
                csv = csv[csv[column].isin(wanted if isinstance(wanted, frozenset) else [wanted])]
            assert number.text == str(len(csv)), number
            continue
        cells = csv.iloc[[row - 1 for row in number.rows]]
        if number.how == NAME:
            assert f"slider-bar-{number.text.replace(' ', '-')}" == cells[number.column].item()
        elif number.how == RATIO:
            first, second = (cells.iloc[place] for place in (0, 1))
            true = first[number.column] / second[number.column], first[LOW] / second[HIGH], first[HIGH] / second[LOW]
            assert all(map(shows, seen, true)) and true[1] < true[0] < true[2], number
        elif number.text.startswith("< "):
            unsure = cells[number.column.replace("error", "uncertainty")].item()
            assert abs(cells[number.column].item()) <= unsure and float(seen[0]) >= unsure, number
        else:
            assert all(shows(seen[0], number.factor * true) for true in cells[number.column]), number


def test_page_one_has_no_other_digits(full):
    """What is left of the sentences without their numbers are words."""
    for finding in findings(full):
        text, place = finding.told.text, 0
        for number in finding.told.numbers:
            place = text.index(number.text, place)
            text = text[:place] + text[place + len(number.text):]
        for name in ("F0", *(name for record in full.records for name in (record.variant.label, record.variant.engine))):
            text = text.replace(name, "")
        assert not re.search(r"\d", text), finding


def test_a_sentence_that_drifts_from_the_data_is_noticed(full):
    table = full.tables["accuracy"].reset_index(drop=True)
    number = value("accuracy", table, 1, "position error [m]")
    true = table.at[1, "position error [m]"]
    assert shows(re.findall(NUMBER, number.text)[0], true) and not shows(re.findall(NUMBER, number.text)[0], 2 * true)


def test_page_one_ranks_within_a_group_only(full):
    text = page_one(full, "Run.", [])
    agreement = next(finding.told.text for finding in findings(full) if finding.title == "Agreement")
    assert agreement.index("for the reference") < agreement.index("for the paper's scheme") and "other with" in agreement and "(joint, mus > mu;" in agreement
    accuracy = full.tables["accuracy"]
    both = pd.concat([accuracy, accuracy[accuracy["variant"] == "other"].assign(variant="twin", truth=CASE + MUS_EQUALS_MU, **{"position error [m]": 1e-12})], ignore_index=True)
    twin = record(Variant("twin", "twin", "dt", (2.5e-3,)), 2.5e-3, value=full.records[2].trajectory)
    told = findings(replace(full, records=(*full.records, twin), tables={**full.tables, "accuracy": both}))[0].told.text
    assert "other with" in told and "twin with" in told and "(joint, mus = mu;" in told
    assert all(f" {column} " in text for column in COLUMNS) and "Not shown" not in text
    assert "1/2" in text and "3/3" in text  # right, of the cases that were accepted
    assert all(len(line) <= PAGE_WIDTH for line in text.splitlines())


def test_engines_are_ranked_only_where_the_same_part_of_the_work_is_theirs(full):
    """A closer twin, whose adapter locates its events, is named beside the other, not instead of it."""
    accuracy, other = full.tables["accuracy"], full.records[2]
    twin = record(Variant("twin", "twin", "dt", (2.5e-3,)), 2.5e-3, value=other.trajectory)
    for supplied, both in (({}, False), ({EVENTS_BY: "adapter"}, True), ({FRICTION_BY: "adapter"}, True)):
        row = accuracy[accuracy["variant"] == "other"].assign(variant="twin", engine="twin", **supplied,
                                                              **{"position error [m]": 1e-9})
        tables = {**full.tables, "accuracy": pd.concat([accuracy, row], ignore_index=True)}
        told = findings(replace(full, records=(*full.records, twin), tables=tables))[0].told.text
        assert "twin with" in told and ("other with" in told) == both


def test_an_engine_s_accelerations_under_our_integrator_stand_beside_its_own_steps(full):
    cost = cost_table().assign(**{FRICTION_BY: "engine", EVENTS_BY: "nobody"})
    name = "other accelerations + our integrator"
    ours = cost[cost["variant"] == "reference"].assign(variant=name, engine="other", **{
        FRICTION_BY: "adapter", EVENTS_BY: "adapter", "position error [m]": 3e-9})
    tables = {**full.tables, "cost": pd.concat([cost, ours], ignore_index=True)}
    shown = page_one(replace(full, tables=tables), "Run.", []).splitlines()
    [place] = [number for number, line in enumerate(shown) if line.startswith(f"| {name} ")]
    assert re.search(r"\| A/A +\| 3e-09", shown[place]) and re.match(r"\| other +\| E/E ", shown[place - 1])


@pytest.mark.parametrize("shift, alike", [(-3.0, False), (-1.5, True), (1.5, True), (3.0, False)])
def test_jumps_that_are_not_told_apart_are_not_ranked(full, shift, alike):
    """A twin whose error differs by `shift` times the uncertainty of either: named beside the other up to twice that, whichever is smaller."""
    torque = full.tables["torque"].reset_index(drop=True).assign(**{"jump uncertainty [N m]": 0.1})
    own = torque[torque["variant"] == "other"].assign(**{"jump error [N m]": 1.0})
    both = pd.concat([torque[torque["variant"] != "other"], own, own.assign(variant="twin", engine="twin", **{"jump error [N m]": 1.0 + 0.1 * shift})], ignore_index=True)
    accuracy = pd.concat([full.tables["accuracy"], full.tables["accuracy"].query("variant == 'other'").assign(variant="twin", engine="twin")], ignore_index=True)
    twin = record(Variant("twin", "twin", "dt", (2.5e-3,)), 2.5e-3, value=full.records[2].trajectory)
    told = next(finding.told.text for finding in findings(replace(full, records=(*full.records, twin), tables={**full.tables, "torque": both, "accuracy": accuracy}))
                if finding.title == "Torque jumps")
    sampled = told.partition("From sampled output")[2]
    assert ("cannot be ranked" in sampled) == alike
    assert ("other" in sampled, "twin" in sampled) == ((True, True) if alike else (shift > 0, shift < 0))


def test_methods_that_are_right_equally_often_are_named_together(full):
    hard = pd.concat([hard_table(), hard_table().query("variant == 'other'").assign(variant="twin", engine="twin")], ignore_index=True)
    accuracy = pd.concat([full.tables["accuracy"], full.tables["accuracy"].query("variant == 'other'").assign(variant="twin", engine="twin")], ignore_index=True)
    twin = record(Variant("twin", "twin", "dt", (2.5e-3,)), 2.5e-3, value=full.records[2].trajectory)
    told = next(finding.told.text for finding in findings(replace(full, records=(*full.records, twin), tables={**full.tables, "hard": hard, "accuracy": accuracy}))
                if finding.title == "Hard cases")
    assert "the most right answers: other 1 of 3 and twin 1 of 3" in told


@settings(max_examples=20)  # each a table of page one
@given(st.lists(st.floats(0.5, 2.0), min_size=5, max_size=9), st.lists(st.floats(0.5, 2.0), min_size=5, max_size=9))
def test_no_sentence_on_cost_depends_on_which_of_two_times_is_longer(first, second):
    """Two engines that reach the same error, timed with any scatter: both are told, in the order of the table, and the words are the same."""
    cost = cost_table()
    twin = cost[cost["variant"] == "other"].assign(variant="twin", engine="twin", key=lambda rows: "twin" + rows["key"])
    table = pd.concat([cost, twin], ignore_index=True)
    scatter = {"other": first, "twin": second}
    samples = pd.DataFrame([{"key": row["key"], "round": number, OWN_CPU: factor * row[OWN_CPU], "cpu [s]": factor * row["cpu [s]"]}
                            for row in table.to_dict("records") for number, factor in enumerate(scatter.get(row["variant"], [1.0] * 5), 1)])
    [finding] = [finding for finding in findings(Results((), {}, {"cost": table, "equal-error": equal_error(table, samples)})) if finding.title == "Cost"]
    words = re.sub(NUMBER, "#", finding.told.text)
    assert words.index("other takes") < words.index("twin takes") and not re.search("faste|slowe|quick|least time", words)


def cost_finding(cost: pd.DataFrame, equal: pd.DataFrame) -> str:
    [finding] = [finding for finding in findings(Results((), {}, {"cost": cost, "equal-error": equal})) if finding.title == "Cost"]
    return finding.told.text


def test_an_error_that_only_steps_without_a_time_reach_is_not_said_to_be_out_of_reach():
    """The engine's last step is not timed and ten times as exact as the others: what is said is said of those that were timed, here and on page one."""
    cost = cost_table()
    cost.loc[cost["key"] == "other0.0025", "position error [m]"] = 3e-5
    samples = pd.DataFrame([{"key": row["key"], "round": number, OWN_CPU: row[OWN_CPU], "cpu [s]": row["cpu [s]"]}
                            for row in cost[cost["key"] != "other0.0025"].to_dict("records") for number in range(1, 6)])
    cost.loc[cost["variant"] == "other", "position error [m]"] *= 0.3
    equal = equal_error(cost, samples)
    assert not ((equal["variant"] == "other") & (equal["error"] == 1e-4) & equal[OWN_CPU].notna()).any()
    assert "of those that were timed, is a position error of 0.001 m." in cost_finding(cost, equal)
    assert f"{MISSING}: no step that was timed reaches it" in re.sub(r"\s+", " ", ABOUT)


@pytest.mark.parametrize(("engine", "reference", "words"), [
    (False, False, r"in its own calls, [0-9.]+ \("), (True, False, r"in its own calls, at most [0-9.]+ \("), (False, True, r"in its own calls, at least [0-9.]+ \("),
    (True, True, r"in its own calls, [0-9.]+ \(.*\) times as long as the reference, whose time is a bound too")])
def test_a_ratio_of_bounds_is_a_bound_to_the_right_side(engine, reference, words):
    equal = equal_table()
    for variant, at_most in (("other", engine), ("reference", reference)):
        equal.loc[equal["variant"] == variant, "at most"] = at_most
    assert re.search(words, cost_finding(cost_table(), equal))


def test_a_threshold_is_held_against_that_of_its_own_physics(full):
    """Nobody comes within its uncertainty but a method of the other physics, whose threshold is another."""
    threshold = full.tables["threshold"]
    table = threshold.assign(**{"error [N]": 1.0, "uncertainty [N]": 1e-3})
    other = threshold.iloc[:1].assign(variant="other", **{"truth [N]": threshold["truth [N]"].iloc[0] - 0.3, "error [N]": 0.0, "uncertainty [N]": 1e-3})
    told = findings(replace(full, tables={**full.tables, "threshold": pd.concat([table, other], ignore_index=True)}))
    words = next(finding.told.text for finding in told if finding.title == "Threshold of stick")
    assert "The threshold of" not in words and "differs by more than its uncertainty" in words


def test_times_to_errors_say_what_they_are_unsure_by_and_which_are_bounds():
    shown = times_table(equal_table(), 1).set_index("variant")
    assert shown.at["reference", "ms to 0.001"] == "≤ 1.0 ± 0.1" and shown.at["other", "ms to 0.001"] == "30 ± 3"
    assert [name for name in shown if name.startswith("ms to ")] == ["ms to 0.001"]  # 1e-4 is reached by one ladder alone
    assert shown.at["other", "ends at"] == pytest.approx(7.5e-4) and shown.at["other", "limit"] == INTEGRATION
    assert "ms to 1e-09" in times_table(equal_table()) and times_table(equal_table().iloc[:0]).empty


@pytest.mark.parametrize("missing", ["accuracy", "cost", "equal-error", "hard", "study", "threshold", "torque", "claims", "drift"])
def test_page_one_comes_out_whatever_is_missing(full, missing):
    tables = {name: table for name, table in full.tables.items() if name != missing}
    assert page_one(replace(full, tables=tables), "Run.", [])


def test_an_engine_that_is_not_installed_has_failed_at_no_threshold(full):
    threshold = full.tables["threshold"]
    lost = [threshold.iloc[:1].assign(variant=name, status=status, **{"error [N]": np.nan}) for name, status in (("tried", "ok"), ("absent", "missing"))]
    told = findings(replace(full, tables={**full.tables, "threshold": pd.concat([threshold, *lost], ignore_index=True)}))
    words = next(finding.told.text for finding in told if finding.title == "Threshold of stick")
    assert "No threshold was found for tried." in words and "absent" not in words


def test_what_was_not_run_is_no_wrong_answer(full):
    """After an interrupt: no engine has failed at a case that nobody gave it."""
    hard = full.tables["hard"].assign(verdict="not run")
    assert "Hard cases" not in [finding.title for finding in findings(replace(full, tables={**full.tables, "hard": hard}))]
    case = hard_cases()[0]
    assert judge(case, Variant("other", "other", "dt", (1e-2,)), Outcome("other", "not run", reason="interrupted")).word == "not run"


def test_engines_that_are_not_installed_are_told_once(full):
    lost = [record(Variant(name, re.split("[, ]", name)[0], "dt", (1e-2,)), step, "missing") for name in ("Alpha", "Beta, contact", "Beta + more") for step in (1e-2, 1e-3)]
    told = {finding.title: finding.told.text for finding in findings(replace(full, records=(*full.records[:3], *lost)))}
    assert told["Not installed"].startswith("Alpha and Beta took no part;") and "6 are of engines that are not installed" in told["Runs"]


def test_figures_are_told_to_those_who_do_not_see_them(folder):
    text = (folder / "report.md").read_text()
    told = dict((name, words) for words, name in re.findall(r"!\[([^]]*)\]\(figures/([^)]+)\.png\)", text))
    captions = pd.read_csv(folder / "data" / "figures.csv").set_index("name")["caption"]
    assert told and all(len(words) > 20 and words[:20] in captions[name].translate(str.maketrans("[]", "()")) for name, words in told.items())
    assert Drawing("f", "t", "Case 1: velocity [m/s] (the paper's Fig. 5). More.", None).told == "Case 1: velocity (m/s) (the paper's Fig. 5)"


@pytest.mark.parametrize("value, unsure, told", [(0.145, 0.018, "0.145 ± 0.018"), (12.34, 2.5, "12.3 ± 2.5"), (3.13e-13, 2.9e-14, "3.13e-13 ± 2.9e-14"), (187.0, 120.0, "187 ± 120"),
                                                 (1.0, 0.1, "1.0 ± 0.1"), (5e-5, 1.1e-5, "5.0e-05 ± 1.1e-05"), (3.996, 0.021, "3.996 ± 0.021"), (1.234, 0.081, "1.23 ± 0.09"),
                                                 (0.7541, 0.0376, "0.75 ± 0.04"), (52.4, 6.7, "52 ± 7"), (9.6, 9.51, "10 ± 10"), (1.456, float("nan"), "1.5"), (1.456, 0.0, "1.5"),
                                                 (0.0, 0.1, "0.0 ± 0.1"), (-1e-5, 0.1, "0.0 ± 0.1"), (0.0, 1e-9, "0e+00 ± 1e-09")])
def test_a_number_ends_where_its_uncertainty_does(value, unsure, told):
    assert Uncertain(value, unsure).both() == told


def test_a_stored_run_without_some_trajectories_has_the_same_methods(full):
    """A folder keeps the trajectories of those that stand for a method; another way of the reference is no method because its own is not there."""
    other = record(Variant("reference, other setting", "reference", "rtol", (1e-9,)), 1e-9)
    lost = record(Variant("never", "never", "dt", (1e-2,)), 1e-2, "failed")
    assert methods(replace(full, records=(*full.records, other))) == methods(full)
    assert methods(replace(full, records=(*full.records, lost))) == [*methods(full), "never"]


def test_where_ladders_end_and_why():
    found = {end.variant: end for end in ladder_ends(cost_table())}
    assert {variant: end.limit for variant, end in found.items()} == {"reference": INTEGRATION, "other": INTEGRATION, "soft, contact": MODEL}
    assert found["other"].order == pytest.approx(1.0) and found["soft, contact"].order == 0.0 and found["other"].step == 2.5e-3
    table = cost_table()
    exact = table.assign(**{"position uncertainty [m]": 1e-2})
    assert {end.limit for end in ladder_ends(exact)} == {TRUTH}
    assert {end.limit for end in ladder_ends(table.drop_duplicates("variant"))} == {UNKNOWN}
    solver = table[table["variant"] == "soft, contact"].assign(parameter="iterations")
    assert [end.limit for end in ladder_ends(solver)] == [INTEGRATION]  # its step is what is left


def test_variants_are_told_apart_without_colours():
    def records(count, fidelity):
        return [record(Variant(f"{fidelity} {i}", f"engine {i}", "dt", (1e-2,), fidelity), 1e-2, "failed") for i in range(count)]

    most = 2 * len(MARKERS)
    found = looks([*records(most, "joint"), *records(most, "contact")])
    assert len({(look.marker, look.fill) for look in found.values()}) == len(found) == 2 * most
    with pytest.raises(InputError, match=f"found {most + 1} variants of contact fidelity; expected at most {most}"):
        looks(records(most + 1, "contact"))


@settings(max_examples=40)
@given(st.lists(st.text(st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="|"), max_size=200), min_size=1, max_size=15))
def test_tables_fit(words):
    text = fitted(pd.DataFrame({"words": words, "again": words, "third": words, "number": np.pi}))
    lines, _, below = text.partition("\n\n")
    assert len(lines.splitlines()) == 2 + min(len(words), MOST_ROWS) and max(map(len, lines.splitlines())) <= WIDTH
    dropped = [name for name in ("words", "again", "third", "number") if name not in lines.splitlines()[0]]
    assert re.findall(r"\*(\w+)\*", below) == dropped  # what has no room is told


@pytest.mark.parametrize("column", ["single", "double"])
def test_no_two_labels_of_an_axis_touch(full, column):
    """On a logarithmic axis of less than two decades ``2 x 10^1 3 x 10^1`` once stood on each other."""
    octaves = pd.DataFrame([(CASE, choice, step, end, 1e-12 * end) for choice in ("none", "Baumgarte (90, 10)") for step in (1e-3, 1e-2) for end in (15.0, 30.0, 60.0, 120.0, 240.0)],
                           columns=["scene", "choice", "step", "to [s]", "position drift, rms [m]"])
    study = octaves.drop_duplicates(["choice", "step"]).assign(reason="", **{"position drift to 24 s, max [m]": 1e-12})
    with rc(column):
        drawn = list(drawings(replace(full, tables={**full.tables, "study": study, "octaves": octaves})))
        assert "fig14-drift" in {drawing.name for drawing in drawn} and any("work-precision" in drawing.name for drawing in drawn)
        for drawing in drawn:
            drawing.figure.draw_without_rendering()
            for axis in (axis for ax in drawing.figure.axes for axis in (ax.xaxis, ax.yaxis)):
                boxes = [label.get_window_extent() for which in ("majorticks", "minorticks") for tick in getattr(axis, f"get_{which[:5]}_ticks")()
                         if (label := tick.label1).get_visible() and label.get_text() and axis.axes.axison]
                assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i]), drawing.name


def test_an_error_is_drawn_with_what_it_is_unsure_by(full):
    """Of every rung: up by the uncertainty, down by it or to the lower edge, nothing where it is too small to be seen."""
    errors = full.tables["accuracy"]
    table = errors.assign(**{"position uncertainty [m]": errors["position error [m]"] * np.resize([0.01, 0.5, 3.0], len(errors))})
    drawn = pd.concat([pd.DataFrame([(x, low, high) for container in ax.containers for segment in container.lines[2][0].get_segments()
                                     for (x, low), (_, high) in [segment]], columns=["x", "low", "high"])
                       for drawing in accuracy_figures(replace(full, tables={**full.tables, "accuracy": table})) for ax in drawing.figure.axes]).dropna()
    shown = table[(table["parameter"] == "dt") & (table["position error [m]"] > 0)]
    unsure, error = shown["position uncertainty [m]"], shown["position error [m]"]
    assert len(drawn) == (unsure > 0.1 * error).sum() > 0
    assert np.allclose(sorted(drawn["high"]), sorted((error + unsure)[unsure > 0.1 * error]))
    assert drawn["low"].min() == pytest.approx(error.min() / 2) and (drawn["low"] > 0).all()


def test_differences_are_those_from_the_truth():
    truth = Truth("made", "closed form", 24.0, lambda t, side="after": {"slider.x": np.sin(t)}, {}, ())
    t = np.linspace(0.0, 24.0, 3001)  # every 8 ms: of the truth's instants every fourth is among them
    wrong = Trajectory("made", "made", "1", "joint", t, {"slider.x": np.sin(t) + 1e-3 * (t > 12)}, (), {})
    at, size = largest_differences(wrong, truth, "slider.x")
    assert at.min() > 12 and size == pytest.approx(1e-3) and np.all(np.diff(at) > 0)


@pytest.mark.parametrize("unsure, drawn", [(1e-12, False), (1e-5, True), (float("nan"), False)])
def test_the_truth_s_uncertainty_is_drawn_where_it_is_not_far_below(full, unsure, drawn):
    [truth] = full.truths.values()
    truths = {name: replace(truth, uncertainty={**truth.uncertainty, "slider.x": unsure}) for name in full.truths}
    with rc():
        drawing = next(drawing for drawing in difference_figures(replace(full, truths=truths, records=full.records[2:3])) if "position" in drawing.name)
    assert ("uncertainty of the truth" in [text.get_text() for text in drawing.figure.legends[0].get_texts()]) == drawn
