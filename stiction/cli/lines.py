"""What came out of each comparison of `stiction validate`, in one line, as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from stiction.comparisons.uncertain import Uncertain

if TYPE_CHECKING:
    import pandas as pd

POSITION = "position error [m]"


def line(name: str, table: pd.DataFrame) -> str:
    """Of a table of the validation by its name; what did not come out is counted at the end."""
    said = _LINES[name](table)
    lost = int((table["status"] != "ok").sum()) if "status" in table else 0
    return said + (f"; {lost} of {len(table)} runs lost" if lost else "")


def _truth(table: pd.DataFrame) -> str:
    row = table.iloc[0]
    found = row["reason"] if row["threshold [N]"] is None else f"F0 = {Uncertain(row['threshold [N]'], row['uncertainty [N]']).both()} N"
    return f"stick threshold of the independent solution: {found}"


def _accuracy(table: pd.DataFrame) -> str:
    said = f"{table['scene'].iloc[0]}, largest position error, finest step"
    if POSITION not in table:
        return f"{said}: nobody's run came out"
    known = table[table[POSITION].notna()]
    for fidelity, rows in known.groupby("fidelity", sort=False):
        said += f"; {fidelity}: " + ", ".join(f"{variant} {error:.1g} m" for variant, error in zip(rows["variant"], rows[POSITION]))
    return said


def _threshold(table: pd.DataFrame) -> str:
    errors, unsure = (table.get(name) for name in ("error [N]", "uncertainty [N]"))
    if errors is None or unsure is None:
        return "stick threshold: nobody's was found"
    finest = table[errors.notna()].sort_values("step", kind="stable").groupby("variant", sort=False).head(1).sort_index()
    return "stick threshold, off the independent solution's by: " + ", ".join(
        f"{variant} {Uncertain(error, width)} N" for variant, error, width in zip(finest["variant"], finest["error [N]"], finest["uncertainty [N]"]))


def _study(table: pd.DataFrame) -> str:
    column = "position drift, max [m]"
    if column not in table:
        return "drift of the paper's scheme: no run came out"
    rows = table[table[column].notna()]
    rows = rows.sort_values("step").groupby("choice", sort=False).head(1).sort_index()
    return "largest drift (m and rad together) of the paper's scheme, smallest step: " + ", ".join(
        f"{choice} {drift:.1g} in {time:g} s" for choice, drift, time in zip(rows["choice"], rows[column], rows["time [s]"]))


def _hard(table: pd.DataFrame) -> str:
    from stiction.comparisons.hard.examination import NOT_INSTALLED

    tried = table[table["verdict"] != NOT_INSTALLED]
    right = (tried["verdict"] == "right").groupby(tried["variant"], sort=False).sum()
    return f"hard cases right, of {table['case'].nunique()}: " + ", ".join(f"{variant} {count}" for variant, count in right.items())


def _orders(table: pd.DataFrame) -> str:
    fits = table.drop_duplicates("method")
    return "order of convergence: " + ", ".join(
        f"{row['method']} " + (f"{Uncertain(row['observed order [-]'], row['interval of the order [-]']).both()}" if not row["why none"] else f"not found ({row['why none']})")
        for row in fits.to_dict("records"))


def _claims(table: pd.DataFrame) -> str:
    return "statements of the paper: " + ", ".join(f"{verdict} {count}" for verdict, count in table["verdict"].value_counts().items())


def _sensitivity(table: pd.DataFrame) -> str:
    said = table.get("claims that change")
    changing = 0 if said is None else int((said.notna() & (said != "none")).sum())
    return f"what the paper leaves open: {changing} of {len(table)} choices change a verdict on its statements"


def _cost(table: pd.DataFrame) -> str:
    if POSITION not in table:
        return "cost: no run came out"
    best = table.loc[table[table[POSITION].notna()].groupby("variant", sort=False)[POSITION].idxmin()]
    return "CPU inside the engine for its smallest error: " + ", ".join(
        f"{variant} {1e3 * seconds:.2g} ms for {error:.1g} m" for variant, seconds, error in zip(best["variant"], best["engine cpu [s]"], best[POSITION]))


def _settings(table: pd.DataFrame) -> str:
    from stiction.comparisons.studies.engine_settings import ON_FRONT, distance_of_defaults

    tried = distance_of_defaults(table)
    if tried.empty:
        return "settings of the engines: no run came out"
    return f"settings of the engines: defaults are on the front in {int(tried[ON_FRONT].sum())} of {len(tried)} comparisons"


def _equal_error(table: pd.DataFrame) -> str:
    reached = int(table["engine cpu [s]"].notna().sum()) if len(table) else 0
    return f"time to equal error on {table['scene'].nunique() if len(table) else 0} more mechanisms: {reached} of {len(table)} errors reached"


def _effects(table: pd.DataFrame) -> str:
    column = "cpu, of baseline [-]"
    if column not in table or not table[column].notna().any():
        return "effects: no run came out"
    least = table.loc[table[column].idxmin()]
    names = table.loc[table["cpu, of baseline, low [-]"] <= least["cpu, of baseline, high [-]"], "effect"]
    return (f"{', '.join(names)}: {100 * least[column]:.0f} % of the reference's time, the least of {len(table)} changes"
            + (", of which these are not told apart" if len(names) > 1 else ""))


def _suppression(table: pd.DataFrame) -> str:
    column = "position drift, max [m]"
    if column not in table:
        return "drift suppression: no run came out"
    worst = table.groupby("suppression", sort=False)[column].max()
    return "largest drift (m and rad together) in 24 s, of the reference's ways: " + ", ".join(f"{choice} {drift:.1g}" for choice, drift in worst.items())


_LINES: dict[str, Callable[[pd.DataFrame], str]] = {
    "truth": _truth, "accuracy": _accuracy, "threshold": _threshold, "study": _study, "hard": _hard, "orders": _orders, "claims": _claims,
    "sensitivity": _sensitivity, "settings": _settings, "equal-error": _equal_error, "cost": _cost, "effects": _effects, "suppression": _suppression}
