"""The commands in groups, each with one line and one example, as ``stiction --help`` lists them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class About:
    """What a command does, in one line, and an example without the program's name."""

    line: str
    example: str


OVERVIEW = {
    "Simulate": {
        "scenes": About("List the scenes of the catalogue.", "scenes"),
        "engines": About("List the engines, or try one.", "engines pymunk"),
        "new": About("Begin a scene of your own.", "new sled.toml"),
        "draw": About("Draw a scene at its start.", "draw slider-crank --out slider-crank.svg"),
        "explain": About("Show how the reference treats a scene.", "explain slider-bar-case-1"),
        "run": About("Simulate a scene by one engine.", "run slider-bar-case-1 --engine pymunk"),
        "sweep": About(
            "Measure the steady state over a grid of parameters.",
            "sweep slider-bar-case-1 --vary F0=3:6:8 --measure stick-fraction",
        ),
        "export": About(
            "Write a scene as a model for another engine.", "export slider-crank --to mjcf"
        ),
        "schema": About("Print the JSON schema of the scene format.", "schema"),
    },
    "Compare": {
        "compare": About(
            "Answer one question for several engines.", "compare accuracy slider-crank"
        ),
        "validate": About(
            "Answer all questions, and write a report.", "validate --quick --out run"
        ),
        "judge": About("Judge a table of results of any program.", "judge slider-crank mine.csv"),
        "replay": About(
            "Try a solver of complementarity problems.", "replay --solver gauss_seidel:solve"
        ),
        "prove": About("Enclose a motion with a proof.", "prove slider-bar-case-1"),
    },
    "Guard against regressions": {
        "check": About("Say what a change of the code does to the numbers.", "check"),
        "nightly": About(
            "Run a campaign, and compare it with the baseline.",
            "nightly campaign.toml --out nights",
        ),
        "baseline": About(
            "Update what runs are held to.",
            'baseline update --reason "steps are bounded by events"',
        ),
    },
    "Publish": {
        "paper": About("Write figures, tables and a PDF of a run.", "paper run --out paper"),
        "page": About("Write a run, or the history of nights, as a web page.", "page run"),
        "trace": About("Show where a row of a table comes from.", "trace run accuracy:2"),
        "dataset": About("Write the truths of the catalogue as data.", "dataset truths"),
    },
}
"""Commands by group, in the order of the help."""
