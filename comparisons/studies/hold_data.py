"""Runs, settings and laws of creep of the study `hold`: ``data/hold.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import resources
from typing import Any, Literal

import numpy as np

from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.studies.settings import Subject
from stiction.scenes.fields import Model, Positive

FORMS: Mapping[str, Callable[[Any, Any], Any]] = {
    "linear_zone": lambda part, zone: part * zone,
    "soft_norm": lambda part, tolerance: tolerance * part / np.sqrt(1.0 - part * part),
}
"""Creep at a part p of mu N by a law f = mu N g(v) that is zero at rest: g^-1(p), whatever mu and N are.

`linear_zone` has g = v/zone (Exudyn's ``friction_zone``), `soft_norm` g = v/sqrt(v^2 + e^2): Drake's "lagged",
"similar" and continuous contacts with e = ``stiction_tolerance`` (Castro, Han & Masterjohn 2023, "A theory of
irrotational contact fields"). In discrete steps h this holds from e = 1e-3 w h mu N on, of a contact with the normal
force N and the inverse mass w: below it that regularization, the only one of "sap", is the wider one.
"""


class Ramp(Model):
    """Changed parameters of a ramp: from `part` of the limit, at the rate `ramp` (1/s), for `t_end` seconds."""

    part: Positive
    ramp: Positive
    t_end: Positive


class Stop(Model):
    """The load of a stop, as a part of the limit, the first speed (m/s), and the seconds within which it rests."""

    part: Positive
    v0: Positive
    landed: Positive


class Runs(Model):
    """The runs of a depth: scenes, loads, steps (s), whether ramp and stop are run, scenes on which settings are."""

    scenes: tuple[str, ...]
    loads: tuple[Positive, ...]
    steps: tuple[Positive, ...]
    moved: bool
    settings: tuple[str, ...]


class Law(Model):
    """A law of the creep of a subject over one of its settings, from the value `least` on.

    Either its `exponent`, or its `form`: one of `FORMS`.
    """

    subject: str
    over: str
    source: str
    exponent: float | None = None
    form: Literal["linear_zone", "soft_norm"] | None = None
    least: float = 0.0

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield a law with both, or neither."""
        if (self.exponent is None) == (self.form is None):
            yield "form", self.form, "a form or an exponent"


class Data(Model):
    """Runs, settings and laws of the study; `regularization` is the setting with its speed, by engine and fidelity."""

    ramp: Ramp
    stop: Stop
    depths: dict[Depth, Runs]
    regularization: dict[str, str]
    subjects: tuple[Subject, ...]
    laws: tuple[Law, ...]


@cache
def load_data() -> Data:
    """``data/hold.toml``."""
    file = resources.files("stiction.comparisons") / "data" / "hold.toml"
    return Data.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))
