"""The page of a run: its time series to zoom into, its figures, its tables with a key per row."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from stiction.comparisons.atomic_files import write_text
from stiction.reports.page.document import chart, document, image, paragraph, table
from stiction.reports.page.time_series import time_series
from stiction.reports.paper.folder import told
from stiction.reports.paper.sections import in_sections
from stiction.reports.paper.sheets import KEY, Sheet, sheets
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import Source, resolve

HINT = ("The pointer moves the time, and the mechanism follows. Drag to zoom, double-click to reset; with the keyboard +, - and 0. Grey: stick phases of the "
        "independent solution. A difference is that of two samples of one time, from the truth of the physics that the run has; none is drawn where it is zero.")


def write_run_page(run: StoredRun, file: Path) -> None:
    """Write the page; the same run gives the same bytes."""
    validation = run.validation()
    sections = {"Results": [paragraph(line) for line in told(validation)]}
    if views := list(time_series(validation)):
        sections["Time series"] = [chart("time-series", ("Scene",), views, HINT)]
    shown = run.tables["figures"].query("topic != 'paper'").itertuples(index=False)  # those are the time series
    for section, figures, tables in in_sections(list(shown), list(sheets(run, validation))):
        sections[section.title] = [*(image(run.folder / "figures" / f"{row.name}.png", row.caption) for row in figures), *(_table(run, sheet) for sheet in tables)]
    sections["Provenance"] = [table("Of the run.", ("what", "value"), _origin(run), (False, False))]
    write_text(file, document("Validation report", f"stiction {run.origin['versions']['stiction']}, run of {run.origin['date']}", sections))


def _table(run: StoredRun, sheet: Sheet) -> str:
    keys = list(sheet.frame[KEY])
    return table(sheet.caption, [" ".join(words) for words in sheet.heads()], sheet.cells(), sheet.right(),
                 [f"{sheet.name}-{key}" for key in keys], [_about(resolve(run, key)) for key in keys])


def _about(source: Source) -> str:
    first, last = source.rows.index[0], source.rows.index[-1]
    return f"data/{source.table}.csv, row {first}" + (f" to {last}" if last > first else "") + "".join(f"\n{file}" for file in source.files)


def _origin(run: StoredRun) -> Iterator[tuple[str, str]]:
    origin = run.origin
    yield "date", origin["date"]
    for part in ("versions", "engines", "machine", "campaign", "choices"):
        yield from ((f"{part}: {name}", str(value)) for name, value in origin[part].items())
    if origin["commit"]:
        yield "commit", origin["commit"]["hash"] + (" with uncommitted changes" if origin["commit"]["dirty"] else "")
