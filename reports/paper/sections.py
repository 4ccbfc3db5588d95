"""The sections of a paper and of a page: which figures and tables stand together, and what they show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar


class _OfTopic(Protocol):
    topic: str


Figure, Table = TypeVar("Figure", bound=_OfTopic), TypeVar("Table", bound=_OfTopic)


@dataclass(frozen=True)
class Section:
    """Figures and tables of its `topics` (of a `Drawing` or a `Sheet`), behind a sentence."""

    title: str
    topics: tuple[str, ...]
    words: str


SECTIONS = (
    Section("The mechanism", ("mechanism", "parameters"), "The slider-bar of the paper, with the corners of its slider numbered as there, and the parameters of its cases."),
    Section("What was compared", ("variants",), "Engines with their settings. Joint fidelity: bilateral joints, with friction bound from their reactions; contact fidelity: a box between two "
            "surfaces, with the engine's own contacts. They answer different questions."),
    Section("The paper's figures", ("paper",), "Time series of the cases as the paper shows them. Stick phases are grey."),
    Section("The paper's claims", ("claims", "sensitivity"), "What the paper says of its example, measured on the truth and on its own scheme; and what of it depends on what the paper leaves open."),
    Section("Accuracy", ("accuracy", "orders"), "Largest differences from the truth over a whole run, and orders of convergence."),
    Section("Threshold of stick", ("threshold",), "The largest amplitude of the load at which the slider still sticks in the steady state."),
    Section("Jumps of the driving torque", ("torque",), "At an event the driving torque jumps: by how much, and when."),
    Section("Constraint drift", ("drift", "study", "suppression"), "Residuals of the constraints, with and without what is done against them."),
    Section("What accuracy costs", ("cost", "effects", "settings"), "Error against CPU time, what each effect of the scene costs, and what the settings of the engines do."),
    Section("Hard cases", ("hard",), "Cases of which the right answer is known and easily missed: coinciding events, redundant and frictionless guides, motions that do not exist or are not unique."),
    Section("What did not come out?", ("failures",), "Runs that failed or ended before their time."))


def in_sections(figures: Sequence[Figure], tables: Sequence[Table]) -> Iterator[tuple[Section, list[Figure], list[Table]]]:
    """Each section that has a figure or a table, with them.

    Raises
    ------
    ValueError
        For a topic of no section: nothing is left out.
    """
    known = {topic for section in SECTIONS for topic in section.topics}
    if lost := sorted({item.topic for item in (*figures, *tables)} - known):
        raise ValueError(f"topic: found {', '.join(lost)}; expected one of {', '.join(sorted(known))}")
    for section in SECTIONS:
        there = [figure for figure in figures if figure.topic in section.topics], [table for table in tables if table.topic in section.topics]
        if any(there):
            yield section, *there
