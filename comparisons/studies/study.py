"""A study is one question of the report: the runs it needs, the tables they make, and what the tables say.

A new question is a new file in this folder whose module has a `STUDY`, and its test. It then appears in
`stiction compare` and in `stiction validate` (terminal, report, page, paper), without another line.
"""

from __future__ import annotations

import pkgutil
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any

import pandas as pd

from stiction.comparisons.campaigns.comparison import Comparison, make
from stiction.comparisons.complementarity.problems import Problem
from stiction.comparisons.depth import Depth
from stiction.comparisons.presentation import Chart, Presentation
from stiction.comparisons.results import Results
from stiction.comparisons.truth import Truth
from stiction.comparisons.variants import Record
from stiction.scenes import Scene


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
        Rounds in which what is timed is timed at least; those of the depth where None.
    options : Mapping
        Options of the study's own, by name.
    known : Mapping
        What `Study.requires` have yielded, by their names.
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
        Of its main table, of its command, and of its file.
    title : str
        A word or three: above its answer on page one and on the terminal.
    question : str
        Heading of its section.
    place : float
        In the order of the report: sections ascend.
    plan : callable or None
        The runs within a `Scope` and what tabulates them; None at a depth that leaves the study out, and for a study
        of others' tables.
    present : callable
        What the tables say, from all results: those of a stored run as well, and of a run without some studies or
        engines.
    requires : Mapping
        By name, comparisons that must be made before `plan`: their yields are `Scope.known`.
    seconds : float
        CPU seconds that a run takes, roughly: for the estimate of the time that is left, and nothing else.
    on_page_one : bool
        Whether its answer is one of the few of page one; its headlines are columns there in any case.
    compared : bool
        Whether `stiction compare NAME` has it: not where it is about the paper's own cases.
    takes_scene : bool
        Whether that command takes a scene.
    needs_scene : bool
        Whether it must be given one: not where the study has scenes of its own.
    takes : frozenset of str
        Fields and options of a `Scope` that `plan` makes use of; any other option of the command is refused, and so
        are several scenes without ``scenes``.
    """

    name: str
    title: str
    question: str
    place: float
    present: Callable[[Results], Presentation]
    plan: Callable[[Scope], Comparison[Tables] | None] | None = None
    requires: Mapping[str, Callable[[Scope], Comparison[Any]]] = field(default_factory=dict)
    seconds: float = 1.0
    on_page_one: bool = True
    compared: bool = True
    takes_scene: bool = True
    needs_scene: bool = True
    takes: frozenset[str] = frozenset({"engines", "t_end"})

    def presented(self, results: Results) -> Presentation:
        """Return what the tables say, without empty findings and without charts that have no point."""
        said = self.present(results)
        figures = [figure for figure in said.figures if not isinstance(figure, Chart)
                   or any(len(series.x) for panel in figure.panels for series in panel.series)]
        return replace(said, findings=list(filter(None, said.findings)), figures=figures)


@cache
def studies() -> tuple[Study, ...]:
    """All studies of this folder, in the order of the report."""
    package = import_module("stiction.comparisons.studies")
    modules = [import_module(f"{package.__name__}.{module.name}") for module in pkgutil.iter_modules(package.__path__)]
    found = [module.STUDY for module in modules if hasattr(module, "STUDY")]
    return tuple(sorted(found, key=lambda study: study.place))


def planned(scope: Scope, chosen: Sequence[Study], **options: Any) -> dict[Study, Comparison[Tables]]:
    """Return the runs of each study within a scope, the longest first, so that no core waits for them in the end.

    Requirements of studies are made on the way; options of `make`.
    """
    required = {name: plan for study in chosen for name, plan in study.requires.items()}
    made = make([plan(scope) for plan in required.values()], **options) if required else []
    known = dict(zip(required, made, strict=True))
    scope = replace(scope, known=known)
    plans = {study: study.plan(scope) for study in chosen if study.plan is not None}
    return {study: plan for study, plan in sorted(plans.items(), key=lambda item: -item[0].seconds)
            if plan is not None}


def union(made: Sequence[Tables], settings: Mapping[str, object] = MappingProxyType({}), wall_s: float = 0.0,
          cpu_s: float = 0.0) -> Results:
    """Return the results of several studies as one.

    Tables of one name follow each other. Runs of one key are kept once, the first of them.
    """
    parts: dict[str, list[pd.DataFrame]] = defaultdict(list)
    records: dict[str, Record] = {}
    truths: dict[str, Truth] = {}
    for one in made:
        for name, table in one.tables.items():
            parts[name].append(table)
        for record in one.records:
            records.setdefault(record.key, record)
        truths |= one.truths
    tables = {name: pd.concat(tables, ignore_index=True) for name, tables in parts.items()}
    return Results(tuple(records.values()), truths, tables, settings, wall_s, cpu_s,
                   tuple(record for one in made for record in one.timed),
                   tuple(problem for one in made for problem in one.problems))
