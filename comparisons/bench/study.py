"""Studies: a study answers one question by runs, tables computed from them, and their presentation.

A new study is a module in ``comparisons/studies`` that defines `STUDY`, a template of its text in
``reports/templates/studies``, and a test. Then it takes part in `stiction compare` and `stiction
validate` (terminal, report, page and paper) without further changes.
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
    """The scenes, engines and limits for which a study plans its runs.

    Attributes
    ----------
    scenes : tuple of Scene
        The cases of the paper in their order, or the scenes given to `stiction compare`. Studies of
        one scene use the first.
    depth : Depth
    engines : tuple of str or None
        Engines that take part besides the reference; all known ones if None.
    t_end : float or None
        End of the simulations, s; that of each scene if None.
    repeats : int or None
        Minimum number of timing rounds; that of the depth if None.
    options : Mapping
        Options that only this study has, by name.
    known : Mapping
        Results of the comparisons in `Study.requires`, by name.
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
    """Tables of a study by name, and the data stored with them; see `Results` for the fields."""

    tables: Mapping[str, pd.DataFrame]
    records: tuple[Record, ...] = ()
    timed: tuple[Record, ...] = ()
    truths: Mapping[str, Truth] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True, eq=False)
class Study:
    """The definition of a study.

    Attributes
    ----------
    name : str
        Name of its main table and of its command.
    title : str
        One to three words, the heading of its answer on page one and on the terminal.
    question : str
        Heading of its section.
    present : callable
        Returns the rows that the text mentions, the tables and the figures. The results may be read
        from a run folder and may lack some studies or engines.
    plan : callable or None
        Returns the comparison for a `Scope`, or None if the study is left out at its depth. None
        for a study that only uses the tables of other studies.
    requires : Mapping
        Comparisons, by name, that are executed before `plan` is called; their results are in
        `Scope.known`.
    seconds : float
        Approximate CPU time of one run, s, from which the remaining time is estimated.
    on_page_one : bool
        True if its answer is on page one of the report. Its headlines are columns there in any
        case.
    compared : bool
        True if it is a command of `stiction compare`; False for studies that only apply to the
        cases of the paper.
    takes_scene, needs_scene : bool
        True if this command accepts scenes, and if it requires one.
    takes : frozenset of str
        Fields and options of `Scope` that `plan` uses. The command rejects other options, and
        several scenes unless ``scenes`` is included.
    tables : Mapping[str, str]
        Titles of its tables, by name.
    failures_of_reference : callable or None
        Yields one line for each run of the reference that is wrong according to the tables.
        `stiction validate` fails if there is one.
    text : str
        Template of its section, for a study without a file in ``reports/templates/studies``.
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
        """Return the presentation of the study, without charts that have no points."""
        presentation = self.present(results)
        figures = [
            figure
            for figure in presentation.figures
            if not isinstance(figure, Chart) or _has_points(figure)
        ]
        return replace(presentation, figures=figures)


def _has_points(chart: Chart) -> bool:
    """Return whether any series of a chart has a point."""
    return any(len(series.x) for panel in chart.panels for series in panel.series)


def planned(
    scope: Scope, chosen: Sequence[Study], **options: Any
) -> dict[Study, Comparison[Tables]]:
    """Plan the comparison of each study for a scope, after executing the comparisons that studies require.

    Parameters
    ----------
    scope : Scope
    chosen : sequence of Study
    **options
        Options of `make`, for the comparisons of `Study.requires`.

    Returns
    -------
    dict
        Comparisons by study, those with the longest runs first: if these began last, most
        processors would be idle at the end. Studies that are left out at the depth of the scope are
        not included.
    """
    # Comparisons that several studies require have the same name, and are executed once.
    required = {name: plan for study in chosen for name, plan in study.requires.items()}
    known = {}
    if required:
        results = make([plan(scope) for plan in required.values()], **options)
        known = dict(zip(required, results, strict=True))
    scope = replace(scope, known=known)

    plans = {}
    for study in sorted(chosen, key=lambda study: -study.seconds):
        comparison = None if study.plan is None else study.plan(scope)
        if comparison is not None:
            plans[study] = comparison
    return plans


def union(
    parts: Sequence[Tables],
    settings: Mapping[str, object] = MappingProxyType({}),
    wall_s: float = 0.0,
    cpu_s: float = 0.0,
) -> Results:
    """Return the results of several studies as one; `settings` and times are described at `Results`.

    Tables with the same name are concatenated. Of runs with the same key the first one is included.
    """
    tables: dict[str, list[pd.DataFrame]] = defaultdict(list)
    records: dict[str, Record] = {}
    truths: dict[str, Truth] = {}
    timed: list[Record] = []
    problems: list[Problem] = []
    for part in parts:
        for name, table in part.tables.items():
            tables[name].append(table)
        for record in part.records:
            records.setdefault(record.key, record)
        truths |= part.truths
        timed += part.timed
        problems += part.problems
    return Results(
        records=tuple(records.values()),
        truths=truths,
        tables={name: pd.concat(same, ignore_index=True) for name, same in tables.items()},
        settings=settings,
        wall_s=wall_s,
        cpu_s=cpu_s,
        timed=tuple(timed),
        problems=tuple(problems),
    )
