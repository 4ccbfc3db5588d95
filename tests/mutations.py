"""Mutations of the code, listed in `mutations.toml`: each is one wrong coefficient, sign or missing term, and something must find it.

    python tests/mutations.py [--first] [--results FILE] [--baseline FILE] [NAME ...]

Tries those (all, if none is named) that FILE has no answer for, one after the other, each in a copy of the checkout: first the tests
that are named for it, then the part of `stiction check` that runs through the file, and where neither finds it the scenes of a night that
are named for it; with ``--first`` no more is asked once something has found it. FILE is written after each; then `PAGE`, the
table. It takes one to five minutes each: kernels compile in each copy, as numba keeps machine code by the path of the sources.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w

ROOT = Path(__file__).parent.parent
LIST, PAGE = ROOT / "tests" / "mutations.toml", ROOT / "docs" / "reference" / "mutations.md"
RESULTS = ROOT / "build" / "mutations.json"
NOT_COPIED = (
    "__pycache__",
    ".git",
    ".venv",
    "build",
    "runs",
    "nightly",
    "site",
    ".hypothesis",
    ".pytest_cache",
)
CAMPAIGN = Path("comparisons", "campaigns", "nightly.toml")
PARTS = ("equations", "event location", "columns", "adapters", "truths", "gate")
FINE, FAILED, REGRESSED = 0, 1, 3
"""Exit codes: of everything, of pytest, of `stiction check` and `stiction nightly`."""
LIMIT = 3600.0
"""Seconds that a command may take; one that takes longer has no answer."""
UNSEEN = "not found"


@dataclass(frozen=True)
class Mutation:
    """A damage, `name` in the words of what it breaks.

    Attributes
    ----------
    part : str
        One of `PARTS`.
    file, find, replace : str
        `find` occurs once in the file.
    tests : tuple of str
        Arguments of pytest: the tests that are tried.
    engines : tuple of str
        Whose runs go through the file.
    night : tuple of str
        Scenes of a night that are tried where tests and check find nothing.
    """

    name: str
    part: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...] = ()
    engines: tuple[str, ...] = ("reference",)
    night: tuple[str, ...] = ("slider-bar-case-1",)

    @property
    def digest(self) -> str:
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:16]

    def apply(self, folder: Path) -> None:
        """Damage a copy of the checkout."""
        path = folder / self.file
        text = path.read_text()
        if (count := text.count(self.find)) != 1 or self.find == self.replace:
            raise ValueError(
                f"{self.name}: {self.file} has {self.find!r} {count} times; expected once, and another text for it"
            )
        path.write_text(text.replace(self.find, self.replace))


@dataclass(frozen=True)
class Answer:
    """What found a mutation: by each of the three the first test or number that tells, `UNSEEN`, or nothing where it was not asked."""

    digest: str
    tests: str
    check: str = ""
    night: str = ""

    @property
    def is_found(self) -> bool:
        return any(told not in ("", UNSEEN) for told in (self.tests, self.check, self.night))


class NoAnswer(Exception):
    """A command that neither passed nor failed as one does that finds a damage."""


def mutations() -> list[Mutation]:
    found = []
    for raw in tomllib.loads(LIST.read_text())["mutation"]:
        engine = re.match(r"engines/(?!shared|reference)(\w+)/", raw["file"])
        found.append(
            Mutation(
                **({"engines": (engine[1],)} if engine else {}),
                **{
                    key: tuple(value) if isinstance(value, list) else value
                    for key, value in raw.items()
                },
            )
        )
    return found


@contextmanager
def copied() -> Iterator[Path]:
    """A copy of the checkout."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "stiction")
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*NOT_COPIED))
        told = subprocess.run(
            [sys.executable, "-P", "-c", "import stiction; print(stiction.__file__)"],
            env=_environment(folder),
            capture_output=True,
            text=True,
        )
        if not Path(told.stdout.strip()).is_relative_to(folder):
            raise NoAnswer(f"expected the code of the copy; found {told.stdout}{told.stderr}")
        yield folder


def _environment(folder: Path) -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")} | {
        "PYTHONPATH": str(folder)
    }


def _ran(folder: Path, *command: str, found: int) -> str:
    """What a command of the copy printed; nothing if all was fine."""
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", *command],
            cwd=folder,
            env=_environment(folder),
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
    except subprocess.TimeoutExpired:
        raise NoAnswer(f"{' '.join(command)}: nothing within {LIMIT:g} s") from None
    if ended.returncode not in (FINE, found):
        raise NoAnswer(
            f"{' '.join(command)}: exit code {ended.returncode}\n{ended.stdout[-2000:]}{ended.stderr[-2000:]}"
        )
    return ended.stdout if ended.returncode == found else ""


def _tests(folder: Path, mutation: Mutation) -> str:
    """The first test that fails."""
    options = ("-n", "0", "-x", "-q", "-p", "no:cacheprovider")
    told = mutation.tests and _ran(folder, "pytest", *options, *mutation.tests, found=FAILED)
    if not told:
        return UNSEEN
    [failed] = re.findall(r"^(?:FAILED|ERROR) (\S+?)(?:\[.*)?(?: - .*)?$", told, re.MULTILINE)[:1]
    return failed.rpartition("::")[2]


def _runs(
    folder: Path, command: str, engines: Sequence[str], scenes: Sequence[str], baseline: str | None
) -> str:
    """The worst line of the report of `stiction check` or `stiction nightly` on the runs of these engines.

    Of the campaign's scenes for checks where none are given.
    """
    campaign = tomllib.loads((folder / CAMPAIGN).read_text())
    campaign["variants"] = {
        label: variant
        for label, variant in campaign["variants"].items()
        if variant["engine"] in engines
    }
    check = campaign["check"]
    check["variants"] = [label for label in check["variants"] if label in campaign["variants"]]
    campaign["scenes"] = list(scenes) or check["scenes" if check["variants"] else "every"]
    for key in ("scenes", "every"):
        check[key] = [scene for scene in check[key] if scene in campaign["scenes"]]
    campaign["measure"] = ["accuracy", "motion", "event", "drift", "counter"]
    (part := folder / CAMPAIGN.with_name("part.toml")).write_text(tomli_w.dumps(campaign))
    options = [] if command == "check" else ["--out", str(folder / "night")]
    options += ["--baseline", baseline] if baseline else []
    told = _ran(folder, "stiction", command, str(part), *options, found=REGRESSED)
    for row in told.splitlines():
        cells = [cell.strip() for cell in row.split("|")]
        if len(cells) > 7 and cells[1] == "regression":
            return f"{cells[2]}, {cells[3]}"
    if told:
        raise NoAnswer(f"{command}: no regression in the report\n{told[:2000]}")
    return UNSEEN


@cache
def _undamaged(
    command: str, engines: tuple[str, ...], scenes: tuple[str, ...], baseline: str | None
) -> None:
    """Nothing is found where nothing is damaged, or what is found elsewhere says nothing."""
    with copied() as folder:
        if (told := _runs(folder, command, engines, scenes, baseline)) != UNSEEN:
            raise NoAnswer(f"{command} of {', '.join(engines)} finds, without any mutation: {told}")


def tried(mutation: Mutation, baseline: str | None = None, first: bool = False) -> Answer:
    """Damage a copy of the checkout, and ask; of `first`, until something has found it.

    Raises
    ------
    NoAnswer
        Where a command neither passes nor finds something, or the undamaged code is no better.
    """
    with copied() as folder:
        mutation.apply(folder)
        answer = Answer(mutation.digest, _tests(folder, mutation))
        for what, command, scenes in (("check", "check", ()), ("night", "nightly", mutation.night)):
            if answer.is_found and (first or what == "night"):
                break
            _undamaged(command, mutation.engines, scenes, baseline)
            answer = replace(
                answer, **{what: _runs(folder, command, mutation.engines, scenes, baseline)}
            )
    return answer


def read_results(path: Path) -> dict[str, Answer]:
    kept = json.loads(path.read_text()) if path.is_file() else {}
    return {name: Answer(**answer) for name, answer in kept.items()}


def page(found: dict[str, Answer]) -> str:
    """The table, in Markdown."""
    lines = [
        "# Mutations",
        "",
        "<!-- made by tests/mutations.py -->",
        "",
        "A mutation is a deliberate error in one line of the code, such as a wrong coefficient, a wrong sign or a missing",
        "term. The tables show which test, or which number of `stiction check` or `stiction nightly`, detects it. First the",
        "tests are run that are listed for the mutation in `tests/mutations.toml`, then the part of `stiction check` whose",
        "runs use the file, and then, if neither detects it, a nightly campaign. *Not found* means that the mutation was not",
        "detected, *not asked* that this step was omitted because an earlier one had detected the mutation, and *not tried*",
        "that the current form of the mutation has not been applied yet. Numbers in parentheses are equations in the paper.",
        "",
        "`python tests/mutations.py` applies the mutations and writes this page; `pytest -m long tests/test_mutations.py` tests",
        "all of them.",
    ]
    for part in PARTS:
        lines += [
            "",
            f"## {part.capitalize()}",
            "",
            "| mutation | file | tests | check | night |",
            "|---|---|---|---|---|",
        ]
        for mutation in (each for each in mutations() if each.part == part):
            answer = found.get(mutation.name)
            told = ["not tried"] * 3
            if answer and answer.digest == mutation.digest:
                told = [each or "not asked" for each in (answer.tests, answer.check, answer.night)]
            lines.append(f"| {mutation.name} | `{mutation.file}` | {' | '.join(told)} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description="Try mutations of the code, and write the table of what finds them."
    )
    parser.add_argument("names", nargs="*", help="of mutations; all if none is given")
    parser.add_argument("--results", type=Path, default=RESULTS, help="file of the answers so far")
    parser.add_argument(
        "--baseline", help="what check and night are held to; the suite's own if not given"
    )
    parser.add_argument(
        "--first", action="store_true", help="ask no more once something has found it"
    )
    asked = parser.parse_args(arguments)
    found: dict[str, Any] = read_results(asked.results)
    asked.results.parent.mkdir(parents=True, exist_ok=True)
    failed = []
    for mutation in mutations():
        before = found.get(mutation.name)
        known = before and before.digest == mutation.digest and (before.check or asked.first)
        if asked.names and mutation.name not in asked.names or known:
            continue
        try:
            answer = tried(
                mutation, asked.baseline and str(Path(asked.baseline).resolve()), asked.first
            )
        except NoAnswer as error:
            failed.append(mutation.name)
            print(f"{mutation.name}: no answer: {error}", flush=True)
            continue
        found[mutation.name] = answer
        print(
            f"{mutation.name}: tests: {answer.tests}; check: {answer.check or 'not asked'}; "
            f"night: {answer.night or 'not asked'}",
            flush=True,
        )
        kept = {name: asdict(each) for name, each in found.items()}
        asked.results.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n")
    PAGE.write_text(page(found))
    failed += [
        mutation.name
        for mutation in mutations()
        if mutation.name in found and not found[mutation.name].is_found
    ]
    print(
        f"{len(found)} of {len(mutations())} tried; found by nobody or without an answer: {', '.join(failed) or 'none'}"
    )
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
