"""What runs are held to: a versioned TOML file with every number, its uncertainty and the tier of the truth behind it.

    [[updates]]
    date = "2026-03-01"
    reason = "the event function of the reversal is scaled"

    [runs."pendulum/reference/rtol=1e-09"]
    identity = "reference, joint, rtol = 1e-09; scene 53f1d0c2a9e84b67"
    version = "0.1.0"
    conditions = "AMD EPYC (znver4, avx512f); python 3.11, numpy 2.4.6, scipy 1.17.1, numba 0.68.1"
    status = "ok"
    reason = ""
    accuracy."position error [m]" = { value = 2.1e-10, uncertainty = 1.1e-13, tier = "closed form", rounding = 3.2e-13 }
    counter."rhs" = { value = 2310, tier = "our own run", rounding = 0 }

    [runs."pendulum/truth"]
    identity = "truth; scene 53f1d0c2a9e84b67"
    truth."mass.x at the end [m]" = { value = 0.30864197530864196, uncertainty = 1.1e-13, tier = "closed form" }

A run is found by its identity (see `stiction.comparisons.campaigns.run_identity`), whatever its name. `conditions` (see `environment.conditions`) are those under
which its numbers were made, `version` is that of the engine. `rounding` is how far rounding alone moves a number (`stiction.comparisons.campaigns.rounding`): one that it
moves beyond its tolerance is not judged, which a comment says. `other_ends` are statuses in which the run ends with other rounding.

It is sorted and has one line per number, so that a change of it can be reviewed like code. What our own runs gave (their
errors, events, drift, counters, times) is rewritten by `update`; a truth whose tier is above our own run never is: where it
has moved, the suite that finds it is wrong, or the file must be changed by hand, with the derivation.
"""

from __future__ import annotations

import json
import math
import subprocess
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from stiction.comparisons.atomic_files import write_text
from stiction.comparisons.campaigns.measurement import KINDS, NOT_RUN, RANDOM, TRUTH, Metric, Row, outcome_of
from stiction.comparisons.campaigns.run_identity import parameter_of
from stiction.comparisons.campaigns.tolerances import not_judged
from stiction.comparisons.measures.scene_truth import OWN_RUN
from stiction.comparisons.truth import CLOSED_FORM, HIGH_PRECISION, PROVEN, PUBLISHED
from stiction.scenes import FileError, Problem, StictionError
from stiction.scenes.errors import expectation, found_in
from stiction.scenes.fields import Model
from stiction.scenes.wording import shortened, shown

DEFAULT = Path(str(resources.files("stiction.comparisons") / "baselines" / "nightly.toml"))
"""The baseline of the suite's own campaign."""
FORMAT = 2
DIGITS = 3
"""Significant digits of what is held to a bound of tens of per cent or more; truths and counts are written in full."""
_ROUNDED = ("accuracy", "drift", "time")
_HEAD = """\
# What every run of the campaign is held to; see comparisons/campaigns/baseline.py. Written by `stiction baseline update`, which leaves truths
# of a tier above our own run alone. Reviewed like code.
"""


class BaselineError(FileError):
    """A baseline that cannot be used."""


class BaselineRefused(StictionError):
    """An update would touch a truth; the message names each, with what was found."""


class _Number(Model):
    value: float
    uncertainty: float | None = None
    tier: Literal[PROVEN, CLOSED_FORM, HIGH_PRECISION, PUBLISHED, OWN_RUN]
    rounding: Annotated[float, Field(allow_inf_nan=True)] | None = None


_Numbers = dict[str, _Number]


class Expected(Model):
    """What is expected of a run: its status, why it ended early (empty where it did not), its numbers by kind and name.

    `version` and `conditions` are empty where they are not known; `other_ends` are the outcomes that it has with other rounding.
    """

    identity: str
    version: str = ""
    conditions: str = ""
    status: str = "ok"
    reason: str = ""
    other_ends: tuple[str, ...] = ()
    truth: _Numbers = {}
    accuracy: _Numbers = {}
    motion: _Numbers = {}
    event: _Numbers = {}
    drift: _Numbers = {}
    counter: _Numbers = {}
    time: _Numbers = {}

    @property
    def outcome(self) -> str:
        """As that of a row."""
        return outcome_of(self.status, self.reason)

    @property
    def metrics(self) -> dict[str, Metric]:
        """By name, in the order of the kinds."""
        return {name: Metric(name, kind, number.value, number.uncertainty, number.tier, number.rounding)
                for kind in (TRUTH, *KINDS) for name, number in getattr(self, kind).items()}


class _Update(Model):
    date: str
    reason: str
    commit: str = ""
    machine: str = ""
    versions: str = ""


class Baseline(Model):
    """A baseline: what is expected, by name of the run, and who changed it when and why."""

    format: Literal[FORMAT]
    updates: tuple[_Update, ...] = ()
    runs: dict[str, Expected] = {}

    def expected(self, row: Row) -> Expected | None:
        """What is expected of a run of this identity; where several names have it, under the same name."""
        same = {key: expected for key, expected in self.runs.items() if expected.identity == row.identity}
        return same.get(row.key) or next(iter(same.values()), None)


def load_baseline(reference: str | None = None) -> Baseline:
    """Read a baseline.

    Parameters
    ----------
    reference
        A file; a commit of git, whose version of the suite's own baseline is taken; or ``COMMIT:PATH``, as ``git show`` has it. The
        suite's own file as it is where None.

    Raises
    ------
    BaselineError
        With all problems of the file at once.
    """
    if reference is None or Path(reference).is_file():
        path = DEFAULT if reference is None else Path(reference)
        return _parsed(path.read_bytes(), str(path))
    what = reference if ":" in reference else f"{reference}:./{DEFAULT.name}"
    folder = Path() if ":" in reference else DEFAULT.parent
    try:
        shown_ = subprocess.run(["git", "show", "--end-of-options", what], cwd=folder, capture_output=True, timeout=60, check=True)
    except (OSError, subprocess.SubprocessError) as error:
        words = " ".join((getattr(error, "stderr", None) or str(error).encode()).decode(errors="replace").split())
        raise BaselineError(reference, [Problem("baseline", f"no such file, and git says: {shortened(words, 200)}",
                                                "expected a file, a commit, or COMMIT:PATH")]) from None
    return _parsed(shown_.stdout, what)


def _parsed(text: bytes, origin: str) -> Baseline:
    try:
        raw = tomllib.loads(text.decode())
        if raw.get("runs") and raw.get("format") != FORMAT:  # one problem, not one per run
            raise BaselineError(origin, [Problem("format", shown(raw.get("format")), f"expected {FORMAT}: make it anew with `stiction baseline update`")])
        return Baseline.model_validate(raw)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BaselineError(origin, [Problem("file", shortened(str(error), 160), "expected TOML in UTF-8")]) from None
    except ValidationError as error:
        raise BaselineError(origin, [Problem(shortened(".".join(map(str, detail["loc"])), 200), found_in(detail), expectation(detail))
                                     for detail in error.errors(include_url=False)]) from None


def updated(baseline: Baseline, rows: Iterable[Row], reason: str, origin: Mapping[str, Any], campaign: Collection[str]) -> Baseline:
    """The baseline with what the rows say; runs that were not made keep what they have, unless they are not in the campaign.

    Parameters
    ----------
    origin
        Of the rows, see `environment.origin`.
    campaign
        Keys of all its runs.

    Raises
    ------
    BaselineRefused
        If a truth of a tier above our own run is not, within the uncertainties, what the baseline says, or would be dropped for that of
        another scene under its name.
    """
    runs = {key: expected for key, expected in baseline.runs.items() if key in campaign or _fixed(expected)}
    moved: list[str] = []
    for row in rows:
        if row.status in ("missing", NOT_RUN) or row.variant == RANDOM:
            continue  # says nothing about a run that comes again
        named = baseline.runs.get(row.key)
        if named is not None and named.identity != row.identity and _fixed(named):
            moved.append(f"{row.key}: the baseline's is of another scene of that name ({named.identity}), now {row.identity}")
        old = baseline.expected(row) or Expected(identity=row.identity)
        moved += [f"{row.key}: {fixed.name}: {fixed.value!r}, now {now and now.value!r}: {why}" for fixed, now, why in moved_truths(row, old)]
        runs[row.key] = expected_of(row, origin["conditions"], _fixed(old))
    if moved:
        raise BaselineRefused("\n".join(["a truth of a tier above our own run is not what the baseline says, and no update changes one:",
                                         *(f"  {line}" for line in moved)]))
    update = _Update(date=datetime.now(UTC).date().isoformat(), reason=reason, commit=origin["commit"] or "", machine=origin["machine"]["cpu"],
                     versions=", ".join(f"{name} {version}" for name, version in origin["versions"].items()))
    return Baseline(format=FORMAT, updates=(*baseline.updates, update), runs=runs)


def expected_of(row: Row, conditions: str, fixed: Mapping[str, Metric] = MappingProxyType({})) -> Expected:
    """What a row, made under these conditions, makes expected; numbers that are `fixed` stay as they are."""
    numbers = {metric.name: metric for metric in row.metrics} | dict(fixed)
    return Expected(identity=row.identity, version=row.version or "", conditions=conditions, status=row.status, reason=row.reason, other_ends=row.other_ends,
                    **{kind: {metric.name: _number(metric) for metric in numbers.values() if metric.kind == kind} for kind in (TRUTH, *KINDS)})


def moved_truths(row: Row, expected: Expected) -> Iterator[tuple[Metric, Metric | None, str]]:
    """Truths that no update may touch and that the row contradicts: as expected, as found, and why that is no noise."""
    found = {metric.name: metric for metric in row.metrics}
    for name, fixed in _fixed(expected).items():
        now = found.get(name)
        if now is None:
            yield fixed, now, f"{fixed.tier}; found nothing: {row.reason or row.status}"
        elif abs(now.value - fixed.value) > (allowed := (now.uncertainty or 0.0) + (fixed.uncertainty or 0.0)):
            yield fixed, now, (f"{fixed.tier}, now {now.tier}: they differ by {abs(now.value - fixed.value):.2g}, the uncertainties of both "
                               f"allow {allowed:.2g}")


def _fixed(expected: Expected) -> dict[str, Metric]:
    """The numbers that no update may touch."""
    return {name: metric for name, metric in expected.metrics.items() if metric.kind == TRUTH and metric.tier != OWN_RUN}


def _number(metric: Metric) -> _Number:
    value = _rounded(metric.value) if metric.kind in _ROUNDED else metric.value
    return _Number(value=value, tier=metric.tier, **{name: None if (found := getattr(metric, name)) is None else _rounded(found) for name in ("uncertainty", "rounding")})


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def write_baseline(baseline: Baseline, path: Path) -> None:
    """Write the file, whole or not at all; errors as of `files.whole_file`."""
    write_text(path, _text(baseline))


def _text(baseline: Baseline) -> str:
    lines = [_HEAD, f"format = {FORMAT}"]
    for update in baseline.updates:
        lines += ["", "[[updates]]", *(f"{key} = {_toml(value)}" for key, value in update)]
    for key, expected in sorted(baseline.runs.items()):
        lines += ["", f"[runs.{_toml(key)}]", f"identity = {_toml(expected.identity)}"]
        lines += [f"{name} = {_toml(value)}" for name in ("version", "conditions") if (value := getattr(expected, name))]
        lines += [f"status = {_toml(expected.status)}", f"reason = {_toml(expected.reason)}"]
        lines += [f"other_ends = [{', '.join(map(_toml, expected.other_ends))}]"] if expected.other_ends else []
        why = {name: not_judged(metric, parameter_of(key)) for name, metric in expected.metrics.items()}
        for kind in (TRUTH, *KINDS):
            for name, number in sorted(getattr(expected, kind).items()):
                inner = ", ".join(f"{field} = {_toml(value)}" for field, value in number if value is not None)
                lines.append(f"{kind}.{_toml(name)} = {{ {inner} }}" + (f"  # {why[name]}" if why[name] else ""))
    return "\n".join(lines) + "\n"


def _toml(value: str | float) -> str:
    """A string or a number as TOML has it; a basic string escapes as JSON does."""
    if value == math.inf:
        return "inf"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(int(value)) if value.is_integer() and abs(value) < 2 ** 53 else repr(value)
