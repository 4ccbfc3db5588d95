"""Runs that stand for a method in tables and figures, its name there, and the methods that may be compared with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property

import pandas as pd

from stiction.comparisons.bench.participants import REFERENCE
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import (
    COEFFICIENTS,
    COMMON_STEP,
    EVENTS_BY,
    FRICTION_BY,
    Record,
)
from stiction.engines.protocol import Supplier
from stiction.engines.status import UNMADE, Status
from stiction.scenes import catalogue, load_scene
from stiction.scenes.fidelity import Fidelity


def one_per_variant(records: Iterable[Record]) -> list[Record]:
    """The run of each variant nearest to `COMMON_STEP` or at the tightest tolerance, of those with a trajectory."""
    made: dict[str, list[Record]] = {}
    for record in records:
        if record.trajectory is not None:
            made.setdefault(record.variant.label, []).append(record)
    return [
        min(runs, key=lambda run: rank(run.variant.parameter, run.step)) for runs in made.values()
    ]


def representatives(records: Iterable[Record]) -> list[Record]:
    """The first variant of each engine, fidelity and method: others change a setting of it."""
    chosen: dict[tuple[str, str, object], Record] = {}
    for record in records:
        method = None if record.trajectory is None else record.trajectory.settings.get("method")
        chosen.setdefault((record.variant.engine, record.variant.fidelity, method), record)
    return list(chosen.values())


def drawn_runs(results: Results) -> list[Record]:
    """The run that stands for each engine, fidelity and method on each scene."""
    scenes = dict.fromkeys(record.scene for record in results.records)
    return [
        run
        for scene in scenes
        for run in representatives(
            one_per_variant(run for run in results.records if run.scene == scene)
        )
    ]


def rank(parameter: str, step: float) -> float:
    """Distance from `COMMON_STEP`, or the tolerance: the smallest is chosen."""
    return abs(math.log(step / COMMON_STEP)) if parameter == "dt" else step


def stored_keys(results: Results) -> frozenset[str]:
    """Keys of the runs whose trajectories a run folder keeps: the `drawn_runs` at a depth that says so, else all."""
    drawn = results.settings.get("trajectories") == "drawn"
    return frozenset(record.key for record in (drawn_runs(results) if drawn else results.records))


def run_label(record: Record) -> str:
    """``pymunk (dt = 0.001 s)``."""
    return f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})"


@cache
def scene_title(scene: str) -> str:
    """Return the title of a scene of the catalogue, the name of another: ``Slider-bar, case 1``."""
    return load_scene(scene).title if scene in catalogue() else scene


@dataclass(frozen=True)
class Group:
    """Methods that may be compared: of one fidelity and one physics.

    They may be ranked only if the engine does the same part of the work in each.

    `friction_by` and `events_by` are empty where the group is not for a ranking.
    """

    fidelity: Fidelity
    coefficients: str
    friction_by: str = ""
    events_by: str = ""

    @property
    def label(self) -> str:
        """Heading of the group: ``joint, mus > mu``."""
        return f"{self.fidelity.label}, {self.coefficients}"


def groups(table: pd.DataFrame) -> Iterator[tuple[Group, pd.DataFrame]]:
    """The rows that answer one question: one fidelity, and mus > mu or, for engines without it, mus = mu."""
    for (fidelity, coefficients), rows in table.groupby(["fidelity", COEFFICIENTS], sort=False):
        yield Group(Fidelity(fidelity), coefficients), rows


def same_work(table: pd.DataFrame) -> Iterator[tuple[Group, pd.DataFrame]]:
    """The rows of `groups` that may be ranked with each other: engines do the same part of the work.

    Who supplies the friction law and who locates events is that of the variant's other runs where one failed.
    """
    for group, rows in groups(table):
        parts = [rows["variant"].map(known_of(rows, column)) for column in (FRICTION_BY, EVENTS_BY)]
        for (friction, events), there in rows.groupby(parts, sort=False):
            yield replace(group, friction_by=friction, events_by=events), there


def known_of(rows: pd.DataFrame, column: str) -> dict[str, str]:
    """Value of a column by variant, in the first of its runs that has one, else ``not known``.

    In a scene without friction nobody supplies its law, whoever does in others: such a run counts where no other is.
    """
    values: Mapping[str, str] = {}
    if column in rows:
        # runs without a supplier last, so that the first of a variant is one with a supplier, if
        # there is any
        stated = rows[rows[column].notna()]
        ordered = stated.sort_values(
            column, key=lambda suppliers: suppliers == Supplier.NOBODY, kind="stable"
        )
        values = ordered.groupby("variant")[column].first().to_dict()
    return {variant: values.get(variant, "not known") for variant in rows["variant"]}


def methods(results: Results) -> list[str]:
    """Labels of the variants that stand for a method: the first of each engine, fidelity and way of solving.

    Of an engine without any trajectory, as in a stored run, it is the first of each fidelity; of one that is not
    installed there is none.
    """
    made = representatives(record for record in results.records if record.trajectory is not None)
    known = {(record.variant.engine, record.variant.fidelity) for record in made}
    failed = representatives(
        record
        for record in results.records
        if record.outcome.status != Status.MISSING
        and (record.variant.engine, record.variant.fidelity) not in known
    )
    chosen = {record.variant.label for record in (*made, *failed)}
    return [
        label
        for label in dict.fromkeys(record.variant.label for record in results.records)
        if label in chosen
    ]


Grouping = Callable[[pd.DataFrame], Iterator[tuple[Group, pd.DataFrame]]]


def grouped_methods(
    results: Results, grouping: Grouping = groups
) -> Iterator[tuple[Group, list[str]]]:
    """`methods` by `groups` or, for rankings, by `same_work`."""
    accuracy, chosen = results.tables.get("accuracy", pd.DataFrame()), methods(results)
    for group, rows in grouping(accuracy) if len(accuracy) else ():
        in_group = set(rows["variant"])
        methods_of_group = [variant for variant in chosen if variant in in_group]
        if methods_of_group:
            yield group, methods_of_group


def succeeded(table: pd.DataFrame) -> pd.Series:
    """Rows of runs that reached their end: one that stopped early is cheap, and may not have met what is hard."""
    return (table["status"] == Status.OK) & (table["reason"].fillna("") == "")


def with_columns(table: pd.DataFrame, *names: str) -> pd.DataFrame:
    """Return a table that has these columns, without values where it had none of that name."""
    return table.reindex(columns=list(dict.fromkeys([*table, *names])))


def at_equal_step(table: pd.DataFrame, variant: str) -> pd.DataFrame:
    """The rows of a variant at the step nearest to `COMMON_STEP`, or at its tightest tolerance."""
    rows = table[table["variant"] == variant] if "variant" in table else pd.DataFrame()
    if rows.empty:
        return rows
    ranks = pd.Series(
        [rank(*pair) for pair in zip(rows["parameter"], rows["step"])], index=rows.index
    )
    return rows[ranks == ranks.min()]


@dataclass(frozen=True)
class Method:
    """The runs of a variant at equal step that were made: rows of a table, ranked by the error in a column."""

    variant: str
    rows: pd.DataFrame
    column: str

    @property
    def engine(self) -> str:
        return str(self.rows["engine"].iloc[0])

    @property
    def fidelity(self) -> str:
        return str(self.rows["fidelity"].iloc[0])

    @property
    def is_own(self) -> bool:
        """True for the reference and the paper's scheme."""
        return self.engine == REFERENCE

    @cached_property
    def failed(self) -> pd.DataFrame:
        """Rows of runs that failed, ended early, or are no approximation of the motion."""
        return self.rows[~(succeeded(self.rows) & self.rows[self.column].notna())]

    @cached_property
    def worst(self) -> int | None:
        """Label of the row with the largest error; None if all runs failed."""
        return None if len(self.failed) == len(self.rows) else self.worst_row

    @property
    def worst_row(self) -> int:
        """The same of a method with a run that succeeded; raises ValueError for others."""
        return int(self.rows.drop(index=self.failed.index)[self.column].abs().idxmax())

    @property
    def is_ranked(self) -> bool:
        """True if every run succeeded, so that its worst case is that of all cases."""
        return self.failed.empty


def made_methods(table: pd.DataFrame, variants: Iterable[str], column: str) -> dict[str, Method]:
    """The methods of which a run was made, by label of their variants, in the order of these."""
    made = {}
    for variant in variants:
        rows = at_equal_step(with_columns(table, column), variant)
        if len(rows):
            rows = rows[~rows["status"].isin(UNMADE)]
        if len(rows):
            made[variant] = Method(variant, rows, column)
    return made
