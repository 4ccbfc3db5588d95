"""LaTeX of the content of a paper, which `stiction.reports.paper.folder.paper_content` returns."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any

from stiction.scenes import InputError

MAX_ROWS_ON_PAGE = 45
"""Largest number of rows in a table that is printed on one page."""
GREEK = dict(
    zip(
        "αβγδεζηθικλμνξπρστυφχψωΓΔΘΛΞΠΣΥΦΨΩ",
        (
            "alpha beta gamma delta varepsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma "
            "tau upsilon varphi chi "
            "psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
        ).split(),
        strict=True,
    )
)
"""Commands of the Greek letters that do not look like Latin ones."""
MATHEMATICS = {
    **GREEK,
    "µ": "mu",
    "∆": "Delta",
    "ϵ": "epsilon",
    "ϑ": "vartheta",
    "ϕ": "phi",
    "≤": "leq",
    "≥": "geq",
    "≠": "neq",
    "≈": "approx",
    "≡": "equiv",
    "∼": "sim",
    "∝": "propto",
    "≪": "ll",
    "≫": "gg",
    "∓": "mp",
    "×": "times",
    "÷": "div",
    "·": "cdot",
    "⋅": "cdot",
    "∘": "circ",
    "∞": "infty",
    "∂": "partial",
    "∇": "nabla",
    "∑": "sum",
    "∏": "prod",
    "∫": "int",
    "√": "surd",
    "∈": "in",
    "∉": "notin",
    "∅": "emptyset",
    "∪": "cup",
    "∩": "cap",
    "∧": "wedge",
    "∨": "vee",
    "¬": "neg",
    "⊥": "perp",
    "∥": "parallel",
    "∠": "angle",
    "→": "rightarrow",
    "←": "leftarrow",
    "↔": "leftrightarrow",
    "↑": "uparrow",
    "↓": "downarrow",
    "⇒": "Rightarrow",
    "⇐": "Leftarrow",
    "⇔": "Leftrightarrow",
    "⟨": "langle",
    "⟩": "rangle",
}
"""Commands of mathematical signs, without the backslash."""
LETTERS = {
    "ß": "ss",
    "ẞ": "SS",
    "ø": "o",
    "Ø": "O",
    "æ": "ae",
    "Æ": "AE",
    "œ": "oe",
    "Œ": "OE",
    "ł": "l",
    "Ł": "L",
    "đ": "dj",
    "Đ": "DJ",
    "ð": "dh",
    "Ð": "DH",
    "þ": "th",
    "Þ": "TH",
    "ŋ": "ng",
    "Ŋ": "NG",
    "ı": "i",
    "ȷ": "j",
    "±": "textpm",
    "§": "S",
    "¶": "P",
    "…": "ldots",
    "•": "textbullet",
    "°": "textdegree",
    "©": "copyright",
    "®": "textregistered",
    "™": "texttrademark",
    "€": "texteuro",
    "£": "pounds",
    "‰": "textperthousand",
    "«": "guillemotleft",
    "»": "guillemotright",
    "‹": "guilsinglleft",
    "›": "guilsinglright",
    "„": "quotedblbase",
    "‚": "quotesinglbase",
}
"""Commands of letters and signs of text in the font encoding T1, without the backslash."""
ACCENTS = {
    "\N{COMBINING GRAVE ACCENT}": "`",
    "\N{COMBINING ACUTE ACCENT}": "'",
    "\N{COMBINING CIRCUMFLEX ACCENT}": "^",
    "\N{COMBINING TILDE}": "~",
    "\N{COMBINING DIAERESIS}": '"',
    "\N{COMBINING RING ABOVE}": "r",
    "\N{COMBINING CARON}": "v",
    "\N{COMBINING BREVE}": "u",
    "\N{COMBINING MACRON}": "=",
    "\N{COMBINING DOT ABOVE}": ".",
    "\N{COMBINING DOUBLE ACUTE ACCENT}": "H",
    "\N{COMBINING CEDILLA}": "c",
    "\N{COMBINING OGONEK}": "k",
    "\N{COMBINING DOT BELOW}": "d",
    "\N{COMBINING MACRON BELOW}": "b",
}
"""Commands of accents, without the backslash, by the combining characters in the decomposition of a letter."""
SPACES = {
    "\N{NO-BREAK SPACE}": "~",
    "\N{NARROW NO-BREAK SPACE}": r"\,",
    "\N{THIN SPACE}": r"\,",
    "\N{ZERO WIDTH SPACE}": "{}",
    "\N{SOFT HYPHEN}": r"\-",
    **dict.fromkeys("\t\n\r", " "),
}
"""LaTeX of white space and of invisible characters."""
_POWERS = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-", strict=True))
_INDICES = dict(zip("₀₁₂₃₄₅₆₇₈₉₊₋", "0123456789+-", strict=True))
SIGNS = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    **{sign: "\\" + sign for sign in "&%$#_{}"},
    "\N{REPLACEMENT CHARACTER}": "?",
    "“": "``",
    "”": "''",
    "‘": "`",
    "’": "'",
    "–": "--",
    "—": "---",
    "‐": "-",
    "‑": "-",
    "−": "$-$",
    **SPACES,
    **{sign: rf"$\{command}$" for sign, command in MATHEMATICS.items()},
    **{sign: rf"\{command}{{}}" for sign, command in LETTERS.items()},
    **{sign: f"$^{{{digit}}}$" for sign, digit in _POWERS.items()},
    **{sign: f"$_{{{digit}}}$" for sign, digit in _INDICES.items()},
    "²": "$^2$",
}
"""LaTeX of the characters that are not printable ASCII, or that have a meaning in LaTeX.

Letters with accents are not listed; `_escape_character` composes them from `ACCENTS`.
"""
_POWER = re.compile(r"(-?\d+(?:\.\d+)?)e([+-]\d+)")
"""A number in exponential notation: 1.5e-06."""
_MARK = re.compile(r"\[(@\w+(?:; @\w+)*|#[^\]\s]+)\]|\*\*(.+?)\*\*")
"""A mark in a text: a citation ``[@key; @key]``, a reference ``[#fig:name]``, or bold text ``**a**``."""

_PAPER = r"""\documentclass[10pt]{article}
\usepackage[a4paper,textwidth=174mm,textheight=240mm]{geometry}
\usepackage[T1]{fontenc}
\usepackage{textcomp}
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
    """Return a text with opening and closing quotation marks in place of straight ones."""
    return re.sub(r'(^|[\s(\[])"', r"\1“", text).replace('"', "”")


def escape(text: str) -> str:
    """Return ASCII from which LaTeX prints a text; powers of ten and ``s^2`` become mathematics.

    Raises
    ------
    InputError
        If a character is neither in `SIGNS` nor a Latin letter with accents of `ACCENTS`. LaTeX would stop
        at such a character, or omit it.
    """
    normalized = unicodedata.normalize("NFC", quoted(text).replace("s^2", "s²"))
    # LaTeX would combine the two hyphens of an option such as --quick to a dash.
    separated = re.sub("-(?=-)", "-\N{ZERO WIDTH SPACE}", normalized)
    escaped = "".join(_escape_character(character, text) for character in separated)
    return _POWER.sub(_power_of_ten, escaped)


def _power_of_ten(match: re.Match[str]) -> str:
    """Return the mathematics for a number in exponential notation."""
    return rf"${match[1]}{{\times}}10^{{{int(match[2])}}}$"


def _escape_character(character: str, text: str) -> str:
    """Return the LaTeX of a character; `text` is the whole text, for the error message of `escape`."""
    if character in SIGNS:
        return SIGNS[character]
    if " " <= character <= "~":
        return character
    # The canonical decomposition of a letter consists of the letter and its accents.
    letter, *accents = list(unicodedata.normalize("NFD", character))
    is_latin = letter.isascii() and letter.isalpha()
    if not is_latin or not accents or not set(accents) <= set(ACCENTS):
        raise InputError(
            f"paper: found the sign {character!r} (U+{ord(character):04X}) in {text!r}; expected signs that "
            "LaTeX can print: Latin letters, also with accents, Greek ones and common mathematics"
        )
    latex = letter
    for accent in accents:
        latex = rf"\{ACCENTS[accent]}{{{latex}}}"
    return latex


def paper(content: Mapping[str, Any]) -> str:
    """Return the text of ``paper.tex``."""
    items = "\n".join(rf"\item {_paragraph(line)}" for line in content["summary"])
    results = f"\\begin{{enumerate}}\n{items}\n\\end{{enumerate}}" if items else ""
    authors = escape(" and ".join(content["authors"])).replace(" and ", r" \and ")
    # A figure with the width of the page spans both columns of a journal; LaTeX calls it figure*.
    spans_columns = content["columns"] == 1
    return _PAPER % {
        "title": escape(content["title"]),
        "authors": authors,
        "date": "{year}-{month:02}-{day:02}".format(**content["date"]),
        "results": results,
        "tracing": paragraphs(content["tracing"]),
        "sections": "\n".join(_section(section, spans_columns) for section in content["sections"]),
    }


def paragraphs(texts: Iterable[str]) -> str:
    """Return the LaTeX of paragraphs.

    ``[@key; @key]`` becomes a citation, ``[#fig:name]`` the number of a figure or table, and ``**a**`` bold.
    """
    return "\n\n".join(map(_paragraph, texts)) + "\n"


def _paragraph(text: str) -> str:
    """Return the LaTeX of a paragraph; see `paragraphs` for the marks in it."""
    text = quoted(text)
    pieces = []
    end = 0
    for match in _MARK.finditer(text):
        pieces.append(escape(text[end : match.start()]))
        pieces.append(_mark(match))
        end = match.end()
    pieces.append(escape(text[end:]))
    # A line must not break between a word and the number that belongs to it.
    return re.sub(r" \\(cite|ref)\b", r"~\\\1", "".join(pieces))


def _mark(match: re.Match[str]) -> str:
    """Return the LaTeX of a mark that `_MARK` has matched."""
    target, bold = match[1], match[2]
    if bold:
        return rf"\textbf{{{escape(bold)}}}"
    if target.startswith("#"):
        return rf"\ref{{{target.removeprefix('#')}}}"
    keys = target.replace("@", "").replace("; ", ",")
    return rf"\cite{{{keys}}}"


def _section(section: Mapping[str, Any], spans_columns: bool) -> str:
    """Return the LaTeX of a section. Its figures and tables stay before the next section."""
    environment = "figure*" if spans_columns else "figure"
    lines = [rf"\section{{{escape(section['title'])}}}", _paragraph(section["text"]), ""]
    for figure in section["figures"]:
        lines += [
            rf"\begin{{{environment}}}[htbp]",
            r"\centering",
            rf"\includegraphics{{figures/{figure['name']}.pdf}}",
            rf"\caption{{{escape(figure['caption'])}}}\label{{fig:{figure['name']}}}",
            rf"\end{{{environment}}}",
            "",
        ]
    for table in section["tables"]:
        lines.append(rf"\input{{tables/{table['name']}}}")
    return "\n".join([*lines, r"\FloatBarrier", ""])


def table(layout: Mapping[str, Any]) -> str:
    """Return the LaTeX of a table that `stiction.reports.paper.folder.lay_out_table` has laid out.

    The table is at most as wide as the text: ``wide`` columns share the remaining width, and a table
    without such columns is scaled if it is too wide. A table of more than `MAX_ROWS_ON_PAGE` rows
    continues on further pages, where its heading is repeated.
    """
    columns = "".join(
        _column_type(is_wide, is_right)
        for is_wide, is_right in zip(layout["wide"], layout["right"])
    )
    heading = f"\\toprule\n{_row(layout['head'])}\\midrule\n"
    body = "".join(_body_row(row) for row in layout["rows"]) + "\\bottomrule\n"
    caption = rf"\caption{{{escape(layout['caption'])}}}\label{{tab:{layout['name']}}}"
    small = r"\scriptsize\setlength{\tabcolsep}{3pt}"
    has_wide_columns = any(layout["wide"])
    if len(layout["rows"]) > MAX_ROWS_ON_PAGE:
        fill = "" if has_wide_columns else r"@{\extracolsep{\fill}}"
        return (
            f"{{{small}\n\\begin{{xltabular}}{{\\textwidth}}{{@{{}}{fill}{columns}@{{}}}}\n{caption} \\\\\n{heading}"
            f"\\endfirsthead\n{heading}\\endhead\n{body}\\end{{xltabular}}}}\n"
        )
    if has_wide_columns:
        tabular = (
            f"\\begin{{tabularx}}{{\\textwidth}}{{@{{}}{columns}@{{}}}}\n{heading}{body}"
            "\\end{tabularx}\n"
        )
    else:
        # The table is typeset into a box to measure its width.
        tabular = (
            f"\\setbox0=\\hbox{{\\begin{{tabular}}{{@{{}}{columns}@{{}}}}\n{heading}{body}\\end{{tabular}}}}%\n"
            "\\ifdim\\wd0>\\textwidth\\resizebox{\\textwidth}{!}{\\box0}\\else\\box0\\fi\n"
        )
    return f"\\begin{{table*}}[htbp]\n\\centering{small}\n{caption}\n\n{tabular}\\end{{table*}}\n"


def _column_type(is_wide: bool, is_right: bool) -> str:
    """Return the type of a column of a table: text in lines of limited width, right-aligned, or left-aligned."""
    if is_wide:
        return r">{\raggedright\arraybackslash}X"
    return "r" if is_right else "l"


def _row(cells: Iterable[str]) -> str:
    """Return the LaTeX of a row of a table."""
    return " & ".join(map(escape, cells)) + " \\\\\n"


def _body_row(cells: Iterable[str]) -> str:
    """Return the LaTeX of a row that follows another row.

    LaTeX would take a bracket or a star at its begin for an argument of the end of the row before. An
    empty group prevents this.
    """
    row = _row(cells)
    return "{}" + row if row.startswith(("[", "*")) else row
