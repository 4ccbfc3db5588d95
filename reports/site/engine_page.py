"""The page of an engine: what it supplies, its versions, its numbers in each question, settings, and changes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape
from itertools import pairwise

import pandas as pd

from stiction.comparisons.bench.presentation import TableView
from stiction.comparisons.bench.presentation.cells import MISSING, cell
from stiction.comparisons.bench.quantities import quantity_of
from stiction.comparisons.bench.study import Study
from stiction.comparisons.regression.check import Finding
from stiction.comparisons.regression.night_changes import short_commit
from stiction.engines import Engine, EngineMissing, engine_names, load_engine
from stiction.engines.joint_effects import JointEffect
from stiction.engines.protocol import Supplier
from stiction.reports.page.document import Abbreviation, Cell, Link, details, link, markdown, table
from stiction.reports.page.history_page import not_applicable_table
from stiction.reports.page.nights import HAS_FAILED, IS_REFUSED, status_in_words
from stiction.reports.page.run_page import row_anchor
from stiction.reports.run_folder.trace import keys
from stiction.reports.site.content import SiteContent, SiteRun, question_path, versions_in_words
from stiction.reports.site.layout import (
    DOCS,
    anchor,
    bullet_list,
    page,
    relative,
    run_origin,
    time_in_words,
)
from stiction.reports.site.night_tables import end_of_run, engine_table, metric_head
from stiction.reports.text import render_blocks, template
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.wording import as_given

TEMPLATE = "site/engine.md"
"""Path of the text in ``templates``."""
MAX_CHANGES = 60
"""Largest number of rows of the table of changes, which begins with those of the newest night."""


def engine_page(content: SiteContent, engine: str) -> str:
    """Return the HTML of the page of an engine."""
    runs = content.newest_rows[content.newest_rows["engine"] == engine].drop_duplicates("key")
    subtitle = f"Engine {engine} {versions_in_words(runs)}"
    sections = _sections(content, engine, runs)
    return page(content, content.engine_pages[engine], engine, subtitle, sections)


def _sections(
    content: SiteContent, engine: str, runs: pd.DataFrame
) -> Iterator[tuple[str, list[str]]]:
    """Yield the heading of each section of the page, and its blocks of HTML.

    `runs` has a row for each run of the engine in the newest night.
    """
    texts = {name: markdown(text) for name, text in render_blocks(template(TEMPLATE), {}).items()}
    path = content.engine_pages[engine]
    yield "What it supplies", _supplies(content, engine, path, texts["not_loaded"])
    yield "Versions", [_versions(content, engine)]
    yield "What changed when", [texts["changes"], *_changes(content, engine)]
    yield "Numbers in each question", [texts["numbers"], *_numbers(content, engine, path)]
    if runs["settings"].notna().any():
        yield "Settings", [texts["settings"], _settings(content, runs)]
    failed = runs[runs[HAS_FAILED]]
    if not failed.empty:
        yield "Failed and incomplete runs", [_failed_runs(content, failed)]
    refused = runs[runs[IS_REFUSED]]
    if not refused.empty:
        yield "Not applicable", [not_applicable_table(refused)]


def _supplies(content: SiteContent, engine: str, path: str, not_loaded: str) -> list[str]:
    """Return the HTML of what an engine supplies, as its adapter in this installation states it."""
    blocks = []
    loaded = _loaded(engine)
    if loaded is None:
        blocks.append(not_loaded)
    else:
        blocks += [_capabilities(loaded), _effects(loaded)]
    if content.docs is not None and (content.docs / "engines" / f"{engine}.html").is_file():
        target = relative(f"{DOCS}/engines/{engine}.html", path)
        blocks.append(link(f"How the mechanism is modelled in {engine}, and why", target))
    return blocks


def _loaded(name: str) -> Engine | None:
    """Return an engine by its name, None if it is not installed or not known by name.

    The code of files and of addresses of modules is not run: a history may come from elsewhere.
    """
    if name not in engine_names():
        return None
    try:
        return load_engine(name)
    except EngineMissing:
        return None


def _capabilities(engine: Engine) -> str:
    """Return the HTML of the table of the capabilities of an engine, with one column for each fidelity."""
    capabilities = engine.capabilities
    fidelities = capabilities.fidelities
    rows = [
        ["friction law", *(capabilities.friction_law[fidelity] for fidelity in fidelities)],
        [
            "static coefficient larger than the kinetic one",
            *(_yes_or_no(capabilities.static_coefficient[fidelity]) for fidelity in fidelities),
        ],
        ["friction supplied by", *(_supplier(engine, fidelity) for fidelity in fidelities)],
        ["events located by", *(_event_locator(engine, fidelity) for fidelity in fidelities)],
        ["reactions taken from", *(capabilities.reactions for _ in fidelities)],
        ["order of convergence", *(capabilities.order for _ in fidelities)],
    ]
    heads = ["property", *(f"{fidelity} fidelity" for fidelity in fidelities)]
    caption = f"{engine.name} {engine.version}, as its adapter states it."
    return table(caption, heads, rows, [False] * len(heads))


def _event_locator(engine: Engine, fidelity: Fidelity) -> str:
    """Return who locates events with the default settings."""
    if engine.locates_events(fidelity, engine.default_settings(fidelity)):
        return str(engine.capabilities.event_location)
    return str(Supplier.NOBODY)


def _supplier(engine: Engine, fidelity: Fidelity) -> str:
    """Return who supplies the friction law with the default settings."""
    return str(engine.friction_supplier(fidelity, engine.default_settings(fidelity)))


def _effects(engine: Engine) -> str:
    """Return the HTML of the table of effects, and whether each fidelity of an engine represents them."""
    effects_of = engine.capabilities.joint_effects
    fidelities = engine.capabilities.fidelities
    rows = []
    for effect in JointEffect:
        cells = [_yes_or_no(effect in effects_of.get(fidelity, ())) for fidelity in fidelities]
        rows.append([str(effect), *cells])
    heads = ["effect beside Coulomb friction in guides", *map(str, fidelities)]
    caption = "Effects that scenes may declare; a scene with another effect is refused."
    return table(caption, heads, rows, [False] * len(heads))


def _yes_or_no(value: bool) -> str:
    """Return a truth value as a word."""
    return "yes" if value else "no"


def _versions(content: SiteContent, engine: str) -> str:
    """Return the HTML of the table of nights with the version and the runs of an engine, the latest first."""
    all_rows = content.nights.rows
    runs = all_rows[all_rows["engine"] == engine].drop_duplicates(["night", "key"])
    rows: list[list[Cell]] = []
    for night, part in runs.groupby("night", sort=True):
        counts = Counter(
            status_in_words(status, reason)
            for status, reason in zip(part["status"], part["reason"], strict=True)
        )
        statuses = ", ".join(f"{count} {status}" for status, count in counts.items())
        number = "first night"
        if night in content.value_changes:
            number = str(len(_changes_of(content, engine, str(night))))
        full_commit = content.nights.origins[str(night)].get("commit")
        commit = Abbreviation(short_commit(full_commit), full_commit or "unknown")
        rows.append([str(night), versions_in_words(part), commit, statuses, number])
    rows.reverse()
    heads = (
        "night",
        "version of the engine",
        "commit of stiction",
        "runs",
        "values changed beyond noise",
    )
    caption = "The nights, the latest first, and what has changed since the night before."
    return table(caption, heads, rows, [False, False, False, False, True])


def _changes_of(content: SiteContent, engine: str, night: str) -> list[Finding]:
    """Return the changes of the runs of an engine in a night, the worst first."""
    rows = content.nights.rows
    is_run = (rows["night"] == night) & (rows["engine"] == engine)
    engine_keys = set(rows.loc[is_run, "key"])
    return [change for change in content.value_changes[night] if change.key in engine_keys]


def _changes(content: SiteContent, engine: str) -> Iterator[str]:
    """Yield the HTML of the list of changes of the version, and of the table of changes of values, the latest first."""
    versions = _version_changes(content, engine)
    if versions:
        yield bullet_list(escape(line) for line in versions)
    rows = []
    for night in sorted(content.value_changes, reverse=True):
        for group in _grouped(content, _changes_of(content, engine, night)):
            rows.append([night, *_change_cells(group)])
    if not rows:
        yield "<p>No value has changed beyond noise from one night to the next.</p>"
        return
    heads = ("night", "number", "before", "now", "change", "runs", "run that changed most", "why")
    shown_rows = rows[:MAX_CHANGES]
    caption = (
        f"Changes beyond noise since the night before: the latest {len(shown_rows)} of {len(rows)}."
    )
    right = [False, False, True, True, False, True, False, False]
    yield table(caption, heads, shown_rows, right)


def _version_changes(content: SiteContent, engine: str) -> list[str]:
    """Return a line for each change of the version of an engine, the latest first.

    A night whose runs state no version is passed over.
    """
    rows = content.nights.rows
    stated = rows[(rows["engine"] == engine) & rows["version"].notna()]
    version_of = {
        str(night): versions_in_words(part) for night, part in stated.groupby("night", sort=True)
    }
    lines = []
    for before, night in pairwise(version_of):
        if version_of[before] != version_of[night]:
            count = len(_changes_of(content, engine, night))
            lines.append(
                f"Night of {time_in_words(night)}: version {version_of[before]} -> {version_of[night]}; "
                f"{count} values changed beyond noise."
            )
    return lines[::-1]


def _grouped(content: SiteContent, changes: Sequence[Finding]) -> list[list[Finding]]:
    """Return the changes in groups of equal severity, metric and method, the worst first in each group."""
    variants = content.nights.rows.drop_duplicates("key").set_index("key")["variant"]
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for change in changes:
        group = (change.severity, change.metric, str(variants[change.key]))
        groups.setdefault(group, []).append(change)
    return list(groups.values())


def _change_cells(group: Sequence[Finding]) -> list[str]:
    """Return the cells that describe a group of changes by the worst of them, without the night."""
    worst = group[0]
    quantity = quantity_of(worst.metric)
    return [
        metric_head(worst.metric),
        cell(quantity, worst.before),
        cell(quantity, worst.now),
        worst.severity,
        str(len(group)),
        worst.key,
        worst.reason,
    ]


def _numbers(content: SiteContent, engine: str, path: str) -> Iterator[str]:
    """Yield the HTML of the numbers of an engine in each question that has any."""
    for study in content.questions:
        tables = []
        night_table = engine_table(content, study, engine, path)
        if night_table:
            tables.append(night_table)
        section = content.section(study)
        run = content.newest_run
        if run is not None and section is not None:
            for view in section.tables:
                tables += _rows_of_engine(run, study, view, engine, path)
        if tables:
            target = relative(question_path(study), path)
            heading = f"<p>{anchor('All engines: ' + study.question, target)}</p>"
            label = study.title or study.question
            yield details(f"{label}: {study.question}", "\n".join([heading, *tables]))


def _rows_of_engine(
    run: SiteRun, study: Study, view: TableView, engine: str, path: str
) -> Iterator[str]:
    """Yield the HTML of the rows of a table that were computed from runs of one engine only, if there are any."""
    source = run.stored.tables[view.source]
    if "engine" not in source:
        return
    engines = list(source["engine"])
    rows: list[list[Cell]] = []
    for cells, key, numbers in zip(view.cells(), keys(view), view.rows, strict=True):
        # Rows of the source are counted from 1.
        if {engines[number - 1] for number in numbers} == {engine}:
            target = relative(f"{question_path(study)}#{row_anchor(key)}", path)
            rows.append([*cells, Link(key, target)])
    if rows:
        caption = f"{view.caption} {run_origin(run)}."
        yield table(caption.strip(), [*view.heads(), "key"], rows, [*view.right(), False])


def _settings(content: SiteContent, runs: pd.DataFrame) -> str:
    """Return the HTML of the table of settings, with one column for each method of an engine.

    A setting that depends on the run, such as the step, has several values; they are joined by commas.
    """
    values: dict[str, dict[str, list[str]]] = {}
    variants = list(dict.fromkeys(runs["variant"]))
    for run in runs[runs["settings"].notna()].to_dict("records"):
        for name, value in json.loads(run["settings"]).items():
            text = value if isinstance(value, str) else as_given(value)
            texts = values.setdefault(name, {}).setdefault(run["variant"], [])
            if text not in texts:
                texts.append(text)
    rows = [
        [name, *(", ".join(by_variant.get(variant, [MISSING])) for variant in variants)]
        for name, by_variant in values.items()
    ]
    caption = f"Settings of all runs in the night of {time_in_words(content.newest)}."
    return table(caption, ["setting", *variants], rows, [False] * (len(variants) + 1))


def _failed_runs(content: SiteContent, failed: pd.DataFrame) -> str:
    """Return the HTML of the table of runs without a complete result, those with equal ends in one row."""
    failed = failed.assign(end=[end_of_run(run) for run in failed.to_dict("records")])
    rows = [
        [str(end), ", ".join(dict.fromkeys(part["scene"])), str(len(part)), part["key"].iloc[0]]
        for end, part in failed.groupby("end", sort=False)
    ]
    heads = ("end of the run", "scenes", "runs", "key of the first")
    caption = f"Runs that failed or ended early in the night of {time_in_words(content.newest)}."
    return table(caption, heads, rows, [False, False, True, False])
