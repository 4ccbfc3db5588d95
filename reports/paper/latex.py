"""LaTeX of tables, figures and paragraphs; it needs the packages ``array``, ``booktabs``, ``graphicx``, ``tabularx``, ``xltabular``, ``natbib`` and ``placeins``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from stiction.comparisons.presentation.table_view import TableView
from stiction.reports.figures.style import Drawing

LONGEST, SHORT, PAGE_SIGNS = 45, 24, 118
"""Rows of a table on one page; signs of a cell that is not broken; and of a line of 174 mm in type of 7 points."""

_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
            "|": r"\textbar{}", "“": "``", "”": "''", "–": "--", "≤": r"$\leq$", "±": r"\textpm{}", "²": "$^2$", **{sign: "\\" + sign for sign in "&%$#_{}"}}
_POWER = re.compile(r"(-?\d+(?:\.\d+)?)e([+-]\d+)")
_MARK = re.compile(r"\[(@\w+(?:; @\w+)*|#[^\]\s]+)\]|\*\*(.+?)\*\*")

PAPER = r"""\documentclass[10pt]{article}
\usepackage[a4paper,textwidth=174mm,textheight=240mm]{geometry}
\usepackage[T1]{fontenc}
\usepackage{array,booktabs,graphicx,tabularx,xltabular,placeins}
\usepackage[numbers,sort&compress]{natbib}
\usepackage[hidelinks]{hyperref}
\setlength{\emergencystretch}{3em}
\begin{document}
\title{%(title)s}
\author{%(authors)s}
\date{%(date)s}
\maketitle
\section{Results}
%(results)s
\section{Methods}
\input{methods}
\section{Where a number comes from}
%(tracing)s
%(sections)s
\bibliographystyle{unsrtnat}
\bibliography{references}
\end{document}
"""


def quoted(text: str) -> str:
    """The text with quotation marks that open and close in place of straight ones."""
    return re.sub(r'(^|[\s(\[])"', r"\1“", text).replace('"', "”")


def escape(text: str) -> str:
    """Text that LaTeX prints as it is; ``m/s^2`` and powers of ten become mathematics."""
    text = quoted(text).replace("s^2", "s²")
    return _POWER.sub(lambda match: rf"${match[1]}{{\times}}10^{{{int(match[2])}}}$", "".join(_SPECIAL.get(sign, sign) for sign in text))


def paragraphs(texts: Iterable[str]) -> str:
    """Paragraphs with ``[@key; @key]`` as citations, ``[#fig:name]`` as numbers of figures and tables, ``**a**`` bold."""
    return "\n\n".join(map(_paragraph, texts)) + "\n"


def _paragraph(text: str) -> str:
    pieces, end, text = [], 0, quoted(text)
    for match in _MARK.finditer(text):
        pieces.append(escape(text[end:match.start()]))
        end = match.end()
        if match[2]:
            pieces.append(rf"\textbf{{{escape(match[2])}}}")
        elif match[1].startswith("#"):
            pieces.append(rf"\ref{{{match[1][1:]}}}")
        else:
            pieces.append(rf"\cite{{{match[1].replace('@', '').replace('; ', ',')}}}")
    return re.sub(r" \\(cite|ref)\b", r"~\\\1", "".join([*pieces, escape(text[end:])]))


def results(lines: Sequence[str]) -> str:
    """A numbered list."""
    return "\n".join([r"\begin{enumerate}", *(rf"\item {_paragraph(line)}" for line in lines), r"\end{enumerate}"]) if lines else ""


@dataclass(frozen=True)
class Layout:
    """A table in print: headings and rows of text, the key last; which columns stand to the right, and which share the room as words."""

    heads: list[str]
    rows: list[list[str]]
    right: list[bool]
    wide: list[bool]


def laid_out(view: TableView, keys: Sequence[str]) -> Layout:
    """The columns for which a page has room."""
    brief = is_brief(view)
    rows = [[*row, key] for row, key in zip(view.cells(brief), keys, strict=True)]
    right = [*view.right(brief), False]
    wide = [not numbers and max((len(row[i]) for row in rows), default=0) > SHORT for i, numbers in enumerate(right)]
    return Layout([*view.heads(brief), "key"], rows, right, wide)


def table(view: TableView, keys: Sequence[str]) -> str:
    """A ``table*`` with booktabs, as wide as the text: words in columns that share the room, numbers to the right, the keys last.

    One of more than `LONGEST` rows breaks over pages, its heading repeated.
    """
    layout = laid_out(view, keys)
    kinds = "".join(">{\\raggedright\\arraybackslash}X" if wide else "r" if numbers else "l" for wide, numbers in zip(layout.wide, layout.right))
    line = [" & ".join(map(escape, row)) + r" \\" for row in (layout.heads, *layout.rows)]
    caption = rf"\caption{{{escape(view.caption)}}}\label{{tab:{view.name}}}"
    spread = "@{\\extracolsep{\\fill}}" if not any(layout.wide) else ""
    if len(layout.rows) > LONGEST:
        return "\n".join([r"{\scriptsize\setlength{\tabcolsep}{3pt}", rf"\begin{{xltabular}}{{\textwidth}}{{@{{}}{spread}{kinds}@{{}}}}", caption + r" \\", r"\toprule", line[0],
                          r"\midrule", r"\endfirsthead", r"\toprule", line[0], r"\midrule", r"\endhead", *line[1:], r"\bottomrule", r"\end{xltabular}}"]) + "\n"
    return "\n".join([r"\begin{table*}[htbp]", r"\centering\scriptsize\setlength{\tabcolsep}{3pt}", caption, rf"\begin{{tabularx}}{{\textwidth}}{{@{{}}{spread}{kinds}@{{}}}}",
                      r"\toprule", line[0], r"\midrule", *line[1:], r"\bottomrule", r"\end{tabularx}", r"\end{table*}"]) + "\n"


def is_brief(view: TableView) -> bool:
    """Whether a page has room for the brief columns of a table only; words may break, so that no column counts for more than `SHORT` signs."""
    columns = zip(view.heads(), *view.cells())
    return sum(min(SHORT, max(map(len, column))) for column in columns) > PAGE_SIGNS


def figure(drawing: Drawing, starred: bool) -> str:
    """A ``figure``, or over both columns a ``figure*``, of the PDF in its own size."""
    kind = "figure*" if starred else "figure"
    return "\n".join([rf"\begin{{{kind}}}[htbp]", r"\centering", rf"\includegraphics{{figures/{drawing.name}.pdf}}",
                      rf"\caption{{{escape(drawing.caption)}}}\label{{fig:{drawing.name}}}", rf"\end{{{kind}}}"]) + "\n"


def section(title: str, text: str, drawings: Sequence[Drawing], tables: Sequence[TableView], starred: bool) -> str:
    """A section whose figures and tables stay within it."""
    return "\n".join([rf"\section{{{escape(title)}}}", _paragraph(text), "", *(figure(drawing, starred) for drawing in drawings),
                      *(rf"\input{{tables/{view.name}}}" for view in tables), r"\FloatBarrier", ""])
