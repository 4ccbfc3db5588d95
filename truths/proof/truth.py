"""Truths and thresholds that come proven with the suite: their uncertainty is that of their certificates.

A certificate holds polynomials in floats for positions and velocities of all bodies, a proven bound of the error of
each, and the events. To read one takes no ball arithmetic, so that the tier of a truth does not depend on what is
installed. It is bound to the content of the scene (`motion_digest`): any other scene has the truth of the tier below.
`truth_certificate` makes and checks them. A theorem on a threshold is a file of
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

from stiction.scenes import Scene, StictionError, scene_from_dict, scene_to_toml
from stiction.scenes.digest import SHORT, digest
from stiction.truths import StickThreshold, Tier, Truth
from stiction.truths.reduced.slider_bar import SliderBar

DATA = Path(str(resources.files("stiction.comparisons") / "data"))
"""Folder of the certificates."""
SUFFIX = ".json.gz"
_INSTANTS = 499
"""Instants at which a truth is compared with its proof."""
_ESTIMATED = 10.0
"""Multiple of its estimated uncertainty by which a truth may be off the proof: a wrong equation is off by more."""
_AT_THE_END = 1e-6
"""s; truths leave out an event that is so close to their end."""
_UNPROVEN = ("title", "source", "t_end", "stabilization", "parameters")
"""Parts of a scene that its motion up to an earlier end does not depend on; parameters count where they are used."""
_NAME = re.compile(r"[A-Za-z_]\w*")


class Contradiction(StictionError, AssertionError):
    """A truth in floats that differs from what is proven by more than its uncertainty."""


@dataclass(frozen=True)
class ProvenTruth:
    """A motion from 0 to t_end by its certificate: columns as polynomials in floats, and events.

    Each of the legs that begin at `starts` (s) ends where the next one does. By column, `coefficients` (legs, terms)
    are those of the time since the start of the leg, from the lowest power. `derivatives` names the column whose
    derivative another one is. `errors` bounds the error of each, that of its evaluation in floats included. `events`,
    by kind, joint and time, are known to `event_time` seconds.
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
        """Read the tables of a certificate."""
        # legs have as many terms as they need; zeros make one array of them
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
        """The columns at times t, by Horner's rule."""
        # at the start of a leg both it and the one before hold, the two sides of an event
        leg = np.maximum(
            np.searchsorted(self.starts, t, side="right" if side == "after" else "left") - 1, 0
        )
        tau, columns = t - self.starts[leg], dict(self.coefficients)
        columns |= {name: polyder(columns[of], axis=1) for name, of in self.derivatives.items()}
        return {name: polyval(tau, terms[leg].T, tensor=False) for name, terms in columns.items()}


def motion_digest(text: str) -> str:
    """Digest of a scene's text as far as its motion depends on it; numbers as written, names of parameters left out."""
    raw = tomllib.loads(text)
    content = {
        key: _put_in(value, raw.get("parameters", {}))
        for key, value in raw.items()
        if key not in _UNPROVEN
    }
    return digest(content)[:SHORT]


def certificates() -> list[Path]:
    """The files that come with the suite, named by scene and digest."""
    return sorted(DATA.glob(f"truth-*{SUFFIX}"))


def certificate_of(scene: Scene) -> Path | None:
    """The file that proves the motion of a scene; None without one."""
    return next(DATA.glob(f"truth-*.{motion_digest(scene_to_toml(scene))}{SUFFIX}"), None)


def with_proof(scene: Scene, truth: Truth) -> Truth:
    """The truth with proven positions, velocities and events where a certificate is of its scene; else as it is.

    Raises Contradiction where the truth has other events, or columns that differ by more than they may.
    """
    file = certificate_of(scene)
    proven = None if file is None else _read(file)
    if proven is None or truth.t_end > proven.t_end:
        return truth

    # The events must be the same. The proof may go on beyond the truth's end: its later events have
    # to lie there.
    in_truth = [(event.kind, event.joint) for event in truth.events]
    in_proof = [(kind, joint) for kind, joint, _ in proven.events]
    times, later = np.split([time for *_, time in proven.events], [len(in_truth)])
    if in_truth != in_proof[: len(in_truth)] or any(later < truth.t_end - _AT_THE_END):
        raise Contradiction(
            f"{truth.scene}: found events {_words(in_truth)}; proven are {_words(in_proof)}"
        )

    # Columns that are in both must agree to the sum of their uncertainties.
    errors = {name: error for name, error in proven.errors.items() if name in truth.uncertainty}
    instants = np.linspace(0.0, truth.t_end, _INSTANTS)
    estimated, enclosed = truth.columns(instants, "after"), proven.columns(instants, "after")
    for name, error in errors.items():
        off = np.max(np.abs(estimated[name] - enclosed[name]))
        allowed = _ESTIMATED * truth.uncertainty[name] + error
        if not off <= allowed:
            raise Contradiction(
                f"{truth.scene}: {name}: found a truth {off:.2g} off what is proven; "
                f"expected at most {allowed:.2g}"
            )

    def columns(t: np.ndarray, side: str) -> dict[str, np.ndarray]:
        # At the proven time of an event the truth is asked at its own time of it, where it has the
        # event's two sides.
        asked = t.copy()
        for time, event in zip(times, truth.events):
            asked[t == time] = event.time
        columns = dict(truth.columns(asked, side))
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


def threshold_of_theorem(scene: Scene) -> StickThreshold | None:
    """Return the proven threshold where the scene is that of a theorem; its uncertainty is half the interval."""
    mechanism = SliderBar.from_scene(scene)
    for file in sorted(DATA.glob("threshold-*.json")):
        claims = json.loads(file.read_text(encoding="utf-8"))
        proven = SliderBar.from_scene(
            scene_from_dict(tomllib.loads(claims["file"]), claims["scene"])
        )
        # all parameters but the amplitude, which is what the threshold is of
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
    return ProvenTruth.of(json.loads(gzip.decompress(file.read_bytes())))


def _put_in(value: Any, parameters: Mapping[str, Any]) -> Any:
    """Replace the names of parameters in a value by their contents, so that names do not enter a digest."""
    if isinstance(value, dict):
        return {key: _put_in(inner, parameters) for key, inner in value.items()}
    if isinstance(value, list):
        return [_put_in(inner, parameters) for inner in value]
    if not isinstance(value, str):
        return value
    if value in parameters:
        return _put_in(parameters[value], parameters)

    def content(name: re.Match[str]) -> str:
        return f"({_put_in(parameters[name[0]], parameters)})" if name[0] in parameters else name[0]

    return _NAME.sub(content, value)


def _words(events: list[tuple[str, str]]) -> str:
    return ", ".join(f"{kind} of {joint}" for kind, joint in events) or "none"
