"""LaTeX of sheets, figures and paragraphs; it needs the packages ``array``, ``booktabs``, ``graphicx``, ``longtable``, ``natbib`` and ``placeins``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib
from matplotlib.ft2font import FT2Font, LoadFlags

from stiction.reports.figures import Drawing
from stiction.reports.paper.sheets import Sheet

TEXT_WIDTH = 174.0
"""mm; both columns of a journal page."""


@dataclass(frozen=True)
class Size:
    """Of the type of a table in a document of 10 points: points of its letters, of what is raised, and from line to line."""

    letters: float
    raised: float
    line: float


SIZES = {"footnotesize": Size(8.0, 6.0, 9.5), "scriptsize": Size(7.0, 5.0, 8.0), "tiny": Size(5.0, 5.0, 6.0)}
"""The first in which a table fits is taken (LaTeX's size10.clo and fontmath.ltx)."""
_WIDER = {8.0: 1.0625, 7.0: 1.139, 6.0: 1.222, 5.0: 1.361}
"""By points: Computer Modern of that size is wider than that of 10 made smaller; digits of cmr5 to cmr8 are 0.681, 0.611, 0.569, 0.531 em."""
_UNKNOWN = 0.8  # em, of a sign that the font does not have
_GAP = 2.2  # mm: what is between two columns
_SPARE = 3.0  # mm: of the width of a table, what adding up single letters may be wrong by: some 0.4 points a column
_MILLIMETRE = 72.27 / 25.4  # points
_PAGE = 200.0  # mm: what a page of 240 holds of a table besides its heading and caption
_SIGN = 0.7778  # em: width of a times and of a minus
_BEHIND_POWER = 0.5  # points: TeX's scriptspace
_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
            "|": r"\textbar{}", "“": "``", "”": "''", "–": "--", "≤": r"$\leq$", "±": r"\textpm{}", "²": "$^2$", **{sign: "\\" + sign for sign in "&%$#_{}"}}
_POWER = re.compile(r"(-?\d+(?:\.\d+)?)e([+-]\d+)")
_BREAK = re.compile(r"\s+|(?<!\de)-")
"""Where a line of text may end; a power of ten stays whole."""
_MARK = re.compile(r"\[(@\w+(?:; @\w+)*|#[^\]\s]+)\]|\*\*(.+?)\*\*")

PAPER = r"""\documentclass[10pt]{article}
\usepackage[a4paper,textwidth=174mm,textheight=240mm]{geometry}
\usepackage[T1]{fontenc}
\usepackage{array,booktabs,graphicx,longtable,placeins}
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


def table(sheet: Sheet) -> str:
    """A ``table*`` with booktabs, over both columns of a page; a ``longtable`` where a page does not hold it."""
    cells, right = sheet.cells(), sheet.right()
    size, measured = widths(sheet)
    height = SIZES[size].line / _MILLIMETRE * sum(_lines(row, measured, SIZES[size]) for row in cells)
    columns = " ".join(f">{{\\raggedright\\arraybackslash}}p{{{width:.1f}mm}}" if width else "r" if numbers else "l"
                       for width, numbers in zip(measured, right))
    heads = " & ".join(_head(words, numbers) for words, numbers in zip(sheet.heads(), right)) + r" \\"
    rows = [" & ".join(map(escape, row)) + r" \\" for row in cells]
    caption = rf"\caption{{{escape(sheet.caption)}}}\label{{tab:{sheet.name}}}"
    style = rf"\{size}\setlength{{\tabcolsep}}{{{_GAP / 2:.1f}mm}}"
    if height > _PAGE:
        lines = [rf"{{{style}", rf"\begin{{longtable}}{{@{{}}{columns}@{{}}}}", caption + r" \\", r"\toprule", heads, r"\midrule",
                 r"\endfirsthead", r"\toprule", heads, r"\midrule", r"\endhead", *rows, r"\bottomrule", r"\end{longtable}}"]
    else:
        lines = [r"\begin{table*}[htbp]", rf"\centering{style}\setlength{{\belowcaptionskip}}{{4pt}}", caption, rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}", r"\toprule",
                 heads, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}", r"\end{table*}"]
    return "\n".join(lines) + "\n"


def figure(drawing: Drawing, starred: bool) -> str:
    """A ``figure``, or over both columns a ``figure*``, of the PDF in its own size."""
    kind = "figure*" if starred else "figure"
    return "\n".join([rf"\begin{{{kind}}}[htbp]", r"\centering", rf"\includegraphics{{figures/{drawing.name}.pdf}}",
                      rf"\caption{{{escape(drawing.caption)}}}\label{{fig:{drawing.name}}}", rf"\end{{{kind}}}"]) + "\n"


def section(title: str, text: str, drawings: Sequence[Drawing], tables: Sequence[Sheet], starred: bool) -> str:
    """A section whose figures and tables stay within it."""
    return "\n".join([rf"\section{{{escape(title)}}}", _paragraph(text), "", *(figure(drawing, starred) for drawing in drawings),
                      *(rf"\input{{tables/{sheet.name}}}" for sheet in tables), r"\FloatBarrier", ""])


def _head(words: list[str], right: bool) -> str:
    below_each_other = r" \\ ".join(f"{{{escape(word)}}}" for word in words)  # braces: "[m]" behind a line break would be its option
    return rf"\shortstack[{'r' if right else 'l'}]{{{below_each_other}}}"


def widths(sheet: Sheet) -> tuple[str, list[float]]:
    """A size of `SIZES`, and by column mm where it is set as paragraphs, 0 elsewhere: so that the table is as wide as the text at most.

    Columns of text give way, down to their longest words, so that what is left is as the roots of their lengths: long texts get more room, and more lines.
    """
    cells, heads, right = [list(column) for column in zip(*sheet.cells())], sheet.heads(), sheet.right()
    whole = [*right[:-1], True]  # numbers, and the key in the last column
    for name, size in SIZES.items():
        head = [max(_millimetres(word, size) for word in words) for words in heads]
        natural = [max(wide, *(_millimetres(text, size) for text in column)) for wide, column in zip(head, cells)]
        least = [wide if unbroken else max(narrow, *(_millimetres(word, size) for text in column for word in _BREAK.split(text)))
                 for wide, narrow, column, unbroken in zip(natural, head, cells, whole)]
        room = TEXT_WIDTH - _SPARE - _GAP * (len(natural) - 1)
        if sum(least) <= room:
            break
    else:
        least = [width * room / sum(least) for width in least]
    chosen, factor = natural, max(natural) ** 0.5
    while sum(chosen) > room * (1 + 1e-9) and factor > 1e-3:
        factor *= 0.98
        chosen = [max(small, min(width, factor * width ** 0.5)) for width, small in zip(natural, least)]
    return name, [0.0 if given >= width else given for given, width in zip(chosen, natural)]


def _lines(row: Sequence[str], widths: Sequence[float], size: Size) -> int:
    """Of a row: of the column of text with most; words fill three quarters of a line."""
    return max([1, *(math.ceil(_millimetres(text, size) / (0.75 * width)) for text, width in zip(row, widths) if width and text)])


def _millimetres(text: str, size: Size) -> float:
    """Width of a text in Computer Modern."""
    powers = _POWER.findall(text)
    letters = sum(map(_advance, _POWER.sub(r"\g<1>10", text))) + _SIGN * len(powers)
    raised = sum(_SIGN * (exponent < 0) + sum(map(_advance, str(abs(exponent)))) for exponent in (int(digits) for _, digits in powers))
    points = sum(ems * points * _WIDER[points] for ems, points in ((letters, size.letters), (raised, size.raised)))
    return (points + _BEHIND_POWER * len(powers)) / _MILLIMETRE


@cache
def _advance(sign: str) -> float:
    font = FT2Font(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "cmr10.ttf"))
    if not font.get_char_index(ord(sign)):
        return _UNKNOWN
    font.set_size(100, 72)
    return font.load_char(ord(sign), flags=LoadFlags.NO_HINTING).linearHoriAdvance / 65536 / 100
