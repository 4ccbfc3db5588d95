"""The page of a run: page one, its time series to zoom into, and the section of every study, closed until it is opened."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from urllib.parse import quote

from stiction.comparisons.atomic_files import write_text
from stiction.comparisons.presentation.presentation import Presentation
from stiction.comparisons.presentation.table_view import TableView
from stiction.comparisons.recommendation import mechanism_in_words, recommendation
from stiction.comparisons.results import Results
from stiction.comparisons.studies.study import Study
from stiction.reports.page.document import chart, document, paragraph, table
from stiction.reports.page.time_series import time_series
from stiction.reports.page_one import HOW_TO_READ, TITLE, bullets, headline_table, not_installed
from stiction.reports.paper.folder import keys
from stiction.reports.presentations import presentations
from stiction.reports.run_folder.stored_run import StoredRun
from stiction.reports.run_folder.trace import resolve, told
from stiction.scenes import InputError

HINT = ("The pointer moves the time, and the mechanism follows. Drag to zoom, double-click to reset; with the keyboard +, - and 0. Grey: stick phases of the "
        "truth. A difference is that of two samples of one time, from the truth of the physics that the run has; none is drawn where it is zero.")
ANSWER = "Answer"
FONT = "font-family: 'DejaVu Sans', sans-serif"
"""Of nearly every text of a picture."""
GROUPS = 3
"""Groups within each other around each element of a picture."""
UNQUOTED = " /:;=,.?!@$*()+-_~|[]{}<>'"
"""Signs that stand as they are in the address of a picture, which is an attribute in double quotes."""


def write_run_page(run: StoredRun, file: Path) -> None:
    """Write the page; the same run gives the same bytes."""
    results = run.validation()
    said = presentations(results)
    sections = {ANSWER: list(_page_one(run, results, said))}
    if views := list(time_series(results)):
        sections["Time series"] = [chart("time-series", ("Scene",), views, HINT)]
    for study, each in said.items():
        sections[study.question] = [_closed(study, each, [*_words(each), *(_figure(run, figure.name, figure.caption) for figure in each.figures),
                                                          *(_table(view) for view in each.tables)])]
    used = dict.fromkeys(key for each in said.values() for view in each.tables for key in keys(view))
    sections["Where numbers come from"] = [_details("Every key of the tables", "".join(_origin_of(run, key) for key in used))]
    sections["Provenance"] = [table("Provenance of the run.", ("what", "value"), _origin(run), (False, False))]
    write_text(file, document(TITLE, f"stiction {run.origin['versions']['stiction']}, run of {run.origin['date']}", sections))


def _page_one(run: StoredRun, results: Results, said: Mapping[Study, Presentation]) -> Iterator[str]:
    """The mechanism in words, the answer, the table of all methods, the answers of the studies, and the first picture."""
    yield paragraph(mechanism_in_words(results))
    yield from (paragraph(part.text) for part in recommendation(results))
    headlines = headline_table(results, said)
    if headlines.groups:
        rows = [[re.sub(r"^\*(.*)\*$", r"\1", text) for text in row] for row in headlines.cells]
        yield table(HOW_TO_READ, headlines.heads, rows, [False] + [True] * (len(headlines.heads) - 1))
    items = "".join(f"<li><strong>{escape(title)}.</strong> {escape(answer.text)}</li>" for title, answer in bullets(said))
    yield f"<ul>{items}</ul>"
    if missing := not_installed(results):
        yield paragraph(missing)


def _closed(study: Study, said: Presentation, blocks: list[str]) -> str:
    return _details(said.answer.text or study.question, "\n".join(blocks))


def _details(summary: str, content: str) -> str:
    return f"<details><summary>{escape(summary)}</summary>\n{content}</details>"


def _words(said: Presentation) -> Iterator[str]:
    yield from (paragraph(part.text) for part in said.findings)
    if said.notes:
        yield f"<ul>{''.join(f'<li>{escape(note)}</li>' for note in said.notes)}</ul>"


def _figure(run: StoredRun, name: str, caption: str) -> str:
    """The SVG of the run folder, as an image that needs no other file."""
    path = run.folder / "figures" / f"{name}.svg"
    if not path.is_file():
        raise InputError(f"{path}: not part of this folder; expected a run folder of this version of `stiction validate`")
    data = _lean(path.read_text(encoding="utf-8"))
    return (f'<figure><div class="picture" tabindex="0" role="region" aria-label="{escape(name)}"><img alt="{escape(caption)}" loading="lazy" decoding="async" '
            f'src="data:image/svg+xml,{quote(data, safe=UNQUOTED)}"></div><figcaption>{escape(caption)}</figcaption></figure>')


def _lean(svg: str) -> str:
    """The same picture in fewer bytes: positions to a hundredth of a point, the font once, no metadata, no groups of one, no turns by nothing."""
    svg = re.sub(rf"<metadata>.*?</metadata>|<!DOCTYPE[^>]*>| transform=\"rotate\(-?0 [^\"]*\"|{FONT}; ", "", svg, flags=re.S)
    svg = re.sub(r'<g id="[^"]*">', "<g>", svg).replace("</style>", f"text{{{FONT}}}</style>", 1)
    for _ in range(GROUPS):
        svg = re.sub(r"<g>\s*(<text [^>]*>[^<]*</text>|<(?:path|use) [^>]*/>)\s*</g>", r"\1", svg)
    rounded = re.sub(r' (?:d|x|y)="[^"]*"', lambda found: re.sub(r"\.\d{3,}", lambda digits: digits[0][:3], found[0]), svg)
    return re.sub(r"\s+", " ", rounded)


def _table(view: TableView) -> str:
    """All rows and columns; the last cell of a row links to where its numbers come from."""
    cells = [[*row, key] for row, key in zip(view.cells(), keys(view), strict=True)]
    links = [f"#key-{_anchor(key)}" for key in keys(view)]
    return table(view.caption, [*view.heads(), "key"], cells, [*view.right(), False], links)


def _anchor(key: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", key)


def _origin_of(run: StoredRun, key: str) -> str:
    """What `stiction trace` says of a key, in brief: the rows of the data, files and runs."""
    source = resolve(run, key)
    about = [value for what, value in told(run, source) if what in ("data", "file", "key")]
    return f'<p id="key-{_anchor(key)}"><strong>{escape(key)}</strong>: {escape("; ".join(about))}</p>\n'


def _origin(run: StoredRun) -> Iterator[tuple[str, str]]:
    origin = run.origin
    yield "date", origin["date"]
    for part in ("versions", "engines", "machine", "campaign", "choices"):
        yield from ((f"{part}: {name}", str(value)) for name, value in origin[part].items())
    if origin["commit"]:
        yield "commit", origin["commit"]["hash"] + (" with uncommitted changes" if origin["commit"]["dirty"] else "")
