"""What a run found, in whole sentences whose numbers lead to the data. They stay true whatever is missing.

Joint and contact fidelity, and the two physics of static friction, answer different questions: no sentence compares
across them. Engines are ranked only where the same part of the work is theirs: who supplies the friction law, and who
locates events. Two numbers are ranked only where their uncertainties do not overlap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.hard.examination import UNJUDGED
from stiction.comparisons.hard.examination import VERDICTS as VERDICTS_OF_CASES
from stiction.comparisons.measures.drift_growth import GROWS
from stiction.comparisons.studies.constraint_drift import LAW_IN_WORDS, NONE, PAPERS, STEPS, TWICE, longest
from stiction.comparisons.studies.paper_claims import VERDICTS
from stiction.comparisons.studies.work_precision import HIGH, LOW
from stiction.comparisons.variants import OWN_CPU
from stiction.engines.protocol import FIDELITIES
from stiction.comparisons.methods import case_of, same_work
from stiction.reports.figures.threshold import known
from stiction.reports.markdown.cost_page import time_of
from stiction.comparisons.methods import (MISSING_ENGINE, at_equal_step, called, friction_by_adapter, grouped_methods, largest, methods,
                                                  tables_of)
from stiction.reports.markdown.ladder_ends import INTEGRATION, MODEL, POSITION, QUANTITY, End, ladder_ends
from stiction.reports.markdown.losses import losses
from stiction.comparisons.presentation.cells import MISSING, uncertainty_of
from stiction.comparisons.presentation.traced_text import NAME, Number, TracedText, count, listed, ratio, traced, value

JUMP, DRIFT = "jump error [N m]", "position drift, max [m]"
SAME = 0.01
"""Relative difference up to which two engines are said to err alike: their errors agree in two digits."""

ACCEPTED = frozenset(verdict for verdict in VERDICTS_OF_CASES if verdict not in UNJUDGED)

Tables = Mapping[str, pd.DataFrame]


@dataclass(frozen=True)
class Finding:
    """A sentence or two under a word."""

    title: str
    told: TracedText

    @property
    def text(self) -> str:
        return f"{self.title}. {self.told.text}"


def findings(validation: Results) -> list[Finding]:
    """Those for which there are data, agreement first."""
    tables = tables_of(validation)
    told: dict[str, Callable[[], TracedText]] = {
        "Agreement": lambda: _agreement(validation, tables),
        "Threshold of stick": lambda: _threshold(tables), "Torque jumps": lambda: _jumps(validation, tables), "Drift": lambda: _drift(tables),
        "Hard cases": lambda: _hard(validation, tables), "Cost": lambda: _cost(tables), "The paper": lambda: _paper(tables), "Runs": lambda: _runs(validation), "Not installed": lambda: _missing(validation)}
    found = [Finding(title, tell()) for title, tell in told.items()]
    return [finding for finding in found if finding.told]


def limits(validation: Results) -> list[Finding]:
    """What keeps the error of each engine from being smaller: integration, model, adapter."""
    tables = tables_of(validation)
    cost = tables.get("cost", pd.DataFrame())
    ends = list(ladder_ends(cost))
    own = [end for end in ends if end.variant in methods(validation)]
    found = [Finding("Limit: integration", _limited(cost, own, INTEGRATION, "still falls")),
             Finding("Limit: model", _limited(cost, own, MODEL, "does not fall any more")),
             Finding("No limit: equations", _accelerations(cost, ends)), Finding("Limit: adapter", listed([part for part in (_adapter(validation), _alike(validation, tables)) if part], " ", " "))]
    return [finding for finding in found if finding.told]


def lines(validation: Results) -> list[str]:
    """All of it for a terminal, a line each."""
    return [finding.text for finding in (*findings(validation), *limits(validation))]


def _agreement(validation: Results, tables: Tables) -> TracedText:
    """The methods of the reference, and of each group the closest engine, each in its worst case."""
    table, own, best = tables.get("accuracy", pd.DataFrame()), [], []
    for name, variants in grouped_methods(validation, same_work):
        worst = [row for variant in variants if (row := largest(at_equal_step(table, variant), POSITION)) is not None]
        own += [row for row in worst if table.at[row, "engine"] == "reference"]
        if others := sorted((row for row in worst if row not in own), key=lambda row: table.at[row, POSITION]):
            nearest = [called(table.at[row, "variant"], False) for row in others if not apart(table, POSITION, others[0], row)]
            best.append(traced("{} with {} ({})", listed(nearest), _reached(table, others[0]), name))
    parts = [traced("The largest distance from the independent solution is {}.", listed([traced("{} for {}", _reached(table, row), called(table.at[row, "variant"])) for row in own]))] if own else []
    if best:
        parts.append(traced("The closest engines are {}.", listed(best)))
    return listed(parts, " ", " ") if parts else TracedText("No run that could be compared with the truth came out.")


def _reached(table: pd.DataFrame, row: int) -> TracedText:
    return traced("{} m in {}", value("accuracy", table, row, POSITION), _case(table, row))


def apart(table: pd.DataFrame, column: str, one: int, other: int) -> bool:
    """Whether the sizes of two errors differ by more than both their uncertainties: only then one is said to be smaller."""
    unsure = sum(table.at[row, uncertainty_of(column)] for row in (one, other)) if uncertainty_of(column) in table else 0.0
    return bool(abs(abs(table.at[one, column]) - abs(table.at[other, column])) > unsure)


def _alike(validation: Results, tables: Tables) -> TracedText:
    """Engines with the adapter's friction law whose errors agree in some case, the most that do; and what they are where they do not agree."""
    table, by_adapter = tables.get("accuracy", pd.DataFrame()), friction_by_adapter(validation)
    best, likest = [], ""
    for _, variants in grouped_methods(validation, same_work):
        theirs = [variant for variant in variants if by_adapter.get(variant)]
        for rows in _by_case(table, theirs):
            for first in rows:
                near = [variant for variant, row in rows.items() if _same(table, row, rows[first])]
                if len(near) > max(1, len(best)):
                    best, likest = near, first
    if not best:
        return TracedText("")
    cases = [rows for rows in _by_case(table, best) if len(rows) == len(best)]
    alike = [rows[likest] for rows in cases if all(_same(table, row, rows[likest]) for row in rows.values())]
    apart_there = [rows for rows in cases if rows[likest] not in alike]
    each = [traced("{} m", value("accuracy", table, row, POSITION, ".1g")) for row in alike]
    parts = [traced("In {} {} have the same error of {}, within a hundredth: there scheme and bound, which they share, decide it.", listed([_case(table, row) for row in alike]),
                  listed([called(variant) for variant in best]), listed(each))]
    parts += [traced("In {} their errors are {}.", _case(table, rows[likest]), listed([traced("{} m", value("accuracy", table, row, POSITION)) for row in rows.values()]))
              for rows in apart_there]
    return listed(parts, " ", " ")


def _by_case(table: pd.DataFrame, variants: Sequence[str]) -> list[dict[str, int]]:
    """Of each scene the row of the largest error of each of the variants that has one, at equal step."""
    return [{variant: row for variant in variants if (row := largest(at_equal_step(table[table["scene"] == scene], variant), POSITION)) is not None}
            for scene in dict.fromkeys(table["scene"])]


def _same(table: pd.DataFrame, one: int, other: int) -> bool:
    return bool(abs(table.at[one, POSITION] / table.at[other, POSITION] - 1) < SAME)


def _case(table: pd.DataFrame, row: int, name: str = "accuracy") -> Number:
    return Number(case_of(table.at[row, "scene"]), name, "scene", NAME, (row + 1,))


def _threshold(tables: Tables) -> TracedText:
    table = tables.get("threshold", pd.DataFrame())
    if "error [N]" not in table or table["error [N]"].isna().all():
        return TracedText("")
    row = table["truth [N]"].first_valid_index()
    truth = Number(known(table.at[row, "truth [N]"], table.at[row, "truth uncertainty [N]"]), "threshold", "truth [N]", rows=(row + 1,))
    finest = table.loc[table[table["error [N]"].notna()].groupby("variant", sort=False)["step"].idxmin()]
    within = finest["error [N]"].abs() <= finest["uncertainty [N]"]
    near = within & (finest["truth [N]"] == table.at[row, "truth [N]"])  # that with mus = mu is another threshold
    best = int(finest["uncertainty [N]"].where(near, math.inf).idxmin())
    off = finest[~within]
    run = table[table["status"] != MISSING_ENGINE]
    none = [called(variant) for variant, rows in run.groupby("variant", sort=False) if rows["error [N]"].isna().all()]
    parts = [traced("In the steady state of {} the slider sticks up to F0 = {} N. The paper's own number is lost in the text we have.", _case(table, row, "threshold"), truth)]
    if near.any():
        parts.append(traced("The threshold of {} differs from that by {} N.", called(table.at[best, "variant"]), value("threshold", table, best, "error [N]")))
    if len(off):
        parts.append(traced("For {} the threshold at the finest step differs by more than its uncertainty.", listed([called(found) for found in off["variant"]])))
    if none:
        parts.append(traced("No threshold was found for {}.", listed(none)))
    return listed(parts, " ", " ")


def _jumps(validation: Results, tables: Tables) -> TracedText:
    """The worst of the methods that locate events, and of each group the best of those that do not, each by its worst jump."""
    table, true = tables.get("torque", pd.DataFrame()), "jump, truth [N m]"
    locates = {record.variant.label for record in validation.records if record.trajectory is not None and record.trajectory.events}
    located, sampled = [], []
    for name, variants in grouped_methods(validation, same_work):
        worst = {variant: row for variant in variants if (row := largest(at_equal_step(table, variant), JUMP)) is not None}
        located += [row for variant, row in worst.items() if variant in locates]
        if others := [row for variant, row in worst.items() if variant not in locates]:
            best = min(others, key=lambda row: abs(table.at[row, JUMP]))
            sampled.append(traced("{} N m ({}; {})", value("torque", table, best, JUMP), _not_apart(table, best, others, fidelity=False), name))
    parts = [traced("The largest true jump is {} N m.", value("torque", table, largest(table, true), true, ".2g"))] if located or sampled else []
    if located:
        row = max(located, key=lambda row: abs(table.at[row, JUMP]))
        parts.append(traced("Methods that locate events have every jump within {} N m (the least exact: {}).", value("torque", table, row, JUMP), _not_apart(table, row, located)))
    if sampled:
        parts.append(traced("From sampled output, the largest jump error of the best methods is {}.", listed(sampled)))
    return listed(parts, " ", " ")


def _not_apart(table: pd.DataFrame, first: int, rows: Sequence[int], fidelity: bool = True) -> TracedText:
    """The variant of a jump, and of all others of `rows` that are not told apart from it."""
    alike = [row for row in rows if row != first and not apart(table, JUMP, first, row)]
    names = listed([called(table.at[row, "variant"], fidelity) for row in (first, *alike)])
    return traced("{}, which cannot be ranked", names) if alike else names


def _drift(tables: Tables) -> TracedText:
    study = tables.get("study", pd.DataFrame())
    if "drift, of that without [-]" not in study:
        return TracedText("")
    first, sentences = study[study["scene"] == study["scene"].iloc[0]], []
    runs = first[(first["choice"] == NONE.label) & (first["reason"] == "") & first["step"].isin(STEPS)]
    if len(runs):
        row = int(runs["step"].idxmin())
        verdict, exponent, _, _, length = longest(study.loc[row])
        names = [f"{name}, {length:g} s [-]" for name in ("exponent of growth", "interval of the exponent")]
        if pd.notna(exponent):
            power = traced(", with the power {} of time", value("study", study, row, names[0], unsure=names[1])) if verdict == GROWS else ""
            sentences.append(traced("Without stabilization the drift {} over {} s at a step of {} s{}.", LAW_IN_WORDS[verdict],
                                  value("study", study, row, "time [s]"), value("study", study, row, "step", "g"), power))
    ours = first[(first["choice"] == PAPERS.label) & first["drift, of that without [-]"].notna() & first["step"].isin(STEPS)]
    if len(ours):
        parts = [traced("{} at a step of {} s", value("study", study, int(row), "drift, of that without [-]", ".2g"), value("study", study, int(row), "step", "g"))
                 for row in dict.fromkeys((ours["step"].idxmin(), ours["step"].idxmax()))]
        sentences.append(traced("With the paper's alpha and beta, the ratio of the drift to that without stabilization, over the time of the paper's figure, is {}.", listed(parts)))
    worse = "error, of that without [-]"
    harmed = study.loc[(study["choice"] == PAPERS.label) & study["step"].isin(STEPS), worse] if worse in study else pd.Series(dtype=float)
    if harmed.max() > TWICE:
        row = int(harmed.idxmax())
        sentences.append(traced("With them the position error in {} is {} times as large at a step of {} s.", _case(study, row, "study"), value("study", study, row, worse, ".2g"), value("study", study, row, "step", "g")))
    return listed(sentences, " ", " ")


def _hard(validation: Results, tables: Tables) -> TracedText:
    table = tables.get("hard", pd.DataFrame())
    if table.empty or not table["verdict"].isin(ACCEPTED).any():
        return TracedText("")
    every, first = count("hard", table, variant=table["variant"].iloc[0]), [variant for variant in dict.fromkeys(table["variant"])]
    own = [variant for variant in first if (table.loc[table["variant"] == variant, "engine"] == "reference").all()]
    parts = [traced("{} {}", called(variant), _right(table, variant)) for variant in own]
    sentences = [traced("There are {} cases. Right answers, of the cases that a method accepts: {}.", every, listed(parts) if parts else MISSING)]
    best = []
    for name, variants in grouped_methods(validation, same_work):
        if others := [variant for variant in variants if variant in first and variant not in own]:
            right = {variant: int((table["verdict"].eq("right") & table["variant"].eq(variant)).sum()) for variant in others}
            best.append(traced("{} ({})", listed([traced("{} {}", called(variant, False), _right(table, variant)) for variant in others if right[variant] == max(right.values())]), name))
    if best:
        sentences.append(traced("The engines with the most right answers: {}.", listed(best)))
    return listed(sentences, " ", " ")


def _right(table: pd.DataFrame, variant: str) -> TracedText:
    return traced("{} of {}", count("hard", table, variant=variant, verdict="right"), count("hard", table, variant=variant, verdict=ACCEPTED))


def _cost(tables: Tables) -> TracedText:
    """The smallest error that timed steps of an engine reach, in powers of ten, and what it costs those that do and the reference; nobody is ranked by time."""
    table = equal_errors(tables)
    if table.empty:
        return TracedText("")
    cost = tables.get("cost", table)
    stepping = cost.loc[(cost["parameter"] == "dt") & (cost["engine"] != "reference"), "variant"] if "parameter" in cost else ()
    others, ours = table[table["variant"].isin(stepping) & (table["fidelity"] == "joint")], table[table["variant"] == "reference"]
    target = others["error"].min()
    ours = ours[ours["error"] == target]
    if ours.empty:
        return TracedText("")
    own, parts = int(ours.index[0]), []
    for row in others.index[others["error"] == target]:
        times = ratio("equal-error", table, int(row), own, OWN_CPU, LOW, HIGH)
        bound, too = _bound(table.at[row, "at most"], table.at[own, "at most"])
        parts.append(traced("{} takes {} s of CPU in its own calls, {}{} times as long as the reference{}", called(table.at[row, "variant"]),
                          Number(time_of(table.loc[row]), "equal-error", OWN_CPU, rows=(int(row) + 1,)), bound, times, too))
    return traced("The tightest target that an engine other than ours met in {} with its own steps, of those that were timed, is a position error of {} m. To reach it, {}.", _case(table, own, "equal-error"),
                value("equal-error", table, own, "error", "g"), listed(parts, "; ", "; "))


def _bound(over: bool, under: bool) -> tuple[str, str]:
    """What is said before and behind the ratio of two times of which either may be the most that it takes."""
    return ("", ", whose time is a bound too") if over and under else ("at most " if over else "at least " if under else "", "")


def equal_errors(tables: Tables) -> pd.DataFrame:
    """Times to position errors that are reached, in the first scene; with the labels of the whole table."""
    table = tables.get("equal-error", pd.DataFrame())
    if table.empty:
        return table
    return table[(table["scene"] == table["scene"].iloc[0]) & (table["quantity"] == QUANTITY.name) & table[OWN_CPU].notna()]


def _paper(tables: Tables) -> TracedText:
    table = tables.get("claims", pd.DataFrame())
    if table.empty:
        return TracedText("")
    there = [verdict for verdict in VERDICTS if (table["verdict"] == verdict).any()]
    return traced("Of the paper's {} statements {}.", count("claims", table), listed([traced("{} {}", count("claims", table, verdict=verdict), _one_or_more(verdict, table)) for verdict in there]))


def _one_or_more(verdict: str, table: pd.DataFrame) -> str:
    """The verdict after a number: ``13 hold``, ``1 contradicts itself``."""
    plural = {"holds": "hold", "does not hold": "do not hold", "contradicts itself": "contradict themselves", "holds in the steady state only": "hold in the steady state only",
              "partly": "hold partly", "not testable": "are not testable"}
    return {"partly": "holds partly", "not testable": "is not testable"}.get(verdict, verdict) if (table["verdict"] == verdict).sum() == 1 else plural.get(verdict, verdict)


_LOST = {MISSING_ENGINE: ("is of an engine that is not installed", "are of engines that are not installed"), "not run": ("was not run", "were not run")}
"""What is said of a run, and of several, of a status where it is not the word itself."""


def _runs(validation: Results) -> TracedText:
    """What was lost; nothing where all came out."""
    if not validation.records:
        return TracedText("There were no runs.")
    runs, all_lost = pd.DataFrame([record.describe() for record in validation.records]), losses(validation)
    lost = [(status, _LOST.get(status, (status, status))) for status in dict.fromkeys(runs["status"]) if status != "ok"]
    parts = [traced("{} {}", count("runs", runs, status=status), one if (runs["status"] == status).sum() == 1 else several) for status, (one, several) in lost]
    told = [traced("{} of {} runs came out; {}.", count("runs", runs, status="ok"), count("runs", runs), listed(parts))] if lost else []
    if len(all_lost) > (runs["status"] != "ok").sum():
        told.append(TracedText("Some runs stopped early, or failed inside a comparison that started them."))
    return traced('{} Reasons are under "What did not come out?"', listed(told, " ", " ")) if told else TracedText("")


def _missing(validation: Results) -> TracedText:
    """What takes no part because its package is not there."""
    lost = [record.variant.engine for record in validation.records if record.outcome.status == MISSING_ENGINE]
    names = list(dict.fromkeys(lost))
    return traced('{} took no part; the command "stiction engines" says what brings {}.', listed(names), "them" if len(names) > 1 else "it") if names else TracedText("")


def _limited(cost: pd.DataFrame, ends: list[End], limit: str, words: str) -> TracedText:
    """Whose ladders end for a reason, by fidelity, each with the order at its last rung, or, where its rungs are no steps, the error."""
    order, parts = "order, position [-]", []
    for fidelity in FIDELITIES:
        there = [end for end in ends if end.limit == limit and cost.at[end.row, "fidelity"] == fidelity]
        named = [traced("{} (order {})", called(end.variant, False), value("cost", cost, end.last, order, "z.1f")) if order in cost and pd.notna(cost.at[end.last, order])
                 else traced("{} (error {} m)", called(end.variant, False), value("cost", cost, end.row, POSITION)) for end in there]
        if named:
            parts.append(traced("at {} fidelity of {}", fidelity, listed(named)))
    return traced("At the last rung of the ladder the error {} {}.", words, listed(parts, "; ", "; ")) if parts else TracedText("")


def _accelerations(cost: pd.DataFrame, ends: list[End]) -> TracedText:
    """Engines whose accelerations, under another integrator, come closer than their own steps: their equations are right."""
    reached = {end.variant: end for end in ends}
    parts = []
    for end in ends:
        engine = cost.at[end.row, "engine"]
        steps = [other for other in reached.values() if cost.at[other.row, "engine"] == engine and other.parameter == "dt" and cost.at[other.row, "fidelity"] == "joint"]
        if end.parameter == "rtol" and engine != "reference" and steps and end.error < steps[0].error:
            parts.append(traced("the accelerations of {} in our event-locating integrator give an error of {} m, the engine's own stepping {} m", called(steps[0].variant), value("cost", cost, end.row, POSITION),
                              value("cost", cost, steps[0].row, POSITION)))
    return traced("{}: there the time stepping limits accuracy.", listed(parts, "; ", "; ")) if parts else TracedText("")


def _adapter(validation: Results) -> TracedText:
    named = [called(variant) for variant, by_adapter in friction_by_adapter(validation).items() if by_adapter and variant in methods(validation)]
    return traced("Our adapter sets the bound of friction, or switches its coefficient, for {}.", listed(named)) if named else TracedText("")
