"""Whatever the words of a paper are, its LaTeX is ASCII that pdflatex sets, or writing it is refused."""

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.reports.paper import latex
from stiction.scenes import InputError

ROOT = Path(__file__).resolve().parents[3]
ACCENTED = "àéîñöåčğūżőçęḍẖÀÉÎÑÖÅČĞŪŻŐÇĘḌ"
needs_latex = pytest.mark.skipif(
    shutil.which("pdflatex") is None, reason="no pdflatex on this machine"
)


def test_every_sign_of_a_text_of_the_suite_can_be_written():
    """Of all words in the code: which of them come into a paper depends on the run."""
    found = set()
    for file in (
        file
        for package in ("scenes", "engines", "comparisons", "reports")
        for file in (ROOT / package).rglob("*.py")
    ):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and not text.isascii() and file.name != "latex.py":
                assert latex.escape(text).isascii(), (file, text)
                found |= set(text)
    assert {"≥", "≤", "±"} <= found


@given(st.text(st.sampled_from([*latex.SIGNS, *ACCENTED, *map(chr, range(32, 127))])))
def test_the_signs_of_the_table_are_written_in_ascii(text):
    written = latex.escape(text)
    assert written.isascii() and "\t" not in written and not re.search(r"(?<!\\)[#%&]", written)
    assert written.replace(r"\{", "").replace(r"\}", "").count("{") == written.replace(
        r"\{", ""
    ).replace(r"\}", "").count("}")


@given(st.text())
def test_any_other_sign_is_refused_by_name(text):
    try:
        assert latex.escape(text).isascii()
    except InputError as error:
        named = re.search(r"\(U\+([0-9A-F]{4,6})\)", str(error))
        assert named is not None and chr(int(named[1], 16)) not in latex.SIGNS


@pytest.mark.parametrize("text", ["王", "\x1b[31m", "✗", "\ud800"])
def test_a_sign_that_latex_does_not_have(text):
    with pytest.raises(
        InputError, match=r"paper: found the sign .* \(U\+[0-9A-F]{4}\) in .*; expected signs"
    ):
        latex.escape(f"the engine says {text}")


@pytest.mark.parametrize(
    "text, written",
    [
        ("≥ 3 ms, ≤ 4 ms", r"$\geq$ 3 ms, $\leq$ 4 ms"),
        ("Nørsett", r"N\o{}rsett"),
        ("Müller", r"M\"{u}ller"),
        ("g\u0308", None),
        ("9.81 m/s^2", "9.81 m/s$^2$"),
        ("1.5e-07", r"$1.5{\times}10^{-7}$"),
        ("run --out", "run -{}-out"),
        ("a\nb", "a b"),
        ("µm, 5 Ω", r"$\mu$m, 5 $\Omega$"),
    ],
)
def test_what_is_written(text, written):
    if written is None:
        with pytest.raises(InputError):
            latex.escape(text)
    else:
        assert latex.escape(text) == written


def test_a_row_that_begins_with_a_bracket_is_no_argument_of_the_row_before():
    layout = {
        "name": "t",
        "caption": "C.",
        "head": ["a", "b"],
        "right": [False] * 2,
        "wide": [False] * 2,
        "rows": [["x", "1"], ["[m]", "2"], ["*", "3"]],
    }
    assert "\n{}[m] & 2" in latex.table(layout) and "\n{}* & 3" in latex.table(layout)


def test_every_reference_has_a_year():
    entries = re.split(
        r"^@",
        (ROOT / "reports" / "paper" / "references.bib").read_text(encoding="ascii"),
        flags=re.M,
    )[1:]
    assert entries and not [
        entry.split(",")[0]
        for entry in entries
        if not re.search(r"^  year +(=) +\{\d{4}\}", entry, re.M)
    ]


@needs_latex
def test_pdflatex_sets_every_sign_of_the_table(tmp_path):
    lines = "\n\n".join(
        f"{index}: x{latex.escape(sign)}x" for index, sign in enumerate([*latex.SIGNS, *ACCENTED])
    )
    (tmp_path / "signs.tex").write_text(
        f"\\documentclass{{article}}\\usepackage[T1]{{fontenc}}\\usepackage{{textcomp}}\n\\begin{{document}}\n{lines}\n\\end{{document}}\n",
        encoding="ascii",
    )
    ended = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "signs"],
        cwd=tmp_path,
        capture_output=True,
        timeout=600,
    )
    log = (tmp_path / "signs.log").read_text(errors="replace")
    assert ended.returncode == 0 and "Missing character" not in log, log[-2000:]
