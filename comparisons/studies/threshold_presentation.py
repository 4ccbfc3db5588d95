"""Presentation of the study of stick limits: what its text mentions, its tables and its figures."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
import pandas as pd

from stiction.comparisons.bench.methods import with_columns
from stiction.comparisons.bench.presentation import (
    METHOD,
    Axis,
    Chart,
    Column,
    Headline,
    Panel,
    Presentation,
    Row,
    Series,
    TableView,
    row_of,
    view,
)
from stiction.comparisons.bench.presentation.cells import setting_of
from stiction.comparisons.bench.presentation.charts import TRUTH as TRUTH_LOOK
from stiction.comparisons.bench.results import Results
from stiction.comparisons.measures.engine_bands import Verdict
from stiction.comparisons.measures.reference_bands import AMPLITUDE
from stiction.comparisons.studies.threshold_tables import (
    AGAIN,
    BANDS,
    CHANGE,
    ERROR,
    MAP,
    SCANNED,
    TIER,
    TRUE_THRESHOLD,
    TRUE_UNCERTAINTY,
    TRUE_VARIANT,
    UNCERTAINTY,
    VARIED,
    VARIED_UNIT,
    WITH_STICK,
    WITHOUT_STICK,
)
from stiction.engines.status import Status
from stiction.truths import Tier
from stiction.truths.bands import BandKind
from stiction.uncertain import Uncertain

SETTLES = 0.25
"""Part of an error by which the last refinement may still change it where it is said to be one: with more, finer steps
may remove it."""
MOST_NAMED = 2
"""Number of methods up to which the answer, which is one line, names them."""
UNIT_OF_AMPLITUDE = "N"
"""Unit of the parameter of results that were stored without its unit: they are about F0."""


def present(results: Results) -> Presentation:
    """Present for each scene its bands, and how far the threshold of each method is from the true one."""
    thresholds = results.table("threshold")
    bands = results.table(BANDS)
    mapped = results.table(MAP)
    subjects = [
        _Subject(
            number,
            _rows_of(thresholds, scene),
            _rows_of(bands, scene),
            _rows_of(mapped, scene),
        )
        for number, scene in enumerate(_scenes(bands, thresholds), 1)
    ]
    subjects = [subject for subject in subjects if subject.has_answer]
    if not subjects:
        return Presentation()
    first = subjects[0]
    rows = [subject.rows() for subject in subjects]
    return Presentation(
        rows={**rows[0], "subjects": rows, "settles": SETTLES, "most_named": MOST_NAMED},
        headlines=first.headlines(),
        tables=[
            table
            for subject in subjects
            for table in (*subject.band_views(), *subject.threshold_views())
        ],
        figures=[chart for subject in subjects for chart in subject.charts()],
    )


def _scenes(*tables: pd.DataFrame) -> list[str | None]:
    """Return the names of the scenes in some tables, each once; None for rows without a name."""
    scenes: list[str | None] = []
    for table in tables:
        if "scene" in table:
            scenes += list(table["scene"])
        elif len(table):
            scenes.append(None)
    return list(dict.fromkeys(scenes))


def _rows_of(table: pd.DataFrame, scene: str | None) -> pd.DataFrame:
    """Return the rows of a table about a scene, with the index of the whole table."""
    if scene is None or "scene" not in table:
        return table
    return table[table["scene"] == scene]


class ThresholdVerdict(StrEnum):
    """How the threshold of a method with its finest step compares with the true one."""

    AGREES = "agrees"
    """The difference is not larger than its uncertainty."""
    DEVIATES = "deviates"
    """The difference is larger than its uncertainty, and smaller steps are not expected to remove it."""
    ONE_STEP = "open: one step only"
    """The difference is larger than the bracket of the search; the error of the step is not known."""
    COARSER = "open: coarser step than others"
    """The difference is larger than its uncertainty, but other methods were run with smaller steps."""
    NOT_CONVERGED = "open: not converged"
    """The last refinement has changed the difference by more than `SETTLES` of itself."""


OPEN_VERDICTS = (
    ThresholdVerdict.ONE_STEP,
    ThresholdVerdict.COARSER,
    ThresholdVerdict.NOT_CONVERGED,
)
"""Verdicts on differences that smaller steps may remove."""


@dataclass(frozen=True)
class _Subject:
    """The results of one scene.

    Attributes
    ----------
    number : int
        Number of the scene among those of the study, from 1.
    thresholds, bands, mapped : DataFrame
        Rows about the scene in the tables of `threshold_tables`, with the index of the whole table.
    """

    number: int
    thresholds: pd.DataFrame
    bands: pd.DataFrame
    mapped: pd.DataFrame

    @property
    def suffix(self) -> str:
        """The end of the names of tables and figures: empty for the first scene."""
        return "" if self.number == 1 else f"-{self.number}"

    @cached_property
    def about(self) -> dict[str, str]:
        """The scene, the varied parameter and its unit."""
        table = self.thresholds if self.bands.empty else self.bands
        columns = with_columns(table, "scene", VARIED, VARIED_UNIT).iloc[0]
        varied = columns[VARIED] if isinstance(columns[VARIED], str) else AMPLITUDE
        unit = columns[VARIED_UNIT]
        if not isinstance(unit, str):
            unit = UNIT_OF_AMPLITUDE if varied == AMPLITUDE else ""
        scene = columns["scene"] if isinstance(columns["scene"], str) else ""
        return {"scene": scene, "varied": varied, "unit": unit}

    @property
    def label(self) -> str:
        """The label of an axis over the varied parameter."""
        unit = self.about["unit"]
        return f"{self.about['varied']} [{unit}]" if unit else self.about["varied"]

    @cached_property
    def complete(self) -> pd.DataFrame:
        """The thresholds with all columns that the presentation uses, and the setting of each run."""
        table = with_columns(
            self.thresholds,
            *("variant", "parameter", "step", "status", "mus"),
            *(ERROR, CHANGE, TRUE_THRESHOLD, TIER, AGAIN, SCANNED),
        )
        settings = []
        if len(table):
            settings = list(map(setting_of, table["parameter"], table["step"]))
        return table.assign(setting=settings)

    @property
    def measured(self) -> pd.DataFrame:
        """The runs with a threshold that can be compared with the true one."""
        return self.complete[self.complete[ERROR].notna()]

    @property
    def finest(self) -> pd.DataFrame:
        """The measured run of each method with its finest step."""
        measured = self.measured
        if measured.empty:
            return measured
        return measured.loc[measured.groupby("variant", sort=False)["step"].idxmin()]

    @property
    def true_bands(self) -> pd.DataFrame:
        """The true bands."""
        return self.bands[self.bands["variant"] == TRUE_VARIANT] if len(self.bands) else self.bands

    @property
    def has_answer(self) -> bool:
        """True if there are bands, or a threshold that can be compared."""
        return bool(len(self.true_bands) or len(self.measured))

    def rows(self) -> dict[str, object]:
        """Return what the text mentions."""
        table, measured = self.complete, self.measured
        clearly, may_vanish = _off(self.finest)
        tried_once = _single_steps(self.finest)
        refused = _refusals(table)
        without = [] if refused else self._without_threshold()
        proven = table[table[TIER] == Tier.PROVEN]
        truth = None
        with_truth = table[table[TRUE_THRESHOLD].notna()]
        if len(with_truth):
            label = measured.index[0] if len(measured) else with_truth.index[0]
            truth = row_of("threshold", table, label)[TRUE_THRESHOLD]
        return {
            "suffix": self.suffix,
            "scene": self.about["scene"],
            "name": self.about["varied"],
            "unit": f" {self.about['unit']}" if self.about["unit"] else "",
            "truth": truth,
            "off": _errors(table, clearly),
            "inconclusive": _errors(table, may_vanish),
            "tried_once": tried_once,
            "steps_known_once": tried_once is not None and tried_once["methods"] == len(may_vanish),
            "measured": len(measured),
            "without": [row["variant"] for row in without],
            "lacking": without,
            "unanswered": _methods_by_status(without),
            "proven": _threshold_rows(table, proven.drop_duplicates("mus")) if len(proven) else [],
            "bands": _band_rows(self.bands, self.true_bands),
            "refused": refused,
            **self._searched_rows(),
            **self._wrong_band_rows(),
            **self._rows_above(),
        }

    def _without_threshold(self) -> list[dict[str, str]]:
        """Return each method of which no step has a threshold, with the status and the reason of its finest step.

        Engines that are not installed are left out, and those that decline the scene while others have a threshold.
        """
        table, measured = self.complete, self.measured
        left_out = [Status.MISSING, Status.REFUSED] if len(measured) else [Status.MISSING]
        is_without = ~table["variant"].isin(measured["variant"]) & ~table["status"].isin(left_out)
        last = table[is_without].drop_duplicates("variant", keep="last")
        reasons = with_columns(last, "reason")["reason"].astype(object).fillna("")
        return [
            {
                "variant": row["variant"],
                "status": row["status"],
                # Further lines list every constraint, or are a traceback.
                "reason": (str(row["reason"]).splitlines() or [""])[0],
            }
            for row in last.assign(reason=reasons).to_dict("records")
        ]

    def _searched_rows(self) -> dict[str, object]:
        """Return the range and its resolution, and the bands in which the start decides."""
        true = self.true_bands
        if true.empty:
            return {"searched": None, "start_dependent": [], "own_run": False, "single": None}
        return {
            "searched": row_of(BANDS, self.bands, true.index[0]),
            "start_dependent": _band_rows(self.bands, true[true["depends_on_start"].eq(True)]),
            "single": self._single_coefficient,
            "own_run": bool(true["truth_tier"].eq(Tier.OWN_RUN).all()),
        }

    @property
    def _single_coefficient(self) -> Row | None:
        """The row of the true bands for mus = mu, if there are others; static friction is never the smaller one."""
        true = self.true_bands
        if true["mus"].nunique() < 2:
            return None
        return row_of(BANDS, self.bands, true["mus"].idxmin())

    def _wrong_band_rows(self) -> dict[str, object]:
        """Return the methods that miss or invent a band."""
        verdicts = {"missed": Verdict.MISSED, "invented": Verdict.INVENTED}
        if "verdict" not in self.bands:
            return {name: [] for name in verdicts}
        return {
            name: list(self.bands.loc[self.bands["verdict"] == verdict, "variant"].unique())
            for name, verdict in verdicts.items()
        }

    def _rows_above(self) -> dict[str, object]:
        """Return where the slider sticks again above the threshold of each physics, and up to where that is known.

        The end of the shortest search is None if there was none.
        """
        table = self.complete
        scanned = table[table[SCANNED].notna()]
        if len(scanned):
            scanned = scanned.drop_duplicates("mus")
        again = scanned[scanned[AGAIN].fillna("").ne("")]
        end = None
        if len(scanned):
            end = row_of("threshold", table, scanned[SCANNED].idxmin())[SCANNED]
        return {"again": _threshold_rows(table, again), "scanned_to": end}

    def headlines(self) -> list[Headline]:
        """Return the error of each method with its finest step; nothing if no threshold was measured."""
        finest = self.finest
        if finest.empty:
            return []
        unit = self.about["unit"]
        cells = {
            row["variant"]: Uncertain(row[ERROR], row[UNCERTAINTY]).both()
            for row in finest.to_dict("records")
        }
        return [
            Headline(
                f"error of the stick limit [{unit}]" if unit else "error of the stick limit", cells
            )
        ]

    def threshold_views(self) -> list[TableView]:
        """Return the thresholds with the finest steps, and those with all steps."""
        if self.measured.empty:
            return []
        unit, varied = self.about["unit"], self.about["varied"]
        columns = (
            METHOD,
            Column("fidelity"),
            Column("mus", form="g"),
            Column("setting"),
            Column(WITH_STICK, "sticks at", unit, form=".6g", brief=False),
            Column(WITHOUT_STICK, "slips at", unit, form=".6g", brief=False),
            Column(ERROR, f"{varied}, difference from truth", unit, interval=True),
            Column(AGAIN, unit=unit),
            Column("runs", brief=False),
            Column("reason", brief=False),
        )
        judged = self.finest.assign(verdict=_verdicts(self.finest))
        judged_columns = (*columns[:7], Column("verdict"), *columns[7:])
        finest = view(f"threshold{self.suffix}", judged, judged_columns, source="threshold")
        every = view(
            f"threshold-all{self.suffix}",
            self.complete,
            columns,
            source="threshold",
            in_report=False,
        )
        return [finest, every]

    def band_views(self) -> list[TableView]:
        """Return the table of the true bands, and that of the engines' bands."""
        if self.bands.empty:
            return []
        unit = self.about["unit"]
        true = view(
            f"bands{self.suffix}",
            self.true_bands,
            (
                Column("mus", form="g"),
                Column("band_low", unit=unit, form=".12g"),
                Column("band_high", unit=unit, form=".12g"),
                Column("band_kind"),
                Column("coexisting"),
                Column("truth_tier"),
            ),
            source=BANDS,
        )
        is_compared = self.bands["variant"] != TRUE_VARIANT
        engines = with_columns(
            self.bands[is_compared], "verdict", "fidelity", "band_low_shift", "band_high_shift"
        )
        if engines["verdict"].dropna().isin([Verdict.NOT_COMPARED]).all():
            return [true]
        compared = view(
            f"bands-engines{self.suffix}",
            engines,
            (
                METHOD,
                Column("mus", form="g"),
                Column("band_low", unit=unit, form=".6g"),
                Column("band_high", unit=unit, form=".6g"),
                Column(
                    "band_low_shift", unit=unit, interval=True, uncertainty="band_low_uncertainty"
                ),
                Column(
                    "band_high_shift", unit=unit, interval=True, uncertainty="band_high_uncertainty"
                ),
                Column("verdict"),
            ),
            source=BANDS,
            in_report=self.measured.empty,
        )
        return [true, compared]

    def charts(self) -> list[Chart]:
        """Return the map, the true bands, and the differences of thresholds, as far as there are any."""
        charts = []
        if "band_kind" in self.mapped:
            charts.append(self._map_chart())
        if len(self.true_bands):
            charts.append(self._band_chart())
        if len(self.measured):
            charts.append(self._threshold_chart())
        return charts

    def _map_chart(self) -> Chart:
        """Return the map: a vertical bar over F0 for each band and each coefficient of friction."""
        series = []
        for kind, rows in self.mapped.dropna(subset="band_kind").groupby("band_kind", sort=False):
            low, high = rows["band_low"].to_numpy(float), rows["band_high"].to_numpy(float)
            look = TRUTH_LOOK if kind == BandKind.STICK else str(kind)
            at = rows["mu"].to_numpy(float)
            series.append(_bars(str(kind), at, 0.5 * (low + high), low, high, look))
        panel = Panel("", Axis("mu"), Axis(self.label), series)
        return Chart(f"{MAP}{self.suffix}", (panel,), columns=1, height=3.4)

    def _band_chart(self) -> Chart:
        """Return the chart of the true bands over the parameter, a line for each physics."""
        series, names = [], []
        named_kinds: set[str] = set()
        for place, (mus, rows) in enumerate(self.true_bands.groupby("mus", sort=False)):
            names.append(f"mus = {mus:g}")
            for kind, alike in rows.groupby("band_kind", sort=False):
                low, high = alike["band_low"].to_numpy(float), alike["band_high"].to_numpy(float)
                # Each kind is named once in the legend.
                name = "" if kind in named_kinds else str(kind)
                at = np.full(len(low), -float(place))
                series.append(_bars(name, 0.5 * (low + high), at, low, high, str(kind)))
                named_kinds.add(str(kind))
        ticks = [-float(place) for place in range(len(names))]
        vertical = Axis("", ticks=ticks, words=names)
        panel = Panel("", Axis(self.label), vertical, series, horizontal=True)
        return Chart(f"{BANDS}{self.suffix}", (panel,), columns=1, height=0.8 + 0.3 * len(names))

    def _threshold_chart(self) -> Chart:
        """Return intervals, a line for each method; its steps from coarse to fine are below each other.

        The coarsest step has no interval: nothing is known of what a refinement changes.
        """
        measured = self.measured
        names = list(measured["variant"].unique())
        series = []
        for place, variant in enumerate(names):
            runs = measured[measured["variant"] == variant].sort_values("step", ascending=False)
            offsets = np.linspace(0.25, -0.25, len(runs)) if len(runs) > 1 else np.zeros(1)
            is_known = runs[CHANGE].notna() | (runs["parameter"] != "dt")
            error = runs[ERROR].to_numpy(float)
            unsure = runs[UNCERTAINTY].where(is_known).to_numpy(float)
            series.append(
                _bars("", error, offsets - place, error - unsure, error + unsure, variant)
            )
        unit = self.about["unit"]
        label = f"stick threshold on {self.about['varied']}, difference from the truth"
        panel = Panel(
            "",
            Axis(f"{label} [{unit}]" if unit else label),
            Axis("", ticks=[float(-place) for place in range(len(names))], words=names),
            series,
            horizontal=True,
            lines=(0.0,),
        )
        return Chart(f"threshold{self.suffix}", (panel,), columns=1, height=1.0 + 0.24 * len(names))


def _bars(
    name: str, x: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray, look: str
) -> Series:
    """Return points with a bar from `low` to `high` through each of them."""
    return Series(name, x, y, low, high, look=look, line=False, points=True)


def _threshold_rows(table: pd.DataFrame, rows: pd.DataFrame) -> list[Row]:
    """Return rows of the table of thresholds."""
    return [row_of("threshold", table, label) for label in rows.index]


def _band_rows(table: pd.DataFrame, rows: pd.DataFrame) -> list[Row]:
    """Return rows of the table of bands."""
    return [row_of(BANDS, table, label) for label in rows.index]


def _methods_by_status(without: list[dict[str, str]]) -> dict[str, list[str]]:
    """Return the methods without a threshold by their status."""
    methods: dict[str, list[str]] = {}
    for row in without:
        methods.setdefault(row["status"], []).append(row["variant"])
    return methods


def _refusals(table: pd.DataFrame) -> list[str]:
    """Return the reasons for which engines are not compared on a scene, if that is so for all of them."""
    if table.empty or not table["status"].eq(Status.REFUSED).all():
        return []
    return list(table["reason"].unique())


def _verdicts(finest: pd.DataFrame) -> pd.Series:
    """Return the `ThresholdVerdict` of each method, with the index of its run with the finest step.

    The error is a difference from a truth that has an uncertainty, too: bands of our own runs are less accurate
    than the threshold of a method with located events. Methods without a step, which refine by a tolerance, locate
    events, so that their uncertainty is complete.
    """
    if finest.empty:
        return pd.Series(dtype=object)
    of_truth = with_columns(finest, TRUE_UNCERTAINTY)[TRUE_UNCERTAINTY].astype(float).fillna(0.0)
    is_beyond = finest[ERROR].abs() > finest[UNCERTAINTY] + of_truth
    has_steps = finest["parameter"].eq("dt")
    change = finest[CHANGE].astype(float)
    is_coarser = finest["step"] > finest.loc[has_steps, "step"].min()
    is_moving = change >= SETTLES * finest[ERROR].abs()
    # Later lines take precedence: a single step is the most important reason for which a verdict is open.
    verdicts = pd.Series(ThresholdVerdict.DEVIATES, index=finest.index, dtype=object)
    verdicts[has_steps & is_moving] = ThresholdVerdict.NOT_CONVERGED
    verdicts[has_steps & is_coarser] = ThresholdVerdict.COARSER
    verdicts[has_steps & change.isna()] = ThresholdVerdict.ONE_STEP
    verdicts[~is_beyond] = ThresholdVerdict.AGREES
    return verdicts


def _off(finest: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows whose error is larger than its uncertainty, by its size: those that are sure, and the others.

    Finer steps may remove the errors of the others (`OPEN_VERDICTS`).
    """
    verdicts = _verdicts(finest)
    ordered = finest.sort_values(ERROR, key=abs, kind="stable") if len(finest) else finest
    verdicts = verdicts.reindex(ordered.index)
    return (
        ordered[verdicts.eq(ThresholdVerdict.DEVIATES)],
        ordered[verdicts.isin(OPEN_VERDICTS)],
    )


def _single_steps(finest: pd.DataFrame) -> dict[str, object] | None:
    """Return the number of methods that were run with one step only, and the steps as text; None without any.

    Only methods whose difference is larger than the bracket of the search are counted.
    """
    single = finest[_verdicts(finest).eq(ThresholdVerdict.ONE_STEP)] if len(finest) else finest
    if single.empty:
        return None
    steps = sorted(single["step"].unique())
    return {"methods": len(single), "steps": [setting_of("dt", step) for step in steps]}


def _errors(table: pd.DataFrame, rows: pd.DataFrame) -> list[dict[str, object]]:
    """Return methods with the cells of their errors."""
    return [
        {"variant": variant, "error": row_of("threshold", table, label)[ERROR]}
        for label, variant in rows.get("variant", pd.Series(dtype=object)).items()
    ]
