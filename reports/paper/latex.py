"""LaTeX of the content of a paper: what `stiction.reports.paper.folder.paper_content` returns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

LONGEST = 45
"""Rows of a table on one page."""
_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
            ">": r"\textgreater{}", "|": r"\textbar{}", "“": "``", "”": "''", "–": "--", "≤": r"$\leq$",
            "±": r"\textpm{}", "²": "$^2$", **{sign: "\\" + sign for sign in "&%$#_{}"}}
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
    """Set quotation marks that open and close in place of straight ones."""
    return re.sub(r'(^|[\s(\[])"', r"\1“", text).replace('"', "”")


def escape(text: str) -> str:
    """Write text that LaTeX prints as it is; ``m/s^2`` and powers of ten become mathematics."""
    signs = "".join(_SPECIAL.get(sign, sign) for sign in quoted(text).replace("s^2", "s²"))
    return _POWER.sub(lambda match: rf"${match[1]}{{\times}}10^{{{int(match[2])}}}$", signs)


def paper(content: Mapping[str, Any]) -> str:
    """Write the text of ``paper.tex``."""
    starred = content["columns"] == 1
    summary = "\n".join(rf"\item {_paragraph(line)}" for line in content["summary"])
    authors = escape(" and ".join(content["authors"])).replace(" and ", r" \and ")
    return PAPER % {
        "title": escape(content["title"]), "authors": authors,
        "date": "{year}-{month:02}-{day:02}".format(**content["date"]),
        "results": f"\\begin{{enumerate}}\n{summary}\n\\end{{enumerate}}" if summary else "",
        "tracing": paragraphs(content["tracing"]),
        "sections": "\n".join(_section(section, starred) for section in content["sections"])}


def paragraphs(texts: Iterable[str]) -> str:
    """Write paragraphs with ``[@key; @key]`` cited, ``[#fig:name]`` as a figure's or table's number, ``**a**`` bold."""
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


def _section(section: Mapping[str, Any], starred: bool) -> str:
    """A section whose figures, over both columns if `starred`, and tables stay within it."""
    kind = "figure*" if starred else "figure"
    figures = (f"\\begin{{{kind}}}[htbp]\n\\centering\n\\includegraphics{{figures/{figure['name']}.pdf}}\n"
               f"\\caption{{{escape(figure['caption'])}}}\\label{{fig:{figure['name']}}}\n\\end{{{kind}}}\n"
               for figure in section["figures"])
    tables = (rf"\input{{tables/{table['name']}}}" for table in section["tables"])
    title = rf"\section{{{escape(section['title'])}}}"
    return "\n".join([title, _paragraph(section["text"]), "", *figures, *tables, r"\FloatBarrier", ""])


def table(layout: Mapping[str, Any]) -> str:
    """Write a table with booktabs, as wide as the text: words in columns that share the room, numbers to the right.

    One of more than `LONGEST` rows breaks over pages, its heading repeated.
    """
    kinds = "".join(r">{\raggedright\arraybackslash}X" if wide else "r" if right else "l"
                    for wide, right in zip(layout["wide"], layout["right"]))
    columns = "{@{}" + ("" if any(layout["wide"]) else r"@{\extracolsep{\fill}}") + kinds + "@{}}"
    head, *rows = ([*map(escape, row)] for row in (layout["head"], *layout["rows"]))
    heading = "\\toprule\n" + " & ".join(head) + " \\\\\n\\midrule\n"
    body = "".join(" & ".join(row) + " \\\\\n" for row in rows) + "\\bottomrule\n"
    caption = rf"\caption{{{escape(layout['caption'])}}}\label{{tab:{layout['name']}}}"
    small = r"\scriptsize\setlength{\tabcolsep}{3pt}"
    if len(rows) > LONGEST:
        return (f"{{{small}\n\\begin{{xltabular}}{{\\textwidth}}{columns}\n{caption} \\\\\n{heading}\\endfirsthead\n"
                f"{heading}\\endhead\n{body}\\end{{xltabular}}}}\n")
    return (f"\\begin{{table*}}[htbp]\n\\centering{small}\n{caption}\n\\begin{{tabularx}}{{\\textwidth}}{columns}\n"
            f"{heading}{body}\\end{{tabularx}}\n\\end{{table*}}\n")
