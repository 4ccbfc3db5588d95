"""An HTML page that needs nothing but itself: style, script, plotting library, data and images are in the file.

The plotting library is plotly.js as the installed package ``plotly`` has it: zooming, panning, legends that toggle and hover labels are
not what this project is for, and 4.8 MB more in a file is a fair price for not writing them again.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

CONTENT_SECURITY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
"""What a browser lets the page do: nothing with the network."""

LONG = 40
"""Characters; texts of table cells that are longer are broken into lines."""


@dataclass(frozen=True)
class View:
    """A figure of a chart, and what the chart's selects say where it is shown; with `shared`, a trace's ``meta`` is the index of its x."""

    labels: tuple[str, ...]
    figure: Figure
    shared: Sequence[np.ndarray] = ()


def document(title: str, subtitle: str, sections: Mapping[str, Sequence[str]]) -> str:
    """The page; sections by heading, each of blocks of HTML."""
    from plotly.offline import get_plotlyjs

    here = files("stiction.reports.page")
    names = {heading: re.sub(r"\W+", "-", heading.lower()) for heading in sections}
    links = "".join(f'<a href="#{names[heading]}">{escape(heading)}</a>' for heading in sections)
    body = "\n".join(f'<h2 id="{names[heading]}">{escape(heading)}</h2>\n' + "\n".join(blocks) for heading, blocks in sections.items())
    return "\n".join([
        "<!DOCTYPE html>", '<html lang="en">', "<head>", '<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{CONTENT_SECURITY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">', f"<title>{escape(title)}</title>",
        '<link rel="icon" href="data:,">', f"<style>\n{(here / 'page.css').read_text(encoding='utf-8')}</style>", "</head>", "<body>",
        f"<h1>{escape(title)}</h1>", f'<p class="quiet">{escape(subtitle)}</p>', f"<nav>{links}</nav>", body,
        f"<script>{get_plotlyjs()}</script>", f"<script>\n{(here / 'page.js').read_text(encoding='utf-8')}</script>", "</body>", "</html>", ""])


def chart(name: str, selects: Sequence[str], views: Sequence[View]) -> str:
    """A chart with a select per label of its views and a button that shows all of it again."""
    shown = ",\n".join(f'{{"labels": {json.dumps(view.labels)}, "figure": {view.figure.to_json()}, '
                       f'"shared": {json.dumps([_binary(values) for values in view.shared])}}}' for view in views).replace("</", "<\\/")
    controls = "".join(f"<label>{escape(label)} <select></select></label>" for label in selects)
    return (f'<div class="controls">{controls}<button type="button">Reset zoom</button>'
            '<span class="quiet">Drag to zoom, double-click to reset, click a name to hide or show it.</span></div>\n'
            f'<div class="chart" id="{name}"></div>\n<script type="application/json" id="{name}-data">{{"views": [\n{shown}\n]}}</script>')


def _binary(values: np.ndarray) -> dict[str, str]:
    """An array as plotly.js reads it."""
    return {"dtype": "f8", "bdata": base64.b64encode(values.astype("<f8").tobytes()).decode("ascii")}


def paragraph(text: str) -> str:
    """A paragraph in which ``**a**`` is bold."""
    bold = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", escape(text))
    return f"<p>{bold}</p>"


def table(caption: str, heads: Iterable[str], rows: Iterable[Iterable[str]], right: Sequence[bool], ids: Sequence[str] = (),
          titles: Sequence[str] = ()) -> str:
    """A table of text; `ids` and `titles` (shown on hovering) are those of the last cells of the rows."""
    def cell(kind: str, text: str, numbers: bool, about: str = "") -> str:
        kinds = ' class="number"' if numbers else ' class="long"' if len(text) > LONG else ""
        return f"<{kind}{kinds}{about}>{escape(text)}</{kind}>"

    head = "".join(cell("th", text, numbers) for text, numbers in zip(heads, right))
    lines = []
    for number, row in enumerate(rows):
        texts = list(row)
        about = f' id="{escape(ids[number])}" title="{escape(titles[number])}"' if ids else ""
        lines.append("<tr>" + "".join(cell("td", text, numbers, about if i == len(texts) - 1 else "")
                                      for i, (text, numbers) in enumerate(zip(texts, right))) + "</tr>")
    return (f'<div class="table"><table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>\n<tbody>\n'
            + "\n".join(lines) + "\n</tbody></table></div>")


def image(path: Path, caption: str) -> str:
    """A PNG with its caption."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{data}"><figcaption>{escape(caption)}</figcaption></figure>'
