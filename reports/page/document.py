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


@dataclass(frozen=True)
class Link:
    """A link in a cell or heading of a table.

    Attributes
    ----------
    text, target : str
        Text and address of the link.
    title : str
        What a browser shows beside the pointer; empty for nothing.
    """

    text: str
    target: str
    title: str = ""


@dataclass(frozen=True)
class Abbreviation:
    """A text in a cell that is short for another one.

    Attributes
    ----------
    text, title : str
        The short text, and the full one, which a browser shows beside the pointer.
    """

    text: str
    title: str


Cell = str | Link | Abbreviation
"""Content of a cell of a table."""


@dataclass(frozen=True)
class Sections:
    """The HTML of the sections of a page.

    Attributes
    ----------
    links : str
        A link to each section.
    content : str
        The sections.
    """

    links: str
    content: str


def sections_html(sections: Iterable[tuple[str, Sequence[str]]]) -> Sections:
    """Return the HTML of sections.

    Parameters
    ----------
    sections : iterable of (str, sequence of str)
        The heading of each section, and its blocks of HTML. Sections may have equal headings.
    """
    links = []
    parts = []
    times_used = Counter[str]()
    for heading, blocks in sections:
        anchor = anchor_of(heading.lower())
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
    return Sections("".join(links), "\n".join(parts))


def anchor_of(text: str) -> str:
    """Return a text as a part of an identifier in a page: words joined by hyphens."""
    return re.sub(r"\W+", "-", text).strip("-")


def unique_anchor(text: str) -> str:
    """Return a text as an identifier or name of a file, different for different texts.

    Characters other than letters, digits, ``_``, ``-`` and ``.`` become ``~`` with their code in hexadecimal
    digits, and a second ``~``.
    """
    return re.sub(r"[^\w.-]", lambda match: f"~{ord(match[0]):x}~", text)


def document(title: str, subtitle: str, sections: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Return the HTML of a page.

    Parameters
    ----------
    title, subtitle : str
        Heading of the page, and the line below it.
    sections : iterable of (str, sequence of str)
        As for `sections_html`.
    """
    html = sections_html(sections)
    body = (
        f'<header><h1>{escape(title)}</h1>\n<p class="quiet">{escape(subtitle)}</p>\n'
        f'<nav aria-label="Sections">{html.links}</nav></header>\n<main>\n{html.content}\n</main>'
    )
    return with_scripts(title, body)


def with_scripts(title: str, body: str, *styles: str) -> str:
    """Return the HTML document with a body, the scripts of charts, and style sheets in addition to that of pages."""
    # The order matters: each script uses the classes of those before it.
    scripts = [
        web.asset("data.js"),
        web.asset("player.js"),
        _asset("chart.js"),
        _asset("page.js"),
    ]
    return web.document(
        title, body, [web.asset("player.css"), _asset("page.css"), *styles], scripts
    )


def _asset(name: str) -> str:
    """Return the text of a style sheet or script of this package."""
    return (files("stiction.reports.page") / name).read_text(encoding="utf-8")


def chart(name: str, selects: Sequence[str], views: Sequence[View], hint: str) -> str:
    """Return the HTML of a chart with select boxes. The first view is shown at first.

    Parameters
    ----------
    name : str
        Name of the chart, unique in the page.
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
        f'<div class="board" id="chart-{name}" tabindex="0" role="group" '
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


def details(summary: str, content: str, is_open: bool = False) -> str:
    """Return a block that shows its summary, and its content when it is opened; at first if `is_open`."""
    tag = "<details open>" if is_open else "<details>"
    return f"{tag}<summary>{escape(summary)}</summary>\n{content}</details>"


def table(
    caption: str,
    heads: Iterable[Cell],
    rows: Iterable[Sequence[Cell]],
    right: Sequence[bool],
    row_ids: Sequence[str] = (),
) -> str:
    """Return the HTML of a table.

    Parameters
    ----------
    caption : str
        Text above the table.
    heads : iterable of str or Link
        The heading of each column.
    rows : iterable of sequence of str or Link
        The cells of each row. A row with a single cell in a table of several columns is the heading of the
        rows below it.
    right : sequence of bool
        Whether each column is aligned to the right, as numbers are.
    row_ids : sequence of str
        Identifier of each row in the page, to which links lead; empty for a row without one.
    """
    head = "".join(
        f'<th{_cell_class(_text_of(cell), is_right)} scope="col">{_cell_html(cell)}</th>'
        for cell, is_right in zip(heads, right)
    )
    lines = []
    for number, row in enumerate(rows):
        identifier = f' id="{escape(row_ids[number])}"' if row_ids and row_ids[number] else ""
        if len(row) == 1 < len(right):
            content = _cell_html(row[0])
            lines.append(
                f'<tr{identifier} class="group"><th scope="rowgroup" colspan="{len(right)}">'
                f"{content}</th></tr>"
            )
            continue
        cells = [
            f"<td{_cell_class(_text_of(cell), is_right)}>{_cell_html(cell)}</td>"
            for cell, is_right in zip(row, right)
        ]
        lines.append(f"<tr{identifier}>{''.join(cells)}</tr>")
    label = escape(caption)
    return (
        f'<div class="table" tabindex="0" role="region" aria-label="{label}"><table>'
        f"<caption><span>{label}</span></caption><thead><tr>{head}</tr></thead>\n<tbody>\n"
        + "\n".join(lines)
        + "\n</tbody></table></div>"
    )


def _text_of(cell: Cell) -> str:
    """Return the text of a cell."""
    return cell if isinstance(cell, str) else cell.text


def _cell_html(cell: Cell) -> str:
    """Return the HTML of the content of a cell."""
    if isinstance(cell, str):
        return escape(cell)
    if isinstance(cell, Abbreviation):
        return f'<abbr title="{escape(cell.title)}">{escape(cell.text)}</abbr>'
    title = f' title="{escape(cell.title)}"' if cell.title else ""
    return f'<a href="{escape(cell.target)}"{title}>{escape(cell.text)}</a>'


def _cell_class(text: str, is_right: bool) -> str:
    """Return the class attribute of a table cell: ``n`` for numbers, ``long`` for text that may be broken."""
    if is_right:
        return " class=n"
    return ' class="long"' if len(text) > MAX_UNBROKEN_TEXT else ""
