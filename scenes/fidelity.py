"""Fidelity of a simulation: how guides are modelled."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from stiction.scenes.base_errors import InputError


class Fidelity(StrEnum):
    """How an engine models a slider in its guide.

    The values are what scenes' users write, in Python, on the command line and in files, and what tables have. What
    people read is in `FIDELITY_LABELS`.
    """

    JOINT = "joint"
    """Bilateral joints; the bound of friction comes from their reactions."""
    CONTACT = "contact"
    """A box between two surfaces with clearance; the engine's own contacts and friction."""

    @property
    def label(self) -> str:
        """What people read; with an s it names the guides."""
        return FIDELITY_LABELS[self]


FIDELITY_LABELS: Mapping[Fidelity, str] = {Fidelity.JOINT: "joint", Fidelity.CONTACT: "contact"}
"""Words for people; no result depends on them."""


def fidelity_of(text: str) -> Fidelity:
    """Return the fidelity of this name. Raises InputError for any other."""
    if text not in tuple(Fidelity):
        raise InputError(f"fidelity: found {text!r}; expected one of {', '.join(Fidelity)}")
    return Fidelity(text)
