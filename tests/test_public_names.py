"""The names of `stiction`, as an interactive session meets them: all there, complete, and short where they are printed."""

import builtins
import re
from dataclasses import replace
from pathlib import Path

import pytest

import stiction

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
LONGEST = 200
"""Characters: some lines of a terminal."""


@pytest.fixture(scope="module")
def run(compiled):
    return stiction.load_engine("reference").simulate(
        stiction.load_scene("slider-bar-case-1"), t_end=1
    )


def test_completion_offers_the_public_names():
    offered = {name for name in dir(stiction) if not name.startswith("_")}
    assert offered == set(stiction.__all__) and all(
        getattr(stiction, name) is not None for name in offered
    )


def test_names_that_pages_use_are_public():
    """In imports, as ``stiction.Name``, and as errors that a function raises."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        used = {
            name.strip()
            for names in re.findall(r"^from stiction import (\([^)]*\)|.*)$", text, re.MULTILINE)
            for name in names.strip("()").split(",")
            if name.strip()
        }
        used |= set(re.findall(r"\bstiction\.([A-Z]\w+)", text))
        for raised in re.findall(r"\*\*Raises\*\*\n\n((?:[- ] .*\n)+)", text):
            used |= {
                name.rpartition(".")[2]
                for names in re.findall(r"^- `([^`]*)`", raised, re.MULTILINE)
                for name in names.split(", ")
            }
        assert {name for name in used if not hasattr(builtins, name)} <= set(stiction.__all__), page


@pytest.mark.parametrize("part", ["scene", "body", "drive", "law"])
def test_completion_of_a_scene_offers_its_own_names(part):
    scene = stiction.load_scene("slider-bar-case-1")
    found = {
        "scene": scene,
        "body": scene.bodies["bar"],
        "drive": scene.drives["motor"],
        "law": scene.drives["motor"].law,
    }[part]
    offered = {name for name in dir(found) if not name.startswith("_")}
    assert set(type(found).model_fields) <= offered
    assert not [
        name
        for name in offered
        if name.startswith("model_")
        or name in ("copy", "dict", "json", "construct", "parse_obj", "validate")
    ]


class TestShortNames:
    def test_judgement(self, run):
        judgement = stiction.judge("slider-bar-case-1", run.to_frame())
        assert len(repr(judgement)) <= LONGEST
        assert "slider-bar-case-1" in repr(judgement) and f"{judgement.error:.3g}" in repr(
            judgement
        )

    def test_run(self, run):
        stopped = replace(run, termination="no solution " * 50)
        for made in (run, stopped, run.cost, stiction.Outcome("a", "ok", run), run.mechanism):
            assert len(repr(made)) <= LONGEST and len(str(made)) <= LONGEST
        assert (
            "reference" in repr(run)
            and "slider-bar-case-1" in repr(run)
            and "no solution" in repr(stopped)
        )
        assert not run.t[:0].size and "0 rows" in repr(replace(run, t=run.t[:0]))
