"""Truths whose motion and events are proven: what the certificates that come with the suite say is their uncertainty.

A certificate holds polynomials in floats for positions and velocities of all bodies, a proven bound of what each is off at most, and
the events. To read one takes no ball arithmetic, so that the tier of a truth does not depend on what is installed. It is bound
to what the scene says (`scene_digest`): a scene that says anything else has the truth of the tier below. `truth_certificate` makes and checks them.
"""

from __future__ import annotations

import gzip
import json
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from stiction.comparisons.digest import SHORT, digest
from stiction.comparisons.proof.theorems import Contradiction
from stiction.comparisons.truth.truth import PROVEN, Truth
from stiction.scenes import Scene, scene_to_toml

FORMAT = "stiction truth proof 1"
SUFFIX = ".json.gz"
DATA = Path(str(resources.files("stiction.comparisons") / "data"))
"""Where the certificates are."""
_INSTANTS = 499
_ESTIMATED = 10.0
"""By how many times its estimated uncertainty a truth may be off what is proven: a wrong equation is off by more."""
_AT_THE_END = 1e-6
"""s; truths leave out an event that is so close to their end."""
_UNPROVEN = ("title", "source", "t_end", "stabilization", "parameters")
"""Of a scene, what the motion up to an earlier end does not depend on; parameters are put in where they are used."""
_NAME = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class ProvenColumns:
    """Columns as polynomials in floats.

    Attributes
    ----------
    starts : ndarray, shape (legs,)
        Seconds; each leg ends where the next one starts.
    coefficients : dict of ndarray
        By column, shape (legs, terms), from the lowest power of the time since the start of the leg.
    derivatives : Mapping[str, str]
        By column, that whose derivative it is.
    errors : Mapping[str, float]
        By column, what it is off at most, its evaluation in floats included.
    """

    starts: np.ndarray
    coefficients: dict[str, np.ndarray]
    derivatives: Mapping[str, str]
    errors: Mapping[str, float]

    def __call__(self, t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        """The columns at times t, by Horner's rule."""
        owner = np.maximum(np.searchsorted(self.starts, t, side="right" if side == "after" else "left") - 1, 0)
        tau, found = t - self.starts[owner], {}
        slopes = {name: self.coefficients[of][:, 1:] * np.arange(1, self.coefficients[of].shape[1]) for name, of in self.derivatives.items()}
        for name, terms in (self.coefficients | slopes).items():
            value = np.zeros(len(t))
            for k in range(terms.shape[1] - 1, -1, -1):
                value = value * tau + terms[owner, k]
            found[name] = value
        return found


@dataclass(frozen=True)
class ProvenTruth:
    """What a certificate says of a motion from 0 to t_end: columns, and events (kind, joint, time) known to `width` seconds."""

    t_end: float
    columns: ProvenColumns
    events: tuple[tuple[str, str, float], ...]
    width: float

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> ProvenTruth:
        """The tables of a certificate."""
        columns = ProvenColumns(np.array(told["starts"]), {name: _rectangular(legs) for name, legs in told["coefficients"].items()},
                                dict(told["derivatives"]), dict(told["errors"]))
        return cls(told["t_end"], columns, tuple(tuple(event) for event in told["events"]), told["event time"])


def scene_digest(text: str) -> str:
    """Of what the text of a scene says of its motion, numbers as they are written, whatever its parameters are called."""
    raw = tomllib.loads(text)
    content = {key: _put_in(value, raw.get("parameters", {})) for key, value in raw.items() if key not in _UNPROVEN}
    return digest(content)[:SHORT]


def certificates() -> list[Path]:
    """The files that come with the suite, named by scene and digest."""
    return sorted(DATA.glob(f"truth-*{SUFFIX}"))


def with_proof(scene: Scene, truth: Truth) -> Truth:
    """The truth with proven positions, velocities and events, tier "proven", where a certificate is of this scene; as it is otherwise.

    Raises
    ------
    Contradiction
        If the truth has other events, or columns that differ by more than they may.
    """
    proven = _proven(scene_digest(scene_to_toml(scene)))
    if proven is None or truth.t_end > proven.t_end:
        return truth
    count, kinds = len(truth.events), [(event.kind, event.joint) for event in truth.events]
    if kinds != [event[:2] for event in proven.events[:count]] or any(event[2] < truth.t_end - _AT_THE_END for event in proven.events[count:]):
        raise Contradiction(f"{truth.scene}: found events {_words(kinds)}; proven are {_words([event[:2] for event in proven.events])}")
    errors = {name: error for name, error in proven.columns.errors.items() if name in truth.uncertainty}
    instants = np.linspace(0.0, truth.t_end, _INSTANTS)
    estimated, enclosed = truth.columns(instants, "after"), proven.columns(instants, "after")
    for name, error in errors.items():
        off, allowed = float(np.max(np.abs(estimated[name] - enclosed[name]))), _ESTIMATED * truth.uncertainty[name] + error
        if not off <= allowed:
            raise Contradiction(f"{truth.scene}: {name}: found a truth {off:.2g} off what is proven; expected at most {allowed:.2g}")
    times = [time for _, _, time in proven.events[:count]]
    return replace(truth, tier=PROVEN, tier_below=truth.tier, columns=_columns(truth, proven.columns, times),
                   uncertainty={**truth.uncertainty, **errors, "event time": proven.width},
                   events=tuple(replace(event, time=time) for event, time in zip(truth.events, times)))


def _columns(truth: Truth, proven: ProvenColumns, times: list[float]) -> Callable[[np.ndarray, str], dict[str, np.ndarray]]:
    known = [event.time for event in truth.events]

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        at = t.copy()
        for time, own in zip(times, known):  # the truth tells the sides of an event apart at its own time for it
            at[t == time] = own
        found = truth.columns(at, side)
        return found | {name: values for name, values in proven(t, side).items() if name in found}

    return columns


@lru_cache(maxsize=4)
def _proven(digest: str) -> ProvenTruth | None:
    file = next((file for file in certificates() if file.name.endswith(f".{digest}{SUFFIX}")), None)
    return None if file is None else ProvenTruth.of(json.loads(gzip.decompress(file.read_bytes())))


def _rectangular(legs: list[list[float]]) -> np.ndarray:
    """Coefficients with as many terms for every leg."""
    found = np.zeros((len(legs), max(map(len, legs))))
    for row, terms in zip(found, legs):
        row[:len(terms)] = terms
    return found


def _put_in(value: Any, parameters: Mapping[str, Any]) -> Any:
    if isinstance(value, dict):
        return {key: _put_in(inner, parameters) for key, inner in value.items()}
    if isinstance(value, list):
        return [_put_in(inner, parameters) for inner in value]
    if not isinstance(value, str):
        return value
    if value in parameters:
        return _put_in(parameters[value], parameters)
    return _NAME.sub(lambda name: f"({_put_in(parameters[name[0]], parameters)})" if name[0] in parameters else name[0], value)


def _words(events: list[tuple[str, str]]) -> str:
    return ", ".join(f"{kind} of {joint}" for kind, joint in events) or "none"
