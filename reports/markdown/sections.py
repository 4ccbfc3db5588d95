"""The sections of a report after page one, one question each: its figures, a short table, where all rows are."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.measures.accuracy import EVENT_WINDOW, KINDS, missed
from stiction.comparisons.studies.constraint_drift import STEPS, drift_words
from stiction.comparisons.studies.engine_settings import EVERYWHERE, FACTOR, ON_FRONT, SUBJECT, ranks_of_defaults
from stiction.comparisons.studies.equal_error import LOST
from stiction.comparisons.uncertain import Uncertain
from stiction.comparisons.variants import EVENTS_BY, FRICTION_BY, OWN_CPU
from stiction.reports.figures import Drawing
from stiction.comparisons.methods import case_of, groups, known_of, title_of
from stiction.reports.markdown.claims_page import HARM_WORDS, harm_shown, study_shown
from stiction.reports.markdown.cost_page import MOST, SETTINGS_WORDS, WORDS, times_table
from stiction.comparisons.methods import at_equal_step, grouped_methods, largest, methods, tables_of
from stiction.reports.markdown.findings import DRIFT, JUMP
from stiction.reports.markdown.hard_page import hard_section
from stiction.reports.markdown.ladder_ends import POSITION, QUANTITY, REASONS
from stiction.reports.markdown.losses import grouped, losses
from stiction.comparisons.presentation.cells import MISSING, NULL, setting_of, uncertainty_of
from stiction.reports.markdown.tables import ROWS, all_rows, fitted

NOT_COMPARED = "(not compared in this run; `stiction validate --full` compares everything)"
TITLES = {"claims": "Does what the paper says hold?", "sensitivity": "Does it depend on what the paper leaves open?", "paper": "The paper's figures, redrawn",
          "accuracy": "How far are the methods from the truth?", "orders": "Does the reference converge as its methods promise?",
          "cost": "What does accuracy cost?", "effects": "What does each effect of the scene cost?", "suppression": "What does drift suppression cost?",
          "settings": "Are the engines at their best?",
          "threshold": "Up to which load does the slider stick?", "torque": "How well are the jumps of the driving torque found?",
          "study": "What does stabilization do against drift?", "drift": "How far do the engines drift?", "hard": "Where do methods break down?",
          "failures": "What did not come out?"}
"""By topic, in the order of the report."""


def sections(validation: Results, figures: Sequence[Drawing]) -> Iterator[str]:
    """The sections in the order of `TITLES`, in Markdown."""
    tables = tables_of(validation)
    for topic, title in TITLES.items():
        parts = [f"![{figure.told}](figures/{figure.name}.png)\n\n{figure.caption} ([PDF](figures/{figure.name}.pdf))" for figure in figures if figure.topic == topic]
        table = tables.get(topic, pd.DataFrame())
        if topic == "failures":
            parts += _failures(validation)
        elif topic == "paper":
            parts = parts or ["(no run came out that could be drawn)"]
        elif table.empty:
            parts.append(NOT_COMPARED)
        else:
            parts += [*_SHORT[topic](validation, table), all_rows(topic, len(table))]
        yield "\n\n".join([f"## {title}", *parts])


def _claims(_: Results, table: pd.DataFrame) -> list[str]:
    """What does not simply hold, first."""
    counts = table["verdict"].value_counts()
    order = table.assign(place=table["verdict"].map(counts)).sort_values("place", kind="stable")
    shown = order[[name for name in ("case", "claim", "verdict", "run needed [s]") if name in table]].rename(columns={"run needed [s]": "needs [s]"})
    return [", ".join(f"{verdict}: {count}" for verdict, count in counts.items()) + ". The rarest verdicts first:", fitted(shown)]


def _sensitivity(_: Results, table: pd.DataFrame) -> list[str]:
    names = {"choice": "choice", "threshold on F0 [N]": "threshold [N]", "stick time per period, case 1 [s]": "stick, case 1 [s]",
             **{f"largest {what}, case {case} [{unit}]": f"{what}, {case} [{unit}]" for case in (1, 3) for what, unit in (("F_i", "N"), ("moment", "N m"))}}
    changes = [f"- *{row['choice']}*: " + (f"verdicts that change: {row['claims that change']}. Numbers that change: {row['numbers that change']}."
                                           if isinstance(row.get("claims that change"), str) else str(row["reason"])) for row in table.iloc[1:].to_dict("records")]
    return ["Of the independent solution: the threshold on F0, and of the steady state the stick time in a period and the largest corner force and moment, of the case that is named.",
            fitted(table[[name for name in names if name in table]].rename(columns=names)), "\n".join(changes)]


def _per_case(validation: Results, table: pd.DataFrame, column: str, unit: str) -> list[str]:
    """A row per method at equal step, a column per case with the largest of `column`."""
    rows, unsure = [], uncertainty_of(column)
    friction, events = (known_of(validation.tables.get("accuracy", table), name) for name in (FRICTION_BY, EVENTS_BY))
    for group, variants in grouped_methods(validation):
        for variant in variants:
            there = at_equal_step(table, variant)
            if there.empty:
                continue
            row: dict[str, object] = {"method": variant, FRICTION_BY: friction.get(variant, MISSING),
                                      EVENTS_BY: events.get(variant, MISSING),
                                      "physics": group.partition(", ")[2],
                                      "rung": f"{there['step'].iloc[0]:g}" + (" s" if there["parameter"].iloc[0] == "dt" else "")}
            for scene, part in there.groupby("scene", sort=False):
                if (worst := largest(part, column)) is not None:
                    size, about = abs(float(part.at[worst, column])), part.at[worst, unsure] if unsure != column and unsure in part else float("nan")
                    row[f"{case_of(scene)} [{unit}]"] = f"{size:.2g}" if pd.isna(about) else str(Uncertain(size, float(about)))
            rows.append(row)
    return [fitted(pd.DataFrame(rows))] if rows else ["No run came out."]


def _accuracy(validation: Results, table: pd.DataFrame) -> list[str]:
    return ["Largest error of position at equal step. Only methods of one fidelity and one physics of static friction may be compared, "
            "and ranked only where the same supply the friction law and locate events.",
            *_per_case(validation, table, POSITION, "m"), *_located(validation, table)]


def _located(validation: Results, table: pd.DataFrame) -> list[str]:
    """Of each method that locates events how many it has of those of the truth, and of which kind it misses any, all cases together."""
    rows, counts = [], ["events matched", "events missed", "events spurious"]
    for variant in methods(validation):
        there = at_equal_step(table, variant)
        if not set(counts) <= set(there) or there[counts[0]].isna().all():
            continue
        matched, lost, spurious = (int(there[name].sum()) for name in counts)
        kinds = [f"{int(there[missed(kind)].sum())} {kind}" for kind in KINDS if missed(kind) in there and there[missed(kind)].sum()]
        rows.append({"method": variant, "true": matched + lost, "found": matched, "spurious": spurious, "missed, by kind": ", ".join(kinds) or "none",
                     "time error [s]": f"{there['event time error [s]'].max():.2g}"})
    words = f"Events at equal step, all cases together, found within {1e3 * EVENT_WINDOW:g} ms; of the time the largest error. Methods that are not listed locate none."
    return [words, fitted(pd.DataFrame(rows))] if rows else []


def _torque(validation: Results, table: pd.DataFrame) -> list[str]:
    lost = {variant: int((~rows["resolved"].astype(bool)).sum()) for variant in methods(validation) if "resolved" in table and len(rows := at_equal_step(table, variant))}
    unseen = ", ".join(f"{variant} {count}" for variant, count in lost.items() if count)
    return ["Largest error of a jump's size at equal step, of the jumps that a run resolves.", *_per_case(validation, table, JUMP, "N m"),
            *([f"Jumps that a run does not resolve, all cases together: {unseen}."] if unseen else [])]


def _drift(validation: Results, table: pd.DataFrame) -> list[str]:
    return ["Norm of the residuals of the constraints in metres and radians, largest over time, at equal step.", *_per_case(validation, table, DRIFT, "m, rad")]


def _threshold(_: Results, table: pd.DataFrame) -> list[str]:
    rows = []
    for variant, ladder in table.groupby("variant", sort=False):
        finest = ladder.loc[ladder["step"].idxmin()]
        error = finest.get("error [N]")
        rows.append({"method": variant, "fidelity": finest["fidelity"], "mus": finest["mus"], "finest rung": setting_of(finest["parameter"], finest["step"]),
                     "F0 less truth [N]": finest["reason"] if pd.isna(error) else str(Uncertain(float(error), float(finest["uncertainty [N]"])))
                     if "uncertainty [N]" in table else f"{error:.2g}"})
    theorems = [text for text in table["theorem"].dropna().unique() if text] if "theorem" in table else []
    return [f"The paper's own figure: `{NULL}`.", fitted(pd.DataFrame(rows)), *(f"*Proven.* {text}" for text in theorems)]


def _orders(_: Results, table: pd.DataFrame) -> list[str]:
    methods = table.drop_duplicates("method")
    found = [Uncertain(order, half).both() if order == order else MISSING
             for order, half in zip(methods["observed order [-]"], methods["interval of the order [-]"])]
    shown = pd.DataFrame({"method": methods["method"], "expected order": methods["order of the method [-]"], "order found (± 95 %)": found})
    return [fitted(shown.assign(**{"why none": methods["why none"]} if methods["why none"].fillna("").any() else {}))]


def _cost(validation: Results, table: pd.DataFrame) -> list[str]:
    """Per group the time to given errors of position in the first scene, and where ladders end."""
    parts, equal = [WORDS], validation.tables.get("equal-error", pd.DataFrame())
    if equal.empty:
        return ["No ladder has an error."]
    position = equal[(equal["scene"] == equal["scene"].iloc[0]) & (equal["quantity"] == QUANTITY.name) & (equal["because"] != LOST)]
    stepped = table.loc[table["parameter"] != "iterations", "variant"]
    for name, rows in groups(position[position["variant"].isin(stepped)]):
        shown = times_table(rows, MOST).drop(columns=["scene", "fidelity", "quantity"])
        parts += [f"*{name}*: CPU time [ms] to an error of position [m], and the smallest error of the ladder.",
                  fitted(shown.rename(columns={"variant": "method", "ends at": "ends at [m]"}).assign(**{"ends at [m]": [f"{end:.2g}" for end in shown["ends at"]]}))]
    told = {limit: f"*{limit}*: the error {words}" for limit, words in REASONS.items() if (position["because"] == limit).any()}
    more = f"Torque and event time{', and other mechanisms,' if equal['scene'].nunique() > 1 else ''} are in the data. {all_rows('equal-error', len(equal))} Of every rung:"
    return [*parts, *([f"Limits: {'; '.join(told.values())}."] if told else []), more]


def _effects(_: Results, table: pd.DataFrame) -> list[str]:
    """CPU time first, which the section is about; the status only where one did not come out."""
    own = table[table["engine"] == "reference"] if (table["engine"] == "reference").any() else table
    shown = pd.DataFrame({"effect": own["effect"]})
    if "cpu, of baseline [-]" in own:
        ends = zip(*(own[f"cpu, of baseline{end} [-]"] for end in ("", ", low", ", high")))
        shown["CPU, of declared"] = [None if pd.isna(ratio) else Uncertain(ratio, max(ratio - low, high - ratio)) for ratio, low, high in ends]
    shown = shown.join(own[[name for name in ("stick events", "position change [m]") if name in own]])
    if (own["status"] != "ok").any():
        shown["status"] = own["status"]
    known = own.get("settings", pd.Series(dtype=str)).dropna()  # a run that was lost has none
    with_terms = len(known) > 0 and json.loads(known.iloc[0]).get("stabilization", {}).get("method") == "baumgarte"
    also = " That has Baumgarte's terms against drift; *reference* in other tables projects, and takes a fraction of the time." if with_terms else ""
    first = own.iloc[0]
    return [f"Of the {first['engine']} at {setting_of(first['parameter'], first['step'])}, against the scene as declared.{also}", fitted(shown)]


def _suppression(_: Results, table: pd.DataFrame) -> list[str]:
    names = ("variant", "suppression", "step", OWN_CPU, DRIFT, POSITION)
    return ["The paper's scheme first; drift at the output instants.",
            fitted(table.sort_values("parameter", kind="stable")[[name for name in names if name in table]].rename(columns={DRIFT: "drift [m, rad]", POSITION: "error [m]"}))]


def _settings(_: Results, table: pd.DataFrame) -> list[str]:
    """Per method of an engine how its default stands on the front of error and time, and what gains most."""
    ranks = ranks_of_defaults(table)
    if ranks.empty:
        return ["No run came out."]
    names = {SUBJECT: "engine", ON_FRONT: ON_FRONT, EVERYWHERE: EVERYWHERE, FACTOR: "slower", "choice": "than", "scene": "in", "step": "step [s]"}
    shown = ranks.assign(scene=ranks["scene"].map(case_of, na_action="ignore"), **{FACTOR: [MISSING if pd.isna(factor) else f"{factor:.2g}" for factor in ranks[FACTOR]]})
    return [SETTINGS_WORDS, fitted(shown[list(names)].rename(columns=names))]


def _study(_: Results, table: pd.DataFrame) -> list[str]:
    """The first case: without stabilization, with the paper's, with projection, at the smallest and the largest step."""
    names = {"choice": "choice", "step": "step [s]", "position drift to 24 s, max [m]": "drift [m, rad]", "law of growth": "law of growth",
             "drift, of that without [-]": "drift ratio"}
    shown = study_shown(table[table["scene"] == table["scene"].iloc[0]])
    chosen = list(dict.fromkeys(shown["choice"]))
    rows = shown[shown["choice"].isin([*chosen[:2], chosen[-1]]) & (shown["reason"].fillna("") == "") & shown["step"].isin(STEPS)]
    ends = rows.groupby("choice")["step"].agg(["min", "max"])
    rows = rows[[step in set(ends.loc[choice]) for choice, step in zip(rows["choice"], rows["step"])]]
    parts = [f"{title_of(table['scene'].iloc[0])}, the smallest and the largest step. Drift is the largest in 24 s, its ratio to that without stabilization; in brackets alpha and beta, 1/s.",
             fitted(rows[[name for name in names if name in rows]].rename(columns=names))]
    if len(does_harm := harm_shown(table)):
        parts += [HARM_WORDS, fitted(does_harm.assign(scene=[case_of(scene) for scene in does_harm["scene"]]), len(does_harm))]
    return [*parts, *drift_words(table)]


def _hard(validation: Results, table: pd.DataFrame) -> list[str]:
    return hard_section(table)


def _failures(validation: Results) -> list[str]:
    lost = losses(validation)
    if lost.empty:
        return ["Nothing: every run came out."]
    shown = grouped(lost)
    more = f" The first {ROWS} of {len(shown)} kinds." if len(shown) > ROWS else ""
    return [f"{len(lost)} runs or rows are lost or incomplete; all are in [failures.md](failures.md).{more}", fitted(shown[["variant", "status", "runs", "reason"]])]


_SHORT = {"claims": _claims, "sensitivity": _sensitivity, "accuracy": _accuracy, "orders": _orders, "cost": _cost, "effects": _effects, "suppression": _suppression,
          "settings": _settings, "threshold": _threshold, "torque": _torque, "study": _study, "drift": _drift, "hard": _hard}


def variants_table(validation: Results) -> str:
    """The methods: engine, version, who supplies the friction law, who locates events."""
    rows = {record.variant.label: record for record in validation.records}
    rows |= {record.variant.label: record for record in validation.records if record.trajectory is not None}
    return fitted(pd.DataFrame([{"method": label, "engine": record.variant.engine, "version": record.trajectory.version if record.trajectory else "",
                                 "fidelity": record.variant.fidelity,
                                 **{column: record.describe()[column] or "" for column in (FRICTION_BY, EVENTS_BY)},
                                 "ladder": f"{record.variant.parameter} = {record.variant.ladder[0]:g} .. {record.variant.ladder[-1]:g}" if record.variant.ladder else ""}
                                for label, record in rows.items() if label in methods(validation)]))
