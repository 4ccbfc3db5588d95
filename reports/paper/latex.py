"""LaTeX of the content of a paper: what `stiction.reports.paper.folder.paper_content` returns."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from typing import Any

from stiction.scenes import InputError

LONGEST = 45
"""Rows of a table on one page."""
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
"""Commands of Greek letters that are no Latin ones."""
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
"""Signs that are mathematics, and their commands."""
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
"""Letters and signs of text, and their commands in the encoding T1."""
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
"""Accents as the canonical decomposition of a letter names them, and their commands."""
SPACES = {
    "\N{NO-BREAK SPACE}": "~",
    "\N{NARROW NO-BREAK SPACE}": r"\,",
    "\N{THIN SPACE}": r"\,",
    "\N{ZERO WIDTH SPACE}": "{}",
    "\N{SOFT HYPHEN}": r"\-",
    **dict.fromkeys("\t\n\r", " "),
}
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
"""What is written for a sign that is not printable ASCII, or that LaTeX would not print; letters with accents are
made of `ACCENTS`."""
_POWER = re.compile(r"(-?\d+(?:\.\d+)?)e([+-]\d+)")
_MARK = re.compile(r"\[(@\w+(?:; @\w+)*|#[^\]\s]+)\]|\*\*(.+?)\*\*")

PAPER = r"""\documentclass[10pt]{article}
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
    """Set quotation marks that open and close in place of straight ones."""
    return re.sub(r'(^|[\s(\[])"', r"\1“", text).replace('"', "”")


def escape(text: str) -> str:
    """Write text in ASCII that LaTeX prints as it is; ``m/s^2`` and powers of ten become mathematics.

    Raises
    ------
    InputError
        If a sign is neither in `SIGNS` nor a letter with the `ACCENTS`: pdflatex would stop at it, or leave it out.
    """
    shown = unicodedata.normalize("NFC", quoted(text).replace("s^2", "s²"))
    apart = re.sub(
        "-(?=-)", "-\N{ZERO WIDTH SPACE}", shown
    )  # LaTeX would make a dash of the hyphens of an option
    signs = "".join(_ascii(sign, text) for sign in apart)
    return _POWER.sub(lambda match: rf"${match[1]}{{\times}}10^{{{int(match[2])}}}$", signs)


def _ascii(sign: str, text: str) -> str:
    """What is written for one sign of a text."""
    if sign in SIGNS or " " <= sign <= "~":
        return SIGNS.get(sign, sign)
    letter, *accents = list(unicodedata.normalize("NFD", sign))
    if (
        not accents
        or not letter.isascii()
        or not letter.isalpha()
        or not set(accents) <= set(ACCENTS)
    ):
        raise InputError(
            f"paper: found the sign {sign!r} (U+{ord(sign):04X}) in {text!r}; expected signs that LaTeX "
            "can print: Latin letters, also with accents, Greek ones and common mathematics"
        )
    for accent in accents:
        letter = rf"\{ACCENTS[accent]}{{{letter}}}"
    return letter


def paper(content: Mapping[str, Any]) -> str:
    """Write the text of ``paper.tex``."""
    starred = content["columns"] == 1
    summary = "\n".join(rf"\item {_paragraph(line)}" for line in content["summary"])
    authors = escape(" and ".join(content["authors"])).replace(" and ", r" \and ")
    return PAPER % {
        "title": escape(content["title"]),
        "authors": authors,
        "date": "{year}-{month:02}-{day:02}".format(**content["date"]),
        "results": f"\\begin{{enumerate}}\n{summary}\n\\end{{enumerate}}" if summary else "",
        "tracing": paragraphs(content["tracing"]),
        "sections": "\n".join(_section(section, starred) for section in content["sections"]),
    }


def paragraphs(texts: Iterable[str]) -> str:
    """Write paragraphs with ``[@key; @key]`` cited, ``[#fig:name]`` as a figure's or table's number, ``**a**`` bold."""
    return "\n\n".join(map(_paragraph, texts)) + "\n"


def _paragraph(text: str) -> str:
    pieces, end, text = [], 0, quoted(text)
    for match in _MARK.finditer(text):
        pieces.append(escape(text[end : match.start()]))
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
    figures = (
        f"\\begin{{{kind}}}[htbp]\n\\centering\n\\includegraphics{{figures/{figure['name']}.pdf}}\n"
        f"\\caption{{{escape(figure['caption'])}}}\\label{{fig:{figure['name']}}}\n\\end{{{kind}}}\n"
        for figure in section["figures"]
    )
    tables = (rf"\input{{tables/{table['name']}}}" for table in section["tables"])
    title = rf"\section{{{escape(section['title'])}}}"
    return "\n".join(
        [title, _paragraph(section["text"]), "", *figures, *tables, r"\FloatBarrier", ""]
    )


def table(layout: Mapping[str, Any]) -> str:
    """Write a table with booktabs, at most as wide as the text, numbers to the right.

    Words in `wide` columns share the room that the others leave; a table of numbers alone that is wider than the text
    is printed smaller. One of more than `LONGEST` rows breaks over pages, its heading repeated.
    """
    kinds = "".join(
        r">{\raggedright\arraybackslash}X" if wide else "r" if right else "l"
        for wide, right in zip(layout["wide"], layout["right"])
    )
    head, *rows = ([*map(escape, row)] for row in (layout["head"], *layout["rows"]))
    heading = "\\toprule\n" + " & ".join(head) + " \\\\\n\\midrule\n"
    # after the end of a row, LaTeX would take a bracket or a star for an argument of that end
    guarded = (
        ["{}" + first if first.startswith(("[", "*")) else first, *others]
        for first, *others in rows
    )
    body = "".join(" & ".join(row) + " \\\\\n" for row in guarded) + "\\bottomrule\n"
    caption = rf"\caption{{{escape(layout['caption'])}}}\label{{tab:{layout['name']}}}"
    small = r"\scriptsize\setlength{\tabcolsep}{3pt}"
    if len(rows) > LONGEST:
        fill = "" if any(layout["wide"]) else r"@{\extracolsep{\fill}}"
        return (
            f"{{{small}\n\\begin{{xltabular}}{{\\textwidth}}{{@{{}}{fill}{kinds}@{{}}}}\n{caption} \\\\\n{heading}"
            f"\\endfirsthead\n{heading}\\endhead\n{body}\\end{{xltabular}}}}\n"
        )
    if any(layout["wide"]):
        sheet = f"\\begin{{tabularx}}{{\\textwidth}}{{@{{}}{kinds}@{{}}}}\n{heading}{body}\\end{{tabularx}}\n"
    else:
        sheet = (
            f"\\setbox0=\\hbox{{\\begin{{tabular}}{{@{{}}{kinds}@{{}}}}\n{heading}{body}\\end{{tabular}}}}%\n"
            "\\ifdim\\wd0>\\textwidth\\resizebox{\\textwidth}{!}{\\box0}\\else\\box0\\fi\n"
        )
    return f"\\begin{{table*}}[htbp]\n\\centering{small}\n{caption}\n\n{sheet}\\end{{table*}}\n"
