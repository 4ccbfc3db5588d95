"""Methods in tables and figures: the runs that represent a method, and the groups in which methods are compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

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
from stiction.scenes.fidelity import Fidelity


def one_per_variant(records: Iterable[Record]) -> list[Record]:
    """Return the run of each variant that is nearest to `COMMON_STEP`, or has the tightest tolerance.

    Variants without a run that has a trajectory are left out.
    """
    runs_of: dict[str, list[Record]] = {}
    for record in records:
        if record.trajectory is not None:
            runs_of.setdefault(record.variant.label, []).append(record)
    return [
        min(runs, key=lambda run: rank(run.variant.parameter, run.step))
        for runs in runs_of.values()
    ]


def representatives(records: Iterable[Record]) -> list[Record]:
    """Return the first record of each engine, fidelity and method.

    The variants that follow it in the list differ from it only by a setting.
    """
    first: dict[tuple[str, str, object], Record] = {}
    for record in records:
        method = None if record.trajectory is None else record.trajectory.settings.get("method")
        first.setdefault((record.variant.engine, record.variant.fidelity, method), record)
    return list(first.values())


def drawn_runs(results: Results) -> list[Record]:
    """Return the runs shown in figures: on each scene, one for each engine, fidelity and method."""
    by_scene: dict[str, list[Record]] = {}
    for record in results.records:
        by_scene.setdefault(record.scene, []).append(record)
    drawn: list[Record] = []
    for records in by_scene.values():
        drawn += representatives(one_per_variant(records))
    return drawn


def rank(parameter: str, step: float) -> float:
    """Return a number that is smallest for the run to be compared with others.

    It is the logarithmic distance of a step from `COMMON_STEP`, or else the tolerance itself.
    """
    if parameter == "dt":
        return abs(math.log(step / COMMON_STEP))
    return step


def stored_keys(results: Results) -> frozenset[str]:
    """Return the keys of the runs whose trajectories are stored: `drawn_runs` or all, as the settings say."""
    only_drawn = results.settings.get("trajectories") == "drawn"
    stored = drawn_runs(results) if only_drawn else results.records
    return frozenset(record.key for record in stored)


def run_label(record: Record) -> str:
    """Return the label of a run with its step or tolerance: ``pymunk (dt = 0.001 s)``."""
    return f"{record.variant.label} ({setting_of(record.variant.parameter, record.step)})"


@dataclass(frozen=True)
class Group:
    """Methods that may be compared, because they have the same fidelity and coefficients of friction.

    They may be ranked only if the engine also does the same part of the work.

    Attributes
    ----------
    fidelity : Fidelity
    coefficients : str
        Value of `variants.Coefficients`.
    friction_by, events_by : str
        Who supplies the friction law and locates the events; empty in groups that are not for a
        ranking.
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
    """Yield the groups of methods that may be compared, and the rows of each."""
    for (fidelity, coefficients), rows in table.groupby(["fidelity", COEFFICIENTS], sort=False):
        yield Group(Fidelity(fidelity), coefficients), rows


def same_work(table: pd.DataFrame) -> Iterator[tuple[Group, pd.DataFrame]]:
    """Yield the groups of methods that may be ranked, and the rows of each.

    These are parts of the `groups` in which the same side, engine or adapter, supplies the friction
    law and locates events. For a failed run, and for one without friction, this is taken from other
    runs of its variant. Who supplies the law may depend on the scene: a constant bound of friction
    in a joint is an element of many engines, a bound that depends on the normal force is not.
    """
    for group, rows in groups(table):
        friction_by, events_by = (
            rows["variant"].map(known_of(rows, column)) for column in (FRICTION_BY, EVENTS_BY)
        )
        if FRICTION_BY in rows:
            own = rows[FRICTION_BY]
            friction_by = friction_by.where(own.isna() | (own == Supplier.NOBODY), own)
        suppliers = [friction_by, events_by]
        for (friction, events), part in rows.groupby(suppliers, sort=False):
            yield replace(group, friction_by=friction, events_by=events), part


def known_of(rows: pd.DataFrame, column: str) -> dict[str, str]:
    """Return the supplier in a column by variant, ``not known`` if none of its runs reports one.

    If a scene has no friction, the supplier of the friction law is `Supplier.NOBODY`. This value is
    only returned if no run of the variant has another.
    """
    supplier_of: Mapping[str, str] = {}
    if column in rows:
        # The first value of each variant is taken, after `NOBODY` has been sorted to the end.
        reported = rows[rows[column].notna()]
        ordered = reported.sort_values(
            column, key=lambda suppliers: suppliers == Supplier.NOBODY, kind="stable"
        )
        supplier_of = ordered.groupby("variant")[column].first().to_dict()
    return {variant: supplier_of.get(variant, "not known") for variant in rows["variant"]}


def methods(results: Results) -> list[str]:
    """Return the labels of the variants that represent a method, in the order of the records.

    They are the first of each engine, fidelity and method. Results that were read from a run folder
    may have no trajectories, which contain the method: the first of each engine and fidelity is
    taken then. Engines that are not installed are left out.
    """
    with_trajectory = representatives(
        record for record in results.records if record.trajectory is not None
    )
    represented = {(record.variant.engine, record.variant.fidelity) for record in with_trajectory}
    without_trajectory = representatives(
        record
        for record in results.records
        if record.outcome.status != Status.MISSING
        and (record.variant.engine, record.variant.fidelity) not in represented
    )
    chosen = {record.variant.label for record in (*with_trajectory, *without_trajectory)}
    labels = dict.fromkeys(record.variant.label for record in results.records)
    return [label for label in labels if label in chosen]


Grouping = Callable[[pd.DataFrame], Iterator[tuple[Group, pd.DataFrame]]]
"""`groups` or `same_work`."""


def grouped_methods(
    results: Results, grouping: Grouping = groups
) -> Iterator[tuple[Group, list[str]]]:
    """Yield the groups of the table ``accuracy``, and the labels of the `methods` in each."""
    accuracy = results.tables.get("accuracy", pd.DataFrame())
    if accuracy.empty:
        return
    labels = methods(results)
    for group, rows in grouping(accuracy):
        variants_in_group = set(rows["variant"])
        labels_in_group = [label for label in labels if label in variants_in_group]
        if labels_in_group:
            yield group, labels_in_group


def succeeded(table: pd.DataFrame) -> pd.Series:
    """Return, for each row, whether its run succeeded and reached its end.

    A run that stopped early must not be ranked: it costs less, and may not have reached the
    difficult part of the motion.
    """
    return (table["status"] == Status.OK) & (table["reason"].fillna("") == "")


def with_columns(table: pd.DataFrame, *names: str) -> pd.DataFrame:
    """Return a table with additional columns, empty if it does not have them already."""
    return table.reindex(columns=list(dict.fromkeys([*table, *names])))


def of_first_scene(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows about the first scene of a table; all rows if the table does not name scenes."""
    if "scene" not in table or table.empty:
        return table
    return table[table["scene"] == table["scene"].iloc[0]]


def at_equal_step(table: pd.DataFrame, variant: str) -> pd.DataFrame:
    """Return the rows of a variant at the step nearest to `COMMON_STEP`, or at its tightest tolerance."""
    if "variant" not in table:
        return pd.DataFrame()
    rows = table[table["variant"] == variant]
    if rows.empty:
        return rows
    ranks = pd.Series(
        [rank(parameter, step) for parameter, step in zip(rows["parameter"], rows["step"])],
        index=rows.index,
    )
    return rows[ranks == ranks.min()]


@dataclass(frozen=True)
class Method:
    """The runs of a variant at equal step, which are ranked by their largest error.

    Attributes
    ----------
    variant : str
        Label of the variant.
    rows : DataFrame
        Rows of a table, one for each scene, without runs that were not executed.
    column : str
        Column of the error.
    """

    variant: str
    rows: pd.DataFrame
    column: str

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return str(self.rows["engine"].iloc[0])

    @property
    def fidelity(self) -> str:
        """Value of `Fidelity`."""
        return str(self.rows["fidelity"].iloc[0])

    @property
    def is_own(self) -> bool:
        """True if the engine is the reference, which includes the paper's scheme."""
        return self.engine == REFERENCE

    @cached_property
    def failed(self) -> pd.DataFrame:
        """Rows without an error: the run failed, ended early, or does not approximate the motion."""
        return self.rows[~(succeeded(self.rows) & self.rows[self.column].notna())]

    @cached_property
    def worst(self) -> int | None:
        """Label of the row with the largest error; None if all runs failed."""
        return None if len(self.failed) == len(self.rows) else self.worst_row

    @property
    def worst_row(self) -> int:
        """Label of the row with the largest error; raises ValueError if all runs failed."""
        return int(self.rows.drop(index=self.failed.index)[self.column].abs().idxmax())

    @property
    def is_ranked(self) -> bool:
        """True if all runs succeeded; otherwise the largest error is not that of all scenes."""
        return self.failed.empty


def made_methods(table: pd.DataFrame, variants: Iterable[str], column: str) -> dict[str, Method]:
    """Return the methods of variants by label, ranked by an error; without those that were not executed."""
    method_of = {}
    for variant in variants:
        rows = at_equal_step(with_columns(table, column), variant)
        if rows.empty:
            continue
        executed = rows[~rows["status"].isin(UNMADE)]
        if len(executed):
            method_of[variant] = Method(variant, executed, column)
    return method_of
