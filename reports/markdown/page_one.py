"""Page one of a report: the mechanism, one table of all methods at equal step, what was found, and what limits each engine."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

import pandas as pd

from stiction.comparisons.campaigns.participants import REFERENCE
from stiction.comparisons.results import Results
from stiction.comparisons.variants import EVENTS_BY, FRICTION_BY, OWN_CPU
from stiction.reports.figures import Drawing
from stiction.comparisons.methods import known_of
from stiction.reports.markdown.cost_page import MILLI, time_of
from stiction.comparisons.methods import at_equal_step, grouped_methods, largest, tables_of
from stiction.reports.markdown.findings import ACCEPTED, DRIFT, JUMP, Finding, equal_errors, findings, limits
from stiction.reports.markdown.ladder_ends import POSITION
from stiction.comparisons.presentation.cells import MISSING
from stiction.reports.markdown.tables import fitted
from stiction.comparisons.presentation.traced_text import Number, Part, TracedText, count, traced, value

WIDTH = 126
"""Characters of a line."""
TARGET = 1e-3
"""m; the position error to which the time is told."""
COLUMNS = ("method", "by", "error [m]", "F0 off [N]", "jump [N m]", "drift", "hard", f"ms to {1e3 * TARGET:g} mm")
_LETTERS = {"engine": "E", "adapter": "A", "engine + adapter": "E+A", "nobody": "-", "not known": "?"}
ABOUT = ("The errors are distances from the independent solution: of the position and of those jumps of the torque that a run resolves, in the worst case, at equal step (the one nearest to 1 ms, or the tightest "
         "tolerance); of the threshold of stick at the finest step. < u: not larger than its uncertainty. Drift is in metres and radians together. Hard cases: right answers, of those "
         f"accepted. Last, CPU time in the engine's own calls to a position error of 1 mm in the first case; ≤: the coarsest step has a smaller error already; {MISSING}: no "
         "step that was timed reaches it. By: who supplies the friction law / who locates events: E the engine, A our "
         "adapter, E+A the engine's law with a bound or coefficient of the adapter, - nobody. Only methods of one group "
         "may be compared, and ranked only where *by* is the same. Our integrator over an engine's accelerations is "
         "shown for the first case.")


def page_one(validation: Results, origin: str, figures: Sequence[Drawing]) -> str:
    """The page, in lines of at most `WIDTH` characters.

    Parameters
    ----------
    origin
        When and with what it was run, in a line.
    """
    drawn = next((figure for figure in figures if figure.topic == "mechanism"), None)
    table = pd.DataFrame([[part if isinstance(part, str) else part.text for part in row] for row in rows(validation)], columns=list(COLUMNS))
    parts = ["# Validation report", *([f"![{drawn.told}](figures/{drawn.name}.png)"] if drawn else []), textwrap.fill(origin, WIDTH)]
    if len(table):
        parts += [fitted(table, len(table), WIDTH), textwrap.fill(ABOUT, WIDTH)]
    return "\n\n".join([*parts, *_items([*findings(validation), *limits(validation)])])


def rows(validation: Results) -> Iterator[list[Part]]:
    """The table row by row: a heading for each group, then its methods."""
    tables = tables_of(validation)
    for group, variants in grouped_methods(validation):
        yield [group, *[" "] * (len(COLUMNS) - 1)]
        for variant in variants:
            yield [variant, _suppliers(tables, "accuracy", variant), _worst(tables, "accuracy", variant, POSITION),
                   _finest(tables, variant), _worst(tables, "torque", variant, JUMP),
                   _worst(tables, "drift", variant, DRIFT), _hard(tables, variant), _time(tables, variant)]
            for integrated in _over_accelerations(tables, variant):
                yield [integrated, _suppliers(tables, "cost", integrated), _worst(tables, "cost", integrated, POSITION),
                       *[MISSING] * 4, _time(tables, integrated)]


def _over_accelerations(tables: dict[str, pd.DataFrame], variant: str) -> list[str]:
    """Variants that integrate the accelerations of an engine whose own steps are this variant."""
    cost, accuracy = tables.get("cost", pd.DataFrame()), tables.get("accuracy", pd.DataFrame())
    if not {"parameter", EVENTS_BY} <= set(cost):
        return []
    own = accuracy[accuracy["variant"] == variant].iloc[0]
    if own["fidelity"] != "joint" or own["engine"] == REFERENCE or own["parameter"] != "dt":
        return []
    there = cost[(cost["engine"] == own["engine"]) & (cost["fidelity"] == "joint") & (cost["parameter"] == "rtol")
                 & (cost[EVENTS_BY] == "adapter")]
    return list(dict.fromkeys(there["variant"]))


def _suppliers(tables: dict[str, pd.DataFrame], name: str, variant: str) -> str:
    rows_there = tables[name][tables[name]["variant"] == variant]
    return "/".join(_LETTERS[known_of(rows_there, column)[variant]] for column in (FRICTION_BY, EVENTS_BY))


def numbers(validation: Results) -> list[Number]:
    """Every number of the page but the names of columns."""
    told = [part for row in rows(validation) for part in row if isinstance(part, (Number, TracedText))]
    told += [finding.told for finding in (*findings(validation), *limits(validation))]
    return [number for part in told for number in ((part,) if isinstance(part, Number) else part.numbers)]


def _worst(tables: dict[str, pd.DataFrame], name: str, variant: str, column: str) -> Part:
    rows_there = at_equal_step(tables.get(name, pd.DataFrame()), variant)
    row = largest(rows_there, column)
    return MISSING if row is None else value(name, rows_there, row, column)


def _finest(tables: dict[str, pd.DataFrame], variant: str) -> Part:
    table = tables.get("threshold", pd.DataFrame())
    there = table[(table["variant"] == variant) & table["error [N]"].notna()] if "error [N]" in table else table.iloc[:0]
    return value("threshold", table, int(there["step"].idxmin()), "error [N]") if len(there) else MISSING


def _hard(tables: dict[str, pd.DataFrame], variant: str) -> Part:
    table = tables.get("hard", pd.DataFrame())
    if table.empty or variant not in set(table["variant"]):
        return MISSING
    if not table.loc[table["variant"] == variant, "verdict"].isin(ACCEPTED).any():
        return MISSING
    return traced("{}/{}", count("hard", table, variant=variant, verdict="right"), count("hard", table, variant=variant, verdict=ACCEPTED))


def _time(tables: dict[str, pd.DataFrame], variant: str) -> Part:
    table = equal_errors(tables)
    there = table.index[(table["variant"] == variant) & (table["error"] == TARGET)] if len(table) else ()
    return Number(time_of(table.loc[there[0]], MILLI), "equal-error", OWN_CPU, rows=(int(there[0]) + 1,), factor=MILLI) if len(there) else MISSING


def _items(found: Sequence[Finding]) -> list[str]:
    lines = [textwrap.fill(f"- **{finding.title}.** {finding.told.text}", WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False) for finding in found]
    return ["\n".join(lines)] if lines else []
