"""LaTeX of sheets, figures and paragraphs; it needs the packages ``array``, ``booktabs`` and ``graphicx``."""

from __future__ import annotations

import re
from collections.abc import Iterable

from reports.figures import Drawing
from reports.paper.sheets import Sheet

TEXT_WIDTH = 174.0
"""mm; both columns of a journal page."""
_CHARACTER, _GAP = 1.65, 2.2  # mm: width of a digit in \\footnotesize and a little, and what is between two columns
_LINES = (36, 30, 24, 18, 12)  # characters, beyond which a column is set as paragraphs: the first that leaves each of them enough
_PARAGRAPH = 22.0  # mm
_LONG_TABLE = 45  # rows; what a page holds
_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
            "|": r"\textbar{}", '"': "''", "–": "--", "±": r"\textpm{}", "²": "$^2$", **{sign: "\\" + sign for sign in "&%$#_{}"}}
_POWER = re.compile(r"(-?\d+(?:\.\d+)?)e([+-]\d+)")
_CITE = re.compile(r"\[((?:@\w+(?:; )?)+)\]")

PAPER = r"""\documentclass[10pt]{article}
\usepackage[a4paper,textwidth=174mm,textheight=240mm]{geometry}
\usepackage[T1]{fontenc}
\usepackage{array,booktabs,graphicx,longtable}
\usepackage[hidelinks]{hyperref}
\begin{document}
\title{%(title)s}
\date{%(date)s}
\maketitle
\input{methods}
%(figures)s
%(tables)s
\bibliographystyle{plain}
\bibliography{references}
\end{document}
"""


def escape(text: str) -> str:
    """Text that LaTeX prints as it is; ``m/s^2`` and powers of ten become mathematics."""
    text = text.replace("s^2", "s²")
    return _POWER.sub(lambda match: rf"${match[1]}\times10^{{{int(match[2])}}}$", "".join(_SPECIAL.get(sign, sign) for sign in text))


def paragraphs(texts: Iterable[str]) -> str:
    """Paragraphs with ``[@key; @key]`` as citations."""
    parts = []
    for text in texts:
        pieces, end = [], 0
        for match in _CITE.finditer(text):
            pieces += [escape(text[end:match.start()]), rf"\cite{{{match[1].replace('@', '').replace('; ', ',')}}}"]
            end = match.end()
        parts.append("".join([*pieces, escape(text[end:])]).replace(r" \cite", r"~\cite"))
    return "\n\n".join(parts) + "\n"


def table(sheet: Sheet) -> str:
    """A ``table*`` with booktabs, over both columns of a page; a ``longtable`` where a page does not hold it."""
    cells, right = sheet.cells(), sheet.right()
    columns = " ".join(f">{{\\raggedright\\arraybackslash}}p{{{width:.0f}mm}}" if width else "r" if numbers else "l"
                       for width, numbers in zip(widths(sheet), right))
    heads = " & ".join(_head(words, numbers) for words, numbers in zip(sheet.heads(), right)) + r" \\"
    rows = [" & ".join(map(escape, row)) + r" \\" for row in cells]
    caption = rf"\caption{{{escape(sheet.caption)}}}\label{{tab:{sheet.name}}}"
    if len(rows) > _LONG_TABLE:
        lines = [r"{\footnotesize\setlength{\tabcolsep}{3pt}", rf"\begin{{longtable}}{{{columns}}}", caption + r" \\", r"\toprule", heads, r"\midrule",
                 r"\endhead", *rows, r"\bottomrule", r"\end{longtable}}"]
    else:
        lines = [r"\begin{table*}[tbp]", r"\centering\footnotesize\setlength{\tabcolsep}{3pt}\setlength{\belowcaptionskip}{4pt}", caption, rf"\begin{{tabular}}{{{columns}}}", r"\toprule",
                 heads, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}", r"\end{table*}"]
    return "\n".join(lines) + "\n"


def figure(drawing: Drawing, starred: bool) -> str:
    """A ``figure``, or over both columns a ``figure*``, of the PDF in its own size."""
    kind = "figure*" if starred else "figure"
    return "\n".join([rf"\begin{{{kind}}}[tbp]", r"\centering", rf"\includegraphics{{figures/{drawing.name}.pdf}}",
                      rf"\caption{{{escape(drawing.caption)}}}\label{{fig:{drawing.name}}}", rf"\end{{{kind}}}"]) + "\n"


def _head(words: list[str], right: bool) -> str:
    below_each_other = r" \\ ".join(f"{{{escape(word)}}}" for word in words)  # braces: "[m]" behind a line break would be its option
    return rf"\shortstack[{'r' if right else 'l'}]{{{below_each_other}}}"


def widths(sheet: Sheet) -> list[float]:
    """mm of the columns that are set as paragraphs, the longest first until the table has room; 0 for the others."""
    cells = sheet.cells()
    lengths = [max(len(_POWER.sub(r"\1x10-1", row[i])) for row in cells) for i in range(len(sheet.heads()))]
    heads = [max(map(len, words)) for words in sheet.heads()]
    for most in _LINES:
        room = TEXT_WIDTH - sum(_CHARACTER * max(length, head) for length, head in zip(lengths, heads) if length <= most) - _GAP * len(lengths)
        long = [length ** 0.5 for length in lengths if length > most]
        if room >= _PARAGRAPH * len(long):
            break
    return [room * length ** 0.5 / sum(long) if length > most else 0.0 for length in lengths]
