"""The parts of a page that needs nothing but itself: charts and tables, in sections.

Charts are drawn by ``chart.js`` on canvases, mechanisms by ``player.js`` of `stiction.scenes.pictures`; their numbers are compressed columns
that the browser reads when they are first shown.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from typing import Any

from stiction.scenes.pictures import web

LONG = 40
"""Characters; texts of table cells that are longer are broken into lines."""


@dataclass(frozen=True)
class View:
    """What a chart shows where its selects say so: ``{x, modes, series, shades, film?}`` as the class ``Chart`` of ``chart.js`` reads it."""

    labels: tuple[str, ...]
    content: Mapping[str, Any]
    columns: web.Columns


def document(title: str, subtitle: str, sections: Mapping[str, Sequence[str]]) -> str:
    """The page; sections by heading, each of blocks of HTML."""
    here = files("stiction.reports.page")
    names = {heading: re.sub(r"\W+", "-", heading.lower()).strip("-") for heading in sections}
    links = "".join(f'<a href="#{names[heading]}">{escape(heading)}</a>' for heading in sections)
    parts = (f'<section aria-labelledby="{names[heading]}"><h2 id="{names[heading]}">{escape(heading)}</h2>\n' + "\n".join(blocks) + "</section>"
             for heading, blocks in sections.items())
    body = (f'<header><h1>{escape(title)}</h1>\n<p class="quiet">{escape(subtitle)}</p>\n<nav aria-label="Sections">{links}</nav></header>\n<main>\n'
            + "\n".join(parts) + "\n</main>")
    own = [(here / name).read_text(encoding="utf-8") for name in ("page.css", "chart.js", "page.js")]
    return web.document(title, body, [web.asset("player.css"), own[0]], [web.asset("data.js"), web.asset("player.js"), *own[1:]])


def chart(name: str, selects: Sequence[str], views: Sequence[View], hint: str) -> str:
    """A chart with a select per label of its views; with those for its modes and runs, and a mechanism, where the views have a film.

    What comes first is shown first.
    """
    film, modes = all("film" in view.content for view in views), any(len(view.content["modes"]) > 1 for view in views)
    controls = [f'<label>{escape(label)} <select class="label"></select></label>' for label in selects]
    controls += [f'<label>{words} <select class="{kind}"></select></label>' for words, kind, there in (("Show", "mode", modes), ("Mechanism of", "run", film)) if there]
    controls += [f'<button type="button" class="{kind}" aria-label="{words}">{sign}</button>' for kind, words, sign in
                 (("closer", "Zoom in", "+"), ("wider", "Zoom out", "−"), ("reset", "Reset zoom", "Reset zoom"))]
    shown = "\n".join(_view(view) for view in views)
    return (f'<div class="board" id="{name}" tabindex="0" role="group" aria-label="{escape(name.replace("-", " "))}, interactive">'
            f'<div class="controls">{"".join(controls)}</div>\n<p class="quiet">{escape(hint)}</p>\n'
            f'<details open><summary>Lines</summary><div class="legend"></div></details>\n'
            f'<div class="split{" with-film" if film else "" if modes else " tall"}"><div class="panels"></div>{web.film_controls() if film else ""}</div>\n'
            f'<div class="said" aria-live="polite"></div>\n{shown}</div>')


def _view(view: View) -> str:
    text = json.dumps({**view.content, "block": view.columns.packed()}, ensure_ascii=False).replace("</", "<\\/")
    return f'<script type="application/json" data-labels="{escape(json.dumps(view.labels))}">{text}</script>'


def paragraph(text: str) -> str:
    """A paragraph in which ``**a**`` is bold."""
    bold = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", escape(text))
    return f"<p>{bold}</p>"


def table(caption: str, heads: Iterable[str], rows: Iterable[Iterable[str]], right: Sequence[bool], links: Sequence[str] = ()) -> str:
    """A table of text; `links`: where the last cell of each row leads."""
    def cell(kind: str, text: str, numbers: bool, about: str = "", link: str = "") -> str:
        kinds = ' class="number"' if numbers else ' class="long"' if len(text) > LONG else ""
        shown = f'<a href="{escape(link)}">{escape(text)}</a>' if link else escape(text)
        return f"<{kind}{kinds}{about}>{shown}</{kind}>"

    head = "".join(cell("th", text, numbers, ' scope="col"') for text, numbers in zip(heads, right))
    lines = []
    for number, row in enumerate(rows):
        *texts, last = row
        body = [cell("td", text, numbers) for text, numbers in zip(texts, right)]
        lines.append(f"<tr>{''.join(body)}{cell('td', last, right[-1], link=links[number] if links else '')}</tr>")
    return (f'<div class="table" tabindex="0" role="region" aria-label="{escape(caption)}"><table><caption><span>{escape(caption)}</span></caption>'
            f'<thead><tr>{head}</tr></thead>\n<tbody>\n' + "\n".join(lines) + "\n</tbody></table></div>")
