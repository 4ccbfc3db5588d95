"""Proven truths and thresholds that come with the suite, with the uncertainty of their certificates.

A certificate contains polynomials in floats for positions and velocities of all bodies, a proven bound of the error of
each, and the events. It is read without ball arithmetic, so that the tier of a truth does not depend on the installed
packages. It belongs to the content of a scene (`motion_digest`); all other scenes have the truth of the next tier.
`truth_certificate` makes and checks certificates. A theorem on a threshold is a file of
`stiction prove SCENE --threshold N --out FILE`.
"""

from __future__ import annotations

import gzip
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from importlib import resources
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from stiction.scenes import Scene, StictionError, scene_from_dict
from stiction.scenes.digest import SHORT, digest
from stiction.truths import StickThreshold, Tier, Truth
from stiction.truths.reduced.slider_bar import SliderBar

DATA = Path(str(resources.files("stiction.comparisons") / "data"))
"""Folder of the certificates."""
SUFFIX = ".json.gz"
"""Ending of the certificates of motions."""
_INSTANTS = 499
"""Number of instants at which a truth is compared with its proof."""
_ESTIMATED = 10.0
"""Largest distance of a truth from the proof, in units of its estimated uncertainty. A wrong equation exceeds it."""
_AT_THE_END = 1e-6
"""Time before the end, s, within which truths leave out events."""
_UNPROVEN = ("title", "source", "t_end", "stabilization", "parameters")
"""Tables of a scene without effect on the motion up to an earlier end; parameters are replaced by their values."""
_NAME = re.compile(r"[A-Za-z_]\w*")
"""Names in an expression."""


class Contradiction(StictionError, AssertionError):
    """A truth in floats differs from its proof by more than its uncertainty."""


@dataclass(frozen=True)
class ProvenTruth:
    """A motion from 0 to t_end by its certificate, in legs with polynomials in floats.

    Attributes
    ----------
    t_end : float
        End of the motion, s.
    starts : ndarray, shape (legs,)
        Start of each leg, s, which is the end of the previous one.
    coefficients : dict
        By column, the coefficients of the polynomials of the time since the start of the leg, from the lowest power,
        shape (legs, terms).
    derivatives : Mapping
        By column without coefficients, the column whose derivative it is.
    errors : Mapping
        By column, the bound of the error, which includes the evaluation in floats.
    events : tuple of tuple
        Kind, joint and time (s) of each event.
    event_time : float
        Bound of the error of the times of events, s.
    """

    t_end: float
    starts: np.ndarray
    coefficients: dict[str, np.ndarray]
    derivatives: Mapping[str, str]
    errors: Mapping[str, float]
    events: tuple[tuple[str, str, float], ...]
    event_time: float

    @classmethod
    def of(cls, claims: Mapping[str, Any]) -> ProvenTruth:
        """Return the motion in the tables of a certificate."""
        # Legs have different numbers of terms, and are filled with zeros.
        coefficients = {
            name: np.array([*zip_longest(*legs, fillvalue=0.0)]).T
            for name, legs in claims["coefficients"].items()
        }
        return cls(
            claims["t_end"],
            np.array(claims["starts"]),
            coefficients,
            claims["derivatives"],
            claims["errors"],
            tuple(map(tuple, claims["events"])),
            claims["event time"],
        )

    def columns(self, t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        """Return the columns at times t (s), by Horner's rule; `side` selects the leg at an event."""
        following = np.searchsorted(self.starts, t, side="right" if side == "after" else "left")
        leg = np.maximum(following - 1, 0)
        tau = t - self.starts[leg]
        columns = dict(self.coefficients)
        columns |= {name: polyder(columns[of], axis=1) for name, of in self.derivatives.items()}
        return {name: polyval(tau, terms[leg].T, tensor=False) for name, terms in columns.items()}


def motion_digest(text: str) -> str:
    """Return the digest of the parts of a scene's text that affect its motion.

    Numbers are taken as they are written; names of parameters have no effect.
    """
    raw = tomllib.loads(text)
    content = {
        key: _substitute(value, raw.get("parameters", {}))
        for key, value in raw.items()
        if key not in _UNPROVEN
    }
    return digest(content)[:SHORT]


def certificates() -> list[Path]:
    """Return the certificates of motions that come with the suite, whose names contain scene and digest."""
    return sorted(DATA.glob(f"truth-*{SUFFIX}"))


def certificate_of(scene: Scene) -> Path | None:
    """Return the file that proves the motion of a scene; None if there is none."""
    digest_of_motion = motion_digest(scene.to_toml())
    for file in DATA.glob(f"truth-*.{digest_of_motion}{SUFFIX}"):
        return file
    return None


def with_proof(scene: Scene, truth: Truth) -> Truth:
    """Return a truth with proven positions, velocities and events if there is a certificate, otherwise unchanged.

    Raises
    ------
    Contradiction
        If the truth has other events, or columns that differ by more than their uncertainties.
    """
    file = certificate_of(scene)
    proven = None if file is None else _read(file)
    if proven is None or truth.t_end > proven.t_end:
        return truth

    times = _proven_event_times(truth, proven)
    errors = {name: error for name, error in proven.errors.items() if name in truth.uncertainty}
    _check_columns(truth, proven, errors)

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        """Return the columns of the truth, with proven ones instead of its own."""
        # At the proven time of an event the truth is evaluated at its own time of the event, where it
        # has the two sides.
        own_times = t.copy()
        for time, event in zip(times, truth.events):
            own_times[t == time] = event.time
        columns = dict(truth.columns(own_times, side))
        for name, values in proven.columns(t, side).items():
            if name in columns:
                columns[name] = values
        return columns

    return replace(
        truth,
        tier=Tier.PROVEN,
        tier_below=truth.tier,
        columns=columns,
        uncertainty={**truth.uncertainty, **errors, "event time": proven.event_time},
        events=tuple(replace(event, time=float(time)) for event, time in zip(truth.events, times)),
    )


def _proven_event_times(truth: Truth, proven: ProvenTruth) -> np.ndarray:
    """Return the proven times (s) of the events of a truth; raise Contradiction if other events are proven."""
    # The proof may continue beyond the end of the truth; its later events have to be there.
    in_truth = [(event.kind, event.joint) for event in truth.events]
    in_proof = [(kind, joint) for kind, joint, _ in proven.events]
    times, later = np.split([time for *_, time in proven.events], [len(in_truth)])
    if in_truth != in_proof[: len(in_truth)] or any(later < truth.t_end - _AT_THE_END):
        raise Contradiction(
            f"{truth.scene}: found events {_describe(in_truth)}; proven are {_describe(in_proof)}"
        )
    return times


def _check_columns(truth: Truth, proven: ProvenTruth, errors: Mapping[str, float]) -> None:
    """Raise Contradiction if columns of a truth and their proofs differ by more than both uncertainties."""
    instants = np.linspace(0.0, truth.t_end, _INSTANTS)
    estimated = truth.columns(instants, "after")
    enclosed = proven.columns(instants, "after")
    for name, error in errors.items():
        difference = np.max(np.abs(estimated[name] - enclosed[name]))
        allowed = _ESTIMATED * truth.uncertainty[name] + error
        if not difference <= allowed:
            raise Contradiction(
                f"{truth.scene}: {name}: found a truth {difference:.2g} off what is proven; "
                f"expected at most {allowed:.2g}"
            )


def threshold_of_theorem(scene: Scene) -> StickThreshold | None:
    """Return the threshold of a scene if a theorem on it comes with the suite; its uncertainty is half the interval."""
    mechanism = SliderBar.from_scene(scene)
    for file in sorted(DATA.glob("threshold-*.json")):
        claims = json.loads(file.read_text(encoding="utf-8"))
        proven = SliderBar.from_scene(
            scene_from_dict(tomllib.loads(claims["file"]), claims["scene"])
        )
        # The theorem is about this scene if all parameters except the amplitude are the same.
        if replace(mechanism, F0=proven.F0) == proven:
            low, high = (Fraction(claims[end]["F0 [N]"]) for end in ("low", "high"))
            return StickThreshold(
                float((low + high) / 2),
                float(high - low) / 2,
                (float(low), float(high)),
                theorem=" ".join(claims["theorem"]),
            )
    return None


@lru_cache(maxsize=4)
def _read(file: Path) -> ProvenTruth:
    """Return the motion of a certificate."""
    return ProvenTruth.of(json.loads(gzip.decompress(file.read_bytes())))


def _substitute(value: Any, parameters: Mapping[str, Any]) -> Any:
    """Return a value with the names of parameters replaced by their contents, so that names do not affect a digest."""
    if isinstance(value, dict):
        return {key: _substitute(inner, parameters) for key, inner in value.items()}
    if isinstance(value, list):
        return [_substitute(inner, parameters) for inner in value]
    if not isinstance(value, str):
        return value
    if value in parameters:
        return _substitute(parameters[value], parameters)

    def content(match: re.Match[str]) -> str:
        name = match[0]
        if name not in parameters:
            return name
        return f"({_substitute(parameters[name], parameters)})"

    return _NAME.sub(content, value)


def _describe(events: list[tuple[str, str]]) -> str:
    """Return events, by kind and joint, in words."""
    return ", ".join(f"{kind} of {joint}" for kind, joint in events) or "none"
