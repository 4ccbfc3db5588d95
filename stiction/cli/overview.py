"""The list of commands in ``stiction --help``: groups of commands, each with one line and an example."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class About:
    """The entry of a command in the list.

    Attributes
    ----------
    line : str
        What the command does, in one line.
    example : str
        An example, without ``stiction`` at its begin.
    """

    line: str
    example: str


OVERVIEW = {
    "Simulate": {
        "scenes": About("List the scenes of the catalogue.", "scenes"),
        "engines": About("List the engines, or try one.", "engines pymunk"),
        "new": About("Create a scene file to start from.", "new sled.toml"),
        "draw": About(
            "Draw the initial state of a scene.", "draw slider-crank --out slider-crank.svg"
        ),
        "explain": About(
            "Show the equations of a scene, and the engines that can represent it.",
            "explain slider-bar-case-1",
        ),
        "run": About("Simulate a scene with one engine.", "run slider-bar-case-1 --engine pymunk"),
        "sweep": About(
            "Measure the steady state on a grid of parameter values.",
            "sweep slider-bar-case-1 --vary F0=3:6:8 --measure stick-fraction",
        ),
        "export": About(
            "Write a scene in the model format of an engine.", "export slider-crank --to mjcf"
        ),
        "schema": About("Print the JSON schema of the scene format.", "schema"),
    },
    "Compare": {
        "compare": About(
            "Compare several engines with regard to one question.", "compare accuracy slider-crank"
        ),
        "validate": About(
            "Make all comparisons for the three cases of the paper or other scenes, and write a report.",
            "validate --quick --out run",
        ),
        "judge": About(
            "Judge a table of results from any program, or a submission to the benchmark.",
            "judge slider-crank mine.csv",
        ),
        "replay": About(
            "Test a solver for linear complementarity problems.",
            "replay --solver gauss_seidel:solve",
        ),
        "prove": About("Prove bounds for a motion and its events.", "prove slider-bar-case-1"),
    },
    "Detect regressions": {
        "check": About("Report the results that a change of the code has changed.", "check"),
        "nightly": About(
            "Run a campaign, and compare it with a baseline or earlier nights.",
            "nightly campaign.toml --out nights",
        ),
        "baseline": About(
            "Update the baseline, the accepted results.",
            'baseline update --reason "steps are bounded by events"',
        ),
    },
    "Publish": {
        "paper": About(
            "Write figures, tables and a PDF from the results of `validate`.",
            "paper run --out paper",
        ),
        "page": About(
            "Write the results of `validate`, or a history of nights, as a web page.", "page run"
        ),
        "site": About(
            "Write a web site of a history of nights, with a page for each question and engine.",
            "site nightly/history.sqlite --run run --out public",
        ),
        "trace": About(
            "Show the data from which a row of a table was computed.", "trace run accuracy:2"
        ),
        "dataset": About(
            "Write the friction benchmark: scenes and exact motions for other programs.",
            "dataset friction-benchmark-1",
        ),
    },
}
"""Entries by the name of the group and the name of the command, in the order of the help."""
