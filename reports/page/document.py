"""HTML of a page in a single file: sections with charts, tables and text.

``chart.js`` draws charts on canvases, and ``player.js`` of `stiction.scenes.pictures` draws mechanisms. The
page contains their numbers as compressed columns, which the browser reads when they are first shown.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from markdown_it import MarkdownIt

from stiction.scenes.pictures import web

MAX_UNBROKEN_TEXT = 40
"""Largest number of characters of a table cell that is not broken into lines."""
ZOOM_BUTTONS = (
    ("closer", "Zoom in", "+"),
    ("wider", "Zoom out", "−"),
    ("reset", "Reset zoom", "Reset zoom"),
)
"""Class, label for screen readers, and text of the buttons of a chart."""


@dataclass(frozen=True)
class View:
    """Content of a chart for one choice in its select boxes.

    Attributes
    ----------
    labels : tuple of str
        The choice in each select box.
    content : mapping
        ``{x, modes, series, shades, film?}``, which the class ``Chart`` of ``chart.js`` reads.
    columns : Columns
        The numbers, to whose positions `content` refers.
    """

    labels: tuple[str, ...]
    content: Mapping[str, Any]
    columns: web.Columns


def document(title: str, subtitle: str, sections: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Return the HTML of a page.

    Parameters
    ----------
    title, subtitle : str
        Heading of the page, and the line below it.
    sections : iterable of (str, sequence of str)
        The heading of each section, and its blocks of HTML. Sections may have equal headings.
    """
    links = []
    parts = []
    times_used = Counter[str]()
    for heading, blocks in sections:
        anchor = re.sub(r"\W+", "-", heading.lower()).strip("-")
        # Identifiers are unique in a page: the second section with the same one gets the suffix -2.
        times_used[anchor] += 1
        if times_used[anchor] > 1:
            anchor = f"{anchor}-{times_used[anchor]}"
        label = escape(heading)
        content = "\n".join(blocks)
        links.append(f'<a href="#{anchor}">{label}</a>')
        parts.append(
            f'<section aria-labelledby="{anchor}"><h2 id="{anchor}">{label}</h2>\n{content}</section>'
        )
    body = (
        f'<header><h1>{escape(title)}</h1>\n<p class="quiet">{escape(subtitle)}</p>\n'
        f'<nav aria-label="Sections">{"".join(links)}</nav></header>\n<main>\n'
        + "\n".join(parts)
        + "\n</main>"
    )
    styles = [web.asset("player.css"), _asset("page.css")]
    # The order matters: each script uses the classes of those before it.
    scripts = [
        web.asset("data.js"),
        web.asset("player.js"),
        _asset("chart.js"),
        _asset("page.js"),
    ]
    return web.document(title, body, styles, scripts)


def _asset(name: str) -> str:
    """Return the text of a style sheet or script of this package."""
    return (files("stiction.reports.page") / name).read_text(encoding="utf-8")


def chart(name: str, selects: Sequence[str], views: Sequence[View], hint: str) -> str:
    """Return the HTML of a chart with select boxes. The first view is shown at first.

    Parameters
    ----------
    name : str
        Identifier of the chart in the page.
    selects : sequence of str
        Label of the select box for each entry of `View.labels`. If views have several modes or a film,
        select boxes for the mode and for the run in the film are added.
    views : sequence of View
        The contents, one for each combination of choices.
    hint : str
        How to use the chart.
    """
    has_film = all("film" in view.content for view in views)
    has_modes = any(len(view.content["modes"]) > 1 for view in views)
    boxes = [(label, "label") for label in selects]
    if has_modes:
        boxes.append(("Show", "mode"))
    if has_film:
        boxes.append(("Mechanism of", "run"))
    controls = [
        f'<label>{escape(label)} <select class="{kind}"></select></label>' for label, kind in boxes
    ]
    for kind, label, text in ZOOM_BUTTONS:
        controls.append(
            f'<button type="button" class="{kind}" aria-label="{label}">{text}</button>'
        )
    shape = "" if has_modes else " tall"
    if has_film:
        shape = " with-film"
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
        f'<div class="split{shape}"><div class="panels"></div>'
        f"{web.film_controls() if has_film else ''}</div>\n"
        '<div class="said" aria-live="polite"></div>\n' + "\n".join(data) + "</div>"
    )


@cache
def _converter() -> MarkdownIt:
    """Return a converter from Markdown to HTML, which escapes HTML in the Markdown."""
    return MarkdownIt("commonmark", {"html": False})


def markdown(text: str) -> str:
    """Return the HTML of a text in Markdown."""
    return str(_converter().render(text))


def link(text: str, target: str) -> str:
    """Return a paragraph that consists of a link."""
    return f'<p><a href="{escape(target)}">{escape(text)}</a></p>'


def details(summary: str, content: str) -> str:
    """Return a block that shows its summary, and its content when it is opened."""
    return f"<details><summary>{escape(summary)}</summary>\n{content}</details>"


def table(
    caption: str,
    heads: Iterable[str],
    rows: Iterable[Iterable[str]],
    right: Sequence[bool],
    links: Sequence[str] = (),
    linked_column: int = -1,
) -> str:
    """Return the HTML of a table.

    Parameters
    ----------
    caption : str
        Text above the table.
    heads, rows : iterables of str
        The heading of each column, and the cells of each row.
    right : sequence of bool
        Whether each column is aligned to the right, as numbers are.
    links : sequence of str
        Target of a link in each row; empty for a row without one.
    linked_column : int
        Column whose cells are the links.
    """
    head = "".join(
        f'<th{_cell_class(text, is_right)} scope="col">{escape(text)}</th>'
        for text, is_right in zip(heads, right)
    )
    lines = []
    for number, row in enumerate(rows):
        texts = list(row)
        contents = [escape(text) for text in texts]
        if links and links[number]:
            contents[linked_column] = (
                f'<a href="{escape(links[number])}">{contents[linked_column]}</a>'
            )
        cells = [
            f"<td{_cell_class(text, is_right)}>{content}</td>"
            for text, content, is_right in zip(texts, contents, right)
        ]
        lines.append(f"<tr>{''.join(cells)}</tr>")
    label = escape(caption)
    return (
        f'<div class="table" tabindex="0" role="region" aria-label="{label}"><table>'
        f"<caption><span>{label}</span></caption><thead><tr>{head}</tr></thead>\n<tbody>\n"
        + "\n".join(lines)
        + "\n</tbody></table></div>"
    )


def _cell_class(text: str, is_right: bool) -> str:
    """Return the class attribute of a table cell: ``n`` for numbers, ``long`` for text that may be broken."""
    if is_right:
        return " class=n"
    return ' class="long"' if len(text) > MAX_UNBROKEN_TEXT else ""
