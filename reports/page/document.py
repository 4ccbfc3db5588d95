"""The parts of a page that needs nothing but itself: charts and tables, in sections.

Charts are drawn by ``chart.js`` on canvases, mechanisms by ``player.js`` of `stiction.scenes.pictures`; their numbers
are compressed columns that the browser reads when they are first shown.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from markdown_it import MarkdownIt

from stiction.scenes.pictures import web

LONG = 40
"""Characters; texts of table cells that are longer are broken into lines."""


@dataclass(frozen=True)
class View:
    """A chart of some labels: ``{x, modes, series, shades, film?}`` as the class ``Chart`` of ``chart.js`` reads it."""

    labels: tuple[str, ...]
    content: Mapping[str, Any]
    columns: web.Columns


def document(title: str, subtitle: str, sections: Mapping[str, Sequence[str]]) -> str:
    """Write the page; sections by heading, each of blocks of HTML."""
    names = {heading: re.sub(r"\W+", "-", heading.lower()).strip("-") for heading in sections}
    links = "".join(f'<a href="#{names[heading]}">{escape(heading)}</a>' for heading in sections)
    parts = (
        f'<section aria-labelledby="{names[heading]}"><h2 id="{names[heading]}">{escape(heading)}</h2>\n'
        + "\n".join(blocks)
        + "</section>"
        for heading, blocks in sections.items()
    )
    body = (
        f'<header><h1>{escape(title)}</h1>\n<p class="quiet">{escape(subtitle)}</p>\n'
        f'<nav aria-label="Sections">{links}</nav></header>\n<main>\n'
        + "\n".join(parts)
        + "\n</main>"
    )
    here = files("stiction.reports.page")
    css, *own = [
        (here / name).read_text(encoding="utf-8") for name in ("page.css", "chart.js", "page.js")
    ]
    scripts = [web.asset("data.js"), web.asset("player.js"), *own]
    return web.document(title, body, [web.asset("player.css"), css], scripts)


def chart(name: str, selects: Sequence[str], views: Sequence[View], hint: str) -> str:
    """Write a chart with a select per label of its views; what comes first is shown first.

    Where the views have several modes or a film, there are selects for modes and runs, and a mechanism.
    """
    film = all("film" in view.content for view in views)
    modes = any(len(view.content["modes"]) > 1 for view in views)
    kinds = (
        [(label, "label") for label in selects]
        + [("Show", "mode")] * modes
        + [("Mechanism of", "run")] * film
    )
    controls = [
        f'<label>{escape(words)} <select class="{kind}"></select></label>' for words, kind in kinds
    ]
    controls += [
        f'<button type="button" class="{kind}" aria-label="{words}">{sign}</button>'
        for kind, words, sign in (
            ("closer", "Zoom in", "+"),
            ("wider", "Zoom out", "−"),
            ("reset", "Reset zoom", "Reset zoom"),
        )
    ]
    shape = " with-film" if film else "" if modes else " tall"
    data = [
        web.data(
            f'data-labels="{escape(json.dumps(view.labels))}"',
            {**view.content, "block": view.columns.packed()},
        )
        for view in views
    ]
    return (
        f'<div class="board" id="{name}" tabindex="0" role="group" '
        f'aria-label="{escape(name.replace("-", " "))}, interactive">'
        f'<div class="controls">{"".join(controls)}</div>\n<p class="quiet">{escape(hint)}</p>\n'
        '<details open><summary>Lines</summary><div class="legend"></div></details>\n'
        f'<div class="split{shape}"><div class="panels"></div>{web.film_controls() if film else ""}</div>\n'
        '<div class="said" aria-live="polite"></div>\n' + "\n".join(data) + "</div>"
    )


@cache
def _converter() -> MarkdownIt:
    return MarkdownIt("commonmark", {"html": False})


def markdown(text: str) -> str:
    """Convert Markdown of a template to HTML; signs that HTML would take for its own are escaped."""
    return str(_converter().render(text))


def link(text: str, target: str) -> str:
    """Write a paragraph that leads to a file beside the page."""
    return f'<p><a href="{escape(target)}">{escape(text)}</a></p>'


def details(summary: str, content: str) -> str:
    """Write a block that is closed until it is opened."""
    return f"<details><summary>{escape(summary)}</summary>\n{content}</details>"


def table(
    caption: str,
    heads: Iterable[str],
    rows: Iterable[Iterable[str]],
    right: Sequence[bool],
    links: Sequence[str] = (),
    linked: int = -1,
) -> str:
    """Write a table of text; `links`: where the cell of the column `linked` leads in each row, empty for nowhere."""

    def cell(kind: str, text: str, number: bool, scope: str = "", link: str = "") -> str:
        kinds = " class=n" if number else ' class="long"' if len(text) > LONG else ""
        shown = f'<a href="{escape(link)}">{escape(text)}</a>' if link else escape(text)
        return f"<{kind}{kinds}{scope}>{shown}</{kind}>"

    head = "".join(cell("th", text, number, ' scope="col"') for text, number in zip(heads, right))
    lines = []
    for place, row in enumerate(rows):
        texts = list(row)
        targets = [""] * len(texts)
        targets[linked] = links[place] if links else ""
        cells = [
            cell("td", text, number, link=target)
            for text, number, target in zip(texts, right, targets)
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    label = escape(caption)
    return (
        f'<div class="table" tabindex="0" role="region" aria-label="{label}"><table>'
        f"<caption><span>{label}</span></caption><thead><tr>{head}</tr></thead>\n<tbody>\n"
        + "\n".join(lines)
        + "\n</tbody></table></div>"
    )
