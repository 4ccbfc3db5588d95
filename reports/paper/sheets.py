"""The tables of a paper: which rows and columns of a run's data, under which caption, and the key of each row."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from stiction.comparisons.results import Results
from stiction.comparisons.measures.accuracy import KINDS, missed
from stiction.comparisons.studies.engine_settings import FACTOR, SUBJECT, ranks_of_defaults
from stiction.reports.markdown.claims_page import HARM_WORDS, claims_shown, harm_shown, study_shown
from stiction.reports.markdown.cost_page import SETTINGS_WORDS, WORDS, picked, times_table
from stiction.reports.markdown.hard_page import SYMBOLS, hard_signs
from stiction.reports.markdown.losses import losses
from stiction.comparisons.presentation.cells import cell, is_numeric, setting_of, uncertainty_of, with_uncertainty, worst_per_run
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import key_of

KEY = "key"
"""Last column of every sheet, see `stiction.reports.run_folder.trace`."""

MISSED = "missed, by kind"
# no CPU times in these: the runs were made beside each other; those of the table "cost" were made one at a time
ACCURACY = ("position error [m]", "velocity error [m/s]", "torque error, L1 mean [N m]", "event time error [s]", "events matched", MISSED, "events spurious")
DRIFT = ("position drift, max [m]", "position drift, end [m]", "velocity drift, max [m/s]", "velocity drift, end [m/s]", "growth")
STUDY = ("scene", "choice", "step", "time [s]", "reason", "amplification per step [-]", "position drift, max [m]", "law of growth",
         "drift, of that without [-]", "error, of that without [-]")
THRESHOLD = ("mus", "truth [N]", "F0 with stick [N]", "F0 without stick [N]", "F0 threshold [N]", "error [N]", "uncertainty [N]", "runs")
TORQUE = ("jumps", "resolved", "largest jump error [N m]", "largest time error [s]")
VARIANTS = ("variant", "engine", "version", "fidelity", "ladder", "method", "friction law", "stabilization", "iterations")
CLAIMS = ("case", "place", "claim", "verdict", "margins", "run needed [s]", "step needed [s]")
ABOUT = ("variant", "parameter", "step", "status", "reason")
ERRORS = 6
"""In a table of times, beside each other."""
TOO_WIDE = ("velocity change [m/s]", "first event [s]", "pivots [-]", "repeats", "timing")
"""What `stiction.reports.markdown.cost_page.PICKED` has of a run itself, and what a page has no room for."""
UNITS = {"F0": "N", "L": "m", "w0": "rad/s", "g": "m/s^2", "m1": "kg", "m2": "kg", "k": "N/m", "L0": "m", "Omega": "rad/s", "mu": "-",
         "mus": "-"}
"""Of the parameters of the paper's scenes; those of others have units that nobody has told."""


@dataclass(frozen=True)
class Sheet:
    """A table: `frame` in full precision, headings with units, `KEY` last; `name` of its files and `topic` as of a `Drawing`.

    `numbered`: columns between the first and the last have their numbers above them in print, and `caption` says what they are.
    """

    name: str
    topic: str
    caption: str
    frame: pd.DataFrame
    numbered: bool = False

    def cells(self) -> list[list[str]]:
        """Rows as they stand in print."""
        return [[cell(name, value) for name, value in row.items()] for row in self.shown.to_dict("records")]

    @property
    def shown(self) -> pd.DataFrame:
        """The frame as it is printed: each number with its uncertainty."""
        return with_uncertainty(self.frame)

    def heads(self) -> list[list[str]]:
        """The words of each heading, which stand below each other; a unit is one word."""
        names = list(self.shown)
        if self.numbered:
            names[1:-1] = range(1, len(names) - 1)
        return [re.findall(r"\[[^]]*\]|\S+", str(name)) for name in names]

    def right(self) -> list[bool]:
        """Which columns hold numbers."""
        return [is_numeric(values) for _, values in self.shown.items()]


def sheets(run: StoredRun, validation: Results) -> Iterator[Sheet]:
    """All tables for which there are data."""
    tables = run.tables
    yield from _whole(tables, "parameters", "Parameters of the scenes.",
                      lambda table: table.rename(columns={name: f"{name} [{unit}]" for name, unit in UNITS.items()}))
    yield from _whole(tables, "variants", "What was compared: engines, their settings, and the steps or tolerances of their runs.",
                      lambda table: table[list(VARIANTS)])
    yield from _whole(tables, "claims", "What the paper says about its example (Zhuang & Wang 2014, Sect. 5), and whether it holds.",
                      lambda table: claims_shown(table)[[name for name in CLAIMS if name in claims_shown(table)]])
    yield from _whole(tables, "sensitivity", "What the paper does not give, in other ways: numbers of the independent solution, and claims whose verdict changes.", pd.DataFrame)
    yield from _whole(tables, "orders", "Observed orders of the reference's two ways, with intervals of 95 %.", pd.DataFrame)
    yield from _whole(tables, "study", "Drift of the paper's scheme over long runs: without stabilization, with Baumgarte's (alpha, beta), with projection.",
                      lambda table: study_shown(table)[[name for name in STUDY if name in study_shown(table)]])
    yield from _harm(tables.get("study", pd.DataFrame()))
    yield from _by_scene({**tables, "accuracy": _with_missed(tables.get("accuracy", pd.DataFrame()))}, "accuracy", "largest errors against the truth, and events found, missed and spurious.", ACCURACY)
    yield from _by_scene(tables, "drift", "residuals of the constraints.", DRIFT)
    yield from _by_scene(tables, "threshold", "largest load amplitude F0 with a stick phase in the steady state.", THRESHOLD)
    yield from _torque(tables.get("torque", pd.DataFrame()))
    yield from _cost(tables)
    yield from _settings(tables.get("settings", pd.DataFrame()))
    yield from _hard(tables.get("hard", pd.DataFrame()))
    lost = losses(validation)
    if len(lost):
        rows = pd.DataFrame({"scene": lost["scene"], **_runs(lost), "status": lost["status"], "reason": lost["reason"],
                             KEY: [key_of(table, [row]) for table, row in zip(lost["table"], lost["row"])]})
        yield Sheet("failures", "failures", "Runs that did not come out, or not whole, and why.", rows)


def _whole(tables: dict[str, pd.DataFrame], name: str, caption: str, chosen: Callable[[pd.DataFrame], pd.DataFrame]) -> Iterator[Sheet]:
    """A sheet of all rows of a table."""
    table = tables.get(name, pd.DataFrame())
    if len(table):
        frame = _told(chosen(table))
        yield Sheet(name, name, caption, frame.assign(**{KEY: _keys(name, np.arange(len(table)))}))


def _harm(study: pd.DataFrame) -> Iterator[Sheet]:
    """From which step on stabilization does harm; each row from the runs of its choice on its scene."""
    shown = harm_shown(study)
    if len(shown):
        behind = [key_of("study", np.flatnonzero((study["scene"] == scene) & (study["choice"] == choice)) + 1) for scene, choice in zip(shown["scene"], shown["choice"])]
        yield Sheet("harm", "study", HARM_WORDS, shown.assign(**{KEY: behind}))


def _by_scene(tables: dict[str, pd.DataFrame], name: str, caption: str, columns: Iterable[str]) -> Iterator[Sheet]:
    """A sheet per scene with a row per run."""
    table = tables.get(name, pd.DataFrame())
    for scene, rows in table.groupby("scene", sort=False) if len(table) else ():
        frame = pd.DataFrame({**_runs(rows), **_values(rows, columns), KEY: _keys(name, np.flatnonzero(table["scene"] == scene))})
        yield Sheet(f"{name}-{scene}", name, f"{scene}: {caption}", frame)


def _with_missed(table: pd.DataFrame) -> pd.DataFrame:
    """With the events that a run missed as words: how many of which kind."""
    counts = table.reindex(columns=[missed(kind) for kind in KINDS])
    words = [", ".join(f"{int(count)} {kind}" for kind, count in zip(KINDS, row) if count > 0) or ("" if np.isnan(row).all() else "0")
             for row in counts.to_numpy(dtype=float)]
    return table.assign(**{MISSED: words})


def _torque(table: pd.DataFrame) -> Iterator[Sheet]:
    """A sheet per scene with a row per run, whose numbers sum up one row of the data per jump."""
    for scene, rows in table.groupby("scene", sort=False) if len(table) else ():
        worst = worst_per_run(rows)
        behind = [key_of("torque", np.flatnonzero(table["key"] == key) + 1) for key in worst["key"]]
        yield Sheet(f"torque-{scene}", "torque", f"{scene}: largest errors of size and time of the jumps of the driving torque.",
                    pd.DataFrame({**_runs(worst), **_values(worst, TORQUE), KEY: behind}))


def _cost(tables: dict[str, pd.DataFrame]) -> Iterator[Sheet]:
    equal = tables.get("equal-error", pd.DataFrame())
    for (scene, quantity), rows in equal.groupby(["scene", "quantity"], sort=False) if len(equal) else ():
        shown = times_table(rows, ERRORS).drop(columns=["scene", "quantity"])
        behind = [key_of("equal-error", part.index + 1) for _, part in rows.groupby(["fidelity", "variant"], sort=False)]
        unit = rows["unit"].iloc[0]
        yield Sheet(f"times-to-{quantity.replace(' ', '-')}-{scene.replace('/', '-')}", "cost", f"{scene}, error of {quantity} [{unit}]: {WORDS}",
                    shown.rename(columns={"ends at": f"ends at [{unit}]"}).assign(**{KEY: behind}))
    for name, caption in (("cost", "error and cost of every rung of every ladder."),
                          ("effects", "what each effect of the scene does and costs."),
                          ("suppression", "drift suppression, all else equal.")):
        table = tables.get(name, pd.DataFrame())
        if len(table):
            columns = [column for column in picked(table, name) if column not in (*ABOUT, *TOO_WIDE)]
            frame = pd.DataFrame({**_runs(table), **_values(table, columns), KEY: _keys(name, np.arange(len(table)))})
            same = [column for column in ("variant", "setting") if len(frame) > 1 and frame[column].nunique() == 1]
            about = ", ".join([*dict.fromkeys(table["scene"]), *frame[same].iloc[0]])
            yield Sheet(name, name, f"{about}: {caption}", frame.drop(columns=same))


def _settings(table: pd.DataFrame) -> Iterator[Sheet]:
    """How the defaults of each method of an engine stand among the other choices, each row from all runs of the method."""
    ranks = ranks_of_defaults(table) if len(table) else table
    if len(ranks):
        behind = [key_of("settings", np.flatnonzero(table[SUBJECT] == subject) + 1) for subject in ranks[SUBJECT]]
        yield Sheet("settings", "settings", SETTINGS_WORDS, ranks.rename(columns={SUBJECT: "engine", "step": "step [s]", FACTOR: "times slower"}).assign(**{KEY: behind}))


def _hard(table: pd.DataFrame) -> Iterator[Sheet]:
    """The matrix of cases and variants, one sign a cell."""
    if table.empty:
        return
    table = table.reset_index(drop=True)
    keys = {case: key_of("hard", part.index + 1) for case, part in table.groupby("case")}
    signs = hard_signs(table)
    frame = signs.fillna("").reset_index().assign(**{KEY: lambda rows: rows["case"].map(keys)})
    legend = ", ".join(f"{sign} {verdict}" for verdict, sign in SYMBOLS.items())
    ways = ", ".join(f"{number} {variant}" for number, variant in enumerate(signs, 1))
    yield Sheet("hard", "hard", f"Hard cases by variant: {ways}. Signs: {legend}; empty: not begun, because it is not expressible, its adapter or "
                "the reader of scenes refuses it, or its engine is not installed. Degraded: less accurate than the method should be; declined: by the method's own word; "
                "impulsive: goes on by impulses where there is no motion with finite forces; failed: without a result.", frame, numbered=True)


def _runs(rows: pd.DataFrame) -> dict[str, object]:
    """Variant and setting."""
    return {"variant": rows["variant"], "setting": [setting_of(*pair) for pair in zip(rows["parameter"], rows["step"])]}


def _values(rows: pd.DataFrame, columns: Iterable[str]) -> dict[str, pd.Series]:
    """Of the columns those that hold anything, their uncertainties beside them."""
    both = dict.fromkeys(name for column in columns for name in (column, uncertainty_of(column)))
    return dict(_told(rows[[column for column in both if column in rows]]).items())


def _told(table: pd.DataFrame) -> pd.DataFrame:
    return table[[name for name in table if (table[name].notna() & (table[name] != "")).any()]]


def _keys(table: str, places: Iterable[int]) -> list[str]:
    return [key_of(table, [place + 1]) for place in places]
