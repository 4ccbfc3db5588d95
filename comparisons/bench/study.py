"""Studies: a study answers one question by runs, tables computed from them, and their presentation.

A new study is a module in ``comparisons/studies`` that defines `STUDY`, a template of its text in
``reports/templates/studies``, and a test. Then it takes part in `stiction compare` and `stiction
validate` (terminal, report, page and paper) without further changes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import pandas as pd

from stiction.comparisons.bench.complementarity.problems import Problem
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.participants import validation_campaign
from stiction.comparisons.bench.presentation import Chart, Presentation
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import Comparison, make
from stiction.comparisons.bench.variants import Record
from stiction.scenes import InputError, Scene
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
    is_campaign : bool
        True for `stiction validate`, whose depth decides which studies take part; False for a
        command of `stiction compare`, which makes its study at every depth.
    """

    scenes: tuple[Scene, ...]
    depth: Depth = Depth.DEFAULT
    engines: tuple[str, ...] | None = None
    t_end: float | None = None
    repeats: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    known: Mapping[str, Any] = field(default_factory=dict)
    is_campaign: bool = False

    @property
    def is_of_paper(self) -> bool:
        """True if the scenes are the paper's three cases, those of the campaign of `stiction validate`."""
        return self.scenes == tuple(validation_campaign().scenes)

    @property
    def leading_scenes(self) -> tuple[Scene, ...]:
        """The scenes of a study that examines one case of the paper: its first case, or all of other scenes."""
        is_validation_of_paper = self.is_campaign and self.is_of_paper
        return self.scenes[:1] if is_validation_of_paper else self.scenes


def always(scope: Scope) -> str:
    """Return no reason against a study, which applies to every scene."""
    return ""


def only_cases_of_paper(scope: Scope) -> str:
    """Return a reason against a study that is about the paper's three cases, if the scenes are others."""
    return "" if scope.is_of_paper else "it is about the example of the paper, its three cases"


def unless_refused(check: Callable[[Scope], object]) -> Callable[[Scope], str]:
    """Return a function for `Study.applies`, whose reason is the InputError that `check` raises."""

    def reason(scope: Scope) -> str:
        try:
            check(scope)
        except InputError as error:
            # Further lines list everything that the scene lacks.
            return str(error).splitlines()[0].rstrip(":")
        return ""

    return reason


@dataclass(frozen=True)
class Tables:
    """Tables of a study by name, and the data stored with them; see `Results` for the fields."""

    tables: Mapping[str, pd.DataFrame]
    records: tuple[Record, ...] = ()
    timed: tuple[Record, ...] = ()
    truths: Mapping[str, Truth] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True)
class NightlyNumbers:
    """Numbers of nightly runs that belong to the question of a study.

    Attributes
    ----------
    metrics : tuple of str
        Keys of the metrics in the history.
    scenes : tuple of str
        Names of the scenes on which they belong to the question; all scenes if empty.
    """

    metrics: tuple[str, ...]
    scenes: tuple[str, ...] = ()


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
    in_campaign : bool
        True if it takes part in `stiction validate`; False if it is only a command.
    takes_scene, needs_scene : bool
        True if this command accepts scenes, and if it requires one.
    takes : frozenset of str
        Fields and options of `Scope` that `plan` uses. The command rejects other options, and
        several scenes unless ``scenes`` is included.
    applies : callable
        Returns why the study does not apply to the scenes of a `Scope`, in one line; empty if it
        applies. `stiction validate` asks it before `requires` and `plan`.
    nothing : str
        What it means if its section is empty although its runs were made.
    tables : Mapping[str, str]
        Titles of its tables, by name.
    stored : tuple of str
        Names of the tables that `stiction compare --out` writes into one file, with a column
        ``table``; only its main table if empty.
    failures_of_reference : callable or None
        Yields one line for each run of the reference that is wrong according to the tables.
        `stiction validate` fails if there is one.
    text : str
        Template of its section, for a study without a file in ``reports/templates/studies``.
    nightly : NightlyNumbers or None
        Numbers of nightly runs that belong to its question; None if nights do not measure it.
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
    in_campaign: bool = True
    takes_scene: bool = True
    needs_scene: bool = True
    takes: frozenset[str] = frozenset({"engines", "t_end"})
    applies: Callable[[Scope], str] = always
    nothing: str = "its tables are empty"
    tables: Mapping[str, str] = field(default_factory=dict)
    stored: tuple[str, ...] = ()
    failures_of_reference: Callable[[Results], Iterator[str]] | None = None
    text: str = ""
    nightly: NightlyNumbers | None = None

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


@dataclass(frozen=True)
class Selection:
    """The studies that apply to the scenes of a campaign.

    Attributes
    ----------
    scopes : Mapping[Study, Scope]
        Of each study that applies, the scope with the scenes to which it applies.
    reasons : Mapping[str, str]
        By title of a study, why it does not apply to all scenes, in one line.
    """

    scopes: Mapping[Study, Scope]
    reasons: Mapping[str, str]


def selection(scope: Scope, chosen: Sequence[Study]) -> Selection:
    """Select the studies that apply to the scenes of a scope, or to some of them.

    The studies of the paper's three cases are made for them together. Of other scenes, a study that
    does not take several examines the first one to which it applies.
    """
    scopes: dict[Study, Scope] = {}
    reasons: dict[str, str] = {}
    for study in chosen:
        if study.plan is None or not study.in_campaign:
            continue
        if scope.is_of_paper and not study.applies(scope):
            scopes[study] = scope
            continue
        reason_of = {
            scene.name: study.applies(replace(scope, scenes=(scene,))) for scene in scope.scenes
        }
        suitable = [scene for scene in scope.scenes if not reason_of[scene.name]]
        if "scenes" not in study.takes:
            for scene in suitable[1:]:
                reason_of[scene.name] = f"this study examines one scene, {suitable[0].name}"
            suitable = suitable[:1]
        if suitable:
            scopes[study] = replace(scope, scenes=tuple(suitable))
        line = _reasons_line(reason_of)
        if line:
            reasons[study.title] = line
    return Selection(scopes, reasons)


def _reasons_line(reason_of: Mapping[str, str]) -> str:
    """Return the reasons by scene in one line; a reason that all scenes share is given once."""
    # Messages about a scene often begin with its name.
    reasons = {
        name: reason.removeprefix(f"{name}: ") for name, reason in reason_of.items() if reason
    }
    if len(reasons) == len(reason_of) and len(set(reasons.values())) == 1:
        return next(iter(reasons.values()))
    return "; ".join(f"{name}: {reason}" for name, reason in reasons.items())


def joined(parts: Sequence[Tables]) -> Tables:
    """Return the tables of a study on several scenes as one; the tables of all parts have the same names."""
    names = dict.fromkeys(name for part in parts for name in part.tables)
    return Tables(
        {
            name: pd.concat([part.tables[name] for part in parts], ignore_index=True)
            for name in names
        },
        tuple(record for part in parts for record in part.records),
        tuple(record for part in parts for record in part.timed),
        {name: truth for part in parts for name, truth in part.truths.items()},
        tuple(problem for part in parts for problem in part.problems),
    )


def planned(scopes: Mapping[Study, Scope], **options: Any) -> dict[Study, Comparison[Tables]]:
    """Plan the comparison of each study for its scope, after executing the comparisons that studies require.

    Parameters
    ----------
    scopes : Mapping[Study, Scope]
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
    required: dict[str, Comparison[Any]] = {}
    for study, scope in scopes.items():
        for name, plan in study.requires.items():
            required.setdefault(name, plan(scope))
    known = {}
    if required:
        results = make(list(required.values()), **options)
        known = dict(zip(required, results, strict=True))

    plans = {}
    for study in sorted(scopes, key=lambda study: -study.seconds):
        scope = replace(scopes[study], known=known)
        comparison = None if study.plan is None else study.plan(scope)
        if comparison is not None:
            plans[study] = comparison
    return plans


def union(
    parts: Sequence[Tables],
    settings: Mapping[str, object] = MappingProxyType({}),
    wall_s: float = 0.0,
    cpu_s: float = 0.0,
    scenes: Iterable[Scene] = (),
) -> Results:
    """Return the results of several studies as one; `settings`, times and scenes are described at `Results`.

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
        scenes={scene.name: scene for scene in scenes},
    )
