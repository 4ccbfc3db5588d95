"""Fidelity of a simulation: how guides are modelled."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from stiction.scenes.base_errors import InputError


class Fidelity(StrEnum):
    """How an engine models a slider in its guide.

    The values are used in Python, on the command line, in files and in tables. Texts for readers use
    `FIDELITY_LABELS`.
    """

    JOINT = "joint"
    """A bilateral joint; the upper bound of the friction force follows from its reactions."""
    CONTACT = "contact"
    """A box between two surfaces with clearance; contact and friction are computed by the engine."""

    @property
    def label(self) -> str:
        """Word for the guides in texts; its plural ends in s."""
        return FIDELITY_LABELS[self]


FIDELITY_LABELS: Mapping[Fidelity, str] = {Fidelity.JOINT: "joint", Fidelity.CONTACT: "contact"}
"""Words in texts for readers; they may change without an effect on stored results."""


def fidelity_of(text: str) -> Fidelity:
    """Return the fidelity with this value.

    Raises
    ------
    InputError
        If there is none.
    """
    if text not in tuple(Fidelity):
        raise InputError(f"fidelity: found {text!r}; expected one of {', '.join(Fidelity)}")
    return Fidelity(text)
