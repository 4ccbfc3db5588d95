"""Runs, settings and laws of creep of the study `hold`, read from ``data/hold.toml``."""

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


def _linear_zone(part: Any, zone: Any) -> Any:
    """Return the speed at which f = mu N v/zone is a part of mu N."""
    return part * zone


def _soft_norm(part: Any, tolerance: Any) -> Any:
    """Return the speed at which f = mu N v/sqrt(v^2 + tolerance^2) is a part of mu N."""
    return tolerance * part / np.sqrt(1.0 - part * part)


FORMS: Mapping[str, Callable[[Any, Any], Any]] = {
    "linear_zone": _linear_zone,
    "soft_norm": _soft_norm,
}
"""Creep (m/s) by forms of a regularized friction law f = mu N g(v), whatever mu and N are: the solution v of g(v) = p,
where p is friction as a part of mu N.

The form ``linear_zone`` is Exudyn's with its ``friction_zone`` (m/s). The form ``soft_norm`` is that of Drake's
contacts "lagged" and "similar" and of its continuous contacts, with the tolerance ``stiction_tolerance`` (Castro, Han &
Masterjohn 2023, "A theory of irrotational contact fields"). In discrete steps h it holds if the tolerance exceeds
1e-3 w h mu N, where w is the inverse mass of a contact and N its normal force. For smaller tolerances another
regularization, which is the only one of "sap", is the wider one.
"""


class Ramp(Model):
    """Parameters of a scene for a load that increases slowly.

    Attributes
    ----------
    part : float
        Load at the beginning, as a fraction of the limit.
    ramp : float
        Rate of the load, as a fraction of the limit, 1/s.
    t_end : float
        End of the run, s.
    """

    part: Positive
    ramp: Positive
    t_end: Positive


class Stop(Model):
    """Parameters of a scene whose slider stops under a load below the limit.

    Attributes
    ----------
    part : float
        Load, as a fraction of the limit.
    v0 : float
        Initial velocity, m/s.
    landed : float
        Time within which the slider stops, s.
    """

    part: Positive
    v0: Positive
    landed: Positive


class Runs(Model):
    """The runs of a depth.

    Attributes
    ----------
    scenes : tuple of str
        Scenes with which all methods are run.
    loads : tuple of float
        Loads, as fractions of the limit.
    steps : tuple of float
        Fixed steps, s.
    moved : bool
        True if ramp and stop are run, too.
    settings : tuple of str
        Scenes with which settings are varied.
    joint_scenes : tuple of str
        Scenes whose friction has a constant bound, with which all methods are run.
    joint_loads : tuple of float
        Loads of these, as fractions of the bound.
    """

    scenes: tuple[str, ...]
    loads: tuple[Positive, ...]
    steps: tuple[Positive, ...]
    moved: bool
    settings: tuple[str, ...]
    joint_scenes: tuple[str, ...]
    joint_loads: tuple[Positive, ...]


class Law(Model):
    """A law of creep: either an exponent over a setting, or a form that predicts the creep itself.

    Attributes
    ----------
    subject : str
        The method, as in `Subject.label`.
    over : str
        Name of the setting.
    source : str
        Where the law comes from.
    exponent : float or None
        Exponent of the creep over the setting.
    form : str or None
        One of `FORMS`.
    least : float
        Smallest value of the setting for which the law holds.
    """

    subject: str
    over: str
    source: str
    exponent: float | None = None
    form: Literal["linear_zone", "soft_norm"] | None = None
    least: float = 0.0

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield key, value and expectation of a law that has both a form and an exponent, or neither."""
        if (self.exponent is None) == (self.form is None):
            yield "form", self.form, "a form or an exponent"


class Data(Model):
    """Runs, settings and laws of the study.

    Attributes
    ----------
    ramp, stop : Ramp, Stop
        Parameters of the tests beyond the limit.
    depths : dict
        Runs by depth.
    regularization : dict
        By engine and fidelity (``"exudyn, contact"``), the setting with the speed at which friction is regularized.
    subjects : tuple of Subject
        Methods whose settings are varied.
    joint_subjects : tuple of Subject
        Methods that are run, beside the participants, on scenes whose friction has a constant bound.
    laws : tuple of Law
        Laws of creep.
    """

    ramp: Ramp
    stop: Stop
    depths: dict[Depth, Runs]
    regularization: dict[str, str]
    subjects: tuple[Subject, ...]
    joint_subjects: tuple[Subject, ...]
    laws: tuple[Law, ...]


@cache
def load_data() -> Data:
    """Return the content of ``data/hold.toml``."""
    file = resources.files("stiction.comparisons") / "data" / "hold.toml"
    return Data.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))
