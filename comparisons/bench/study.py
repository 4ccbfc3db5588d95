"""A study is one question of the report: the runs it needs, the tables they make, and what the tables say.

A new question is a new file in ``comparisons/studies`` whose module has a `STUDY`, a template of its text in
``reports/templates/studies``, and a test. It then appears in `stiction compare` and in `stiction validate` (terminal,
report, page, paper), without another line.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import pandas as pd

from stiction.comparisons.bench.complementarity.problems import Problem
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.presentation import Chart, Presentation
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, make
from stiction.comparisons.bench.variants import Record
from stiction.scenes import Scene
from stiction.truths import Truth


@dataclass(frozen=True)
class Scope:
    """The scenes and limits of a study.

    Attributes
    ----------
    scenes : tuple of Scene
        The paper's cases in their order, or those of `stiction compare`; studies of one scene take the first.
    engines : tuple of str or None
        External engines that take part; all known ones where None. The reference always does.
    t_end : float or None
        Seconds; each scene's own where None.
    repeats : int or None
        Least number of rounds of timing; that of the depth where None.
    options, known : Mapping
        Options of the study's own, and the yields of `Study.requires`, by name.
    """

    scenes: tuple[Scene, ...]
    depth: Depth = Depth.DEFAULT
    engines: tuple[str, ...] | None = None
    t_end: float | None = None
    repeats: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    known: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Tables:
    """Tables of a study by name, and the runs, truths and problems that are kept with them."""

    tables: Mapping[str, pd.DataFrame]
    records: tuple[Record, ...] = ()
    timed: tuple[Record, ...] = ()
    truths: Mapping[str, Truth] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True, eq=False)
class Study:
    """One question.

    Attributes
    ----------
    name : str
        The name of its main table and of its command.
    title : str
        A word or three that stand above its answer on page one and on the terminal.
    question : str
        The heading of its section.
    present : callable
        Returns the rows that the text mentions, tables and figures; the results may be those of a stored run, and
        may lack some studies or engines.
    plan : callable or None
        Returns the runs within a `Scope`, or None at a depth that leaves the study out; None for a study of others'
        tables.
    requires : Mapping
        Comparisons by name that are made before `plan`, which has their yields in `Scope.known`.
    seconds : float
        CPU seconds that a run takes, roughly, for the estimate of the time that is left.
    on_page_one : bool
        True if page one has its answer; its headlines are columns there in any case.
    compared : bool
        True if it is a command of `stiction compare`, which one about the paper's own cases is not.
    takes_scene, needs_scene : bool
        True if that command takes a scene, and if it must be given one.
    tables : Mapping[str, str]
        Titles of its tables of the data, by name.
    failures_of_reference : callable or None
        Yields a line for each run of the reference that its tables show to be wrong; such a run fails
        `stiction validate`.
    text : str
        The template of its section, for a study that has none in ``reports/templates/studies``.
    takes : frozenset of str
        Fields and options of a `Scope` that `plan` uses; the command refuses others, and several scenes without
        ``scenes``.
    """

    name: str
    title: str
    question: str
    present: Callable[[Results], Presentation]
    plan: Callable[[Scope], Comparison[Tables] | None] | None = None
    requires: Mapping[str, Callable[[Scope], Comparison[Any]]] = field(default_factory=dict)
    seconds: float = 1.0
    on_page_one: bool = True
    compared: bool = True
    takes_scene: bool = True
    needs_scene: bool = True
    takes: frozenset[str] = frozenset({"engines", "t_end"})
    tables: Mapping[str, str] = field(default_factory=dict)
    failures_of_reference: Callable[[Results], Iterator[str]] | None = None
    text: str = ""

    def presented(self, results: Results) -> Presentation:
        """Return what the study presents, without charts that have no point."""
        said = self.present(results)
        figures = [
            figure
            for figure in said.figures
            if not isinstance(figure, Chart)
            or any(len(series.x) for panel in figure.panels for series in panel.series)
        ]
        return replace(said, figures=figures)


def planned(
    scope: Scope, chosen: Sequence[Study], **options: Any
) -> dict[Study, Comparison[Tables]]:
    """Return the runs of each study within a scope, the longest first, so that no core waits for them in the end.

    Requirements of studies are made on the way; options of `make`.
    """
    # What several studies require is made once, before the first of them plans its runs.
    required = {name: plan for study in chosen for name, plan in study.requires.items()}
    made = make([plan(scope) for plan in required.values()], **options) if required else []
    known = dict(zip(required, made, strict=True))
    scope = replace(scope, known=known)
    plans = {study: study.plan(scope) for study in chosen if study.plan is not None}
    return {
        study: plan
        for study, plan in sorted(plans.items(), key=lambda item: -item[0].seconds)
        if plan is not None
    }


def union(
    made: Sequence[Tables],
    settings: Mapping[str, object] = MappingProxyType({}),
    wall_s: float = 0.0,
    cpu_s: float = 0.0,
) -> Results:
    """Return the results of several studies as one.

    Tables of one name follow each other. Runs of one key are kept once, the first of them.
    """
    parts: dict[str, list[pd.DataFrame]] = defaultdict(list)
    records: dict[str, Record] = {}
    truths: dict[str, Truth] = {}
    for results in made:
        for name, table in results.tables.items():
            parts[name].append(table)
        for record in results.records:
            records.setdefault(record.key, record)
        truths |= results.truths
    tables = {name: pd.concat(tables, ignore_index=True) for name, tables in parts.items()}
    return Results(
        tuple(records.values()),
        truths,
        tables,
        settings,
        wall_s,
        cpu_s,
        tuple(record for results in made for record in results.timed),
        tuple(problem for results in made for problem in results.problems),
    )
