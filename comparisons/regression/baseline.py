"""Baselines: what runs are compared with, as a TOML file with all numbers, their uncertainties and the tiers of truths.

    [[updates]]
    date = "2026-03-01"
    reason = "the event function of the reversal is scaled"

    [runs."pendulum/reference/rtol=1e-09"]
    identity = "reference, joint, rtol = 1e-09; scene 53f1d0c2a9e84b67"
    version = "0.1.0"
    conditions = "AMD EPYC (znver4, avx512f); python 3.11, numpy 2.4.6, scipy 1.17.1, numba 0.68.1"
    status = "ok"
    reason = ""
    accuracy."position_error" = { value = 2.1e-10, uncertainty = 1.1e-13, tier = "closed form", rounding = 3.2e-13 }
    counter."rhs" = { value = 2310, tier = "our own run", rounding = 0 }

    [runs."pendulum/truth"]
    identity = "truth; scene 53f1d0c2a9e84b67"
    truth."end:mass.x" = { value = 0.30864197530864196, uncertainty = 1.1e-13, tier = "closed form" }

A run is identified by its identity (`planned_runs.PlannedRun.identity`), whatever its name. `conditions` are those
under which its numbers were computed (`environment.conditions`), `version` is that of the engine. `rounding` is the
largest change of a number by rounding alone (`tolerances.with_rounding`). If it exceeds the tolerance of the number,
the number is not judged, and a comment says so. `other_ends` are the statuses with which the run ends if the rounding
differs.

The file is sorted and has one line per number, so that changes of it can be reviewed like code. `updated` rewrites
errors, events, drift, counters and times of our own runs, but never a truth of a tier above our own run. If such a
truth has changed, either the code that computes it is wrong, or the file must be edited by hand, with the derivation.
"""

from __future__ import annotations

import json
import subprocess
import tomllib
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, ValidationError

from stiction.comparisons.bench.planned_runs import (
    KINDS,
    TRUTH,
    Metric,
    Row,
    outcome_of,
)
from stiction.comparisons.regression.tolerances import not_judged
from stiction.engines.status import Status
from stiction.scenes import FileError, Problem, StictionError
from stiction.scenes.atomic_files import write_text
from stiction.scenes.errors import expectation, found_in
from stiction.scenes.fields import Model
from stiction.scenes.wording import shortened, shown
from stiction.truths import Tier

DEFAULT = Path(str(resources.files("stiction.comparisons") / "baselines" / "nightly.toml"))
"""The baseline of the suite's own campaign."""
FORMAT: Final = 2
"""Version of the format; a file of another version is not read."""
DIGITS = 3
"""Significant digits of numbers whose bounds are tens of per cent or more; truths and counts are written in full."""
_ROUNDED = ("accuracy", "drift", "time")
"""Kinds of numbers whose values are written with `DIGITS`."""
GIT_TIMEOUT_S = 60
"""Time that git may take to return a file, s."""
_HEAD = (
    "# What every run of the campaign is held to; see comparisons/regression/baseline.py. "
    "Written by `stiction baseline update`, which leaves truths\n"
    "# of a tier above our own run alone. Reviewed like code.\n"
)


class BaselineError(FileError):
    """Raised for a baseline that cannot be used."""


class BaselineRefused(StictionError):
    """Raised if an update would change a truth; the message names each truth and the value found."""


def _check_tier(tier: Tier) -> Tier:
    """Return a tier, unless it is that of an unknown truth."""
    if tier == Tier.NONE:
        raise ValueError("expected the tier of a truth")
    return tier


class _Number(Model):
    """A number of a run; see `Metric` for its fields."""

    value: float
    uncertainty: float | None = None
    tier: Annotated[Tier, AfterValidator(_check_tier)]
    rounding: Annotated[float, Field(allow_inf_nan=True)] | None = None


_Numbers = dict[str, _Number]


class Expected(Model):
    """A run as it is expected.

    Attributes
    ----------
    identity : str
        Identity of the run.
    version, conditions : str
        Version of the engine, and conditions of the run; empty if unknown.
    status, reason : Status, str
        Status of the run, and why it ended early; the reason is empty if it did not.
    other_ends : tuple of Status
        Statuses with which the run ends if the rounding differs.
    truth, accuracy, motion, event, drift, counter, time : dict
        Numbers by name; the fields are the kinds of numbers.
    """

    identity: str
    version: str = ""
    conditions: str = ""
    status: Status = Status.OK
    reason: str = ""
    other_ends: tuple[Status, ...] = ()
    truth: _Numbers = {}
    accuracy: _Numbers = {}
    motion: _Numbers = {}
    event: _Numbers = {}
    drift: _Numbers = {}
    counter: _Numbers = {}
    time: _Numbers = {}

    @property
    def outcome(self) -> Status:
        """Status of the run, `Status.INCOMPLETE` if it ended early."""
        return outcome_of(self.status, self.reason)

    @property
    def metrics(self) -> dict[str, Metric]:
        """Numbers of all kinds, by name."""
        return {
            name: Metric(name, kind, number.value, number.uncertainty, number.tier, number.rounding)
            for kind in (TRUTH, *KINDS)
            for name, number in getattr(self, kind).items()
        }

    @property
    def fixed(self) -> dict[str, Metric]:
        """Truths that no update may change, by name: those of a tier above our own run."""
        return {
            name: metric
            for name, metric in self.metrics.items()
            if metric.kind == TRUTH and metric.tier != Tier.OWN_RUN
        }


class _Update(Model):
    """A change of a baseline: when and why it was made, and where its numbers were computed."""

    date: str
    reason: str
    commit: str = ""
    machine: str = ""
    versions: str = ""


class Baseline(Model):
    """A baseline: the expected runs by key, and its changes in order of time."""

    format: Literal[2]
    updates: tuple[_Update, ...] = ()
    runs: dict[str, Expected] = {}

    def expected(self, row: Row) -> Expected | None:
        """Return the expected run with the identity of a row; None if there is none.

        If there are several, the one with the key of the row is returned, or else the first.
        """
        namesake = self.runs.get(row.key)
        if namesake is not None and namesake.identity == row.identity:
            return namesake
        for expected in self.runs.values():
            if expected.identity == row.identity:
                return expected
        return None


def load_baseline(reference: str | None = None) -> Baseline:
    """Read a baseline.

    Parameters
    ----------
    reference
        A file, a commit of git for the suite's own baseline, or ``COMMIT:PATH`` as in ``git show``; the suite's own
        file if None.

    Raises
    ------
    BaselineError
        If there is no such file, or with all problems of the file.
    """
    if reference is None:
        return _parsed(DEFAULT.read_bytes(), str(DEFAULT))
    if Path(reference).is_file():
        return _parsed(Path(reference).read_bytes(), reference)
    if ":" in reference:
        return _parsed(_git_show(reference, reference, None), reference)
    in_commit = f"{reference}:./{DEFAULT.name}"
    return _parsed(_git_show(in_commit, reference, DEFAULT.parent), in_commit)


def _git_show(blob: str, reference: str, folder: Path | None) -> bytes:
    """Return a file of a commit, ``COMMIT:PATH``, where paths are relative to a folder or the working folder.

    Raises
    ------
    BaselineError
        If git does not return it. The message contains the reference that the user gave.
    """
    try:
        result = subprocess.run(
            ["git", "show", "--end-of-options", blob],
            capture_output=True,
            timeout=GIT_TIMEOUT_S,
            check=True,
            cwd=folder,
        )
    except (OSError, subprocess.SubprocessError) as error:
        # What git printed tells more than the exception.
        message = getattr(error, "stderr", None) or str(error).encode()
        words = " ".join(message.decode(errors="replace").split())
        problem = Problem(
            "baseline",
            f"no such file, and git says: {shortened(words, 200)}",
            "expected a file, a commit, or COMMIT:PATH",
        )
        raise BaselineError(reference, [problem]) from None
    return result.stdout


def _parsed(text: bytes, origin: str) -> Baseline:
    """Return the baseline in a TOML text, or raise `BaselineError` with all of its problems.

    `origin` is the name of the text in messages.
    """
    try:
        raw = tomllib.loads(text.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        problem = Problem("file", shortened(str(error), 160), "expected TOML in UTF-8")
        raise BaselineError(origin, [problem]) from None
    if raw.get("runs") and raw.get("format") != FORMAT:
        # A file of another format would have the same problem in each of its runs.
        problem = Problem(
            "format",
            shown(raw.get("format")),
            f"expected {FORMAT}: make it anew with `stiction baseline update`",
        )
        raise BaselineError(origin, [problem])
    try:
        return Baseline.model_validate(raw)
    except ValidationError as error:
        problems = []
        for detail in error.errors(include_url=False):
            key = ".".join(map(str, detail["loc"]))
            problems.append(Problem(shortened(key, 200), found_in(detail), expectation(detail)))
        raise BaselineError(origin, problems) from None


def updated(
    baseline: Baseline,
    rows: Iterable[Row],
    reason: str,
    origin: Mapping[str, Any],
    campaign: Collection[str],
) -> Baseline:
    """Return a baseline with the numbers of new runs.

    Parameters
    ----------
    rows
        The new runs. Runs that could not be made do not change the baseline.
    reason
        Why the baseline is changed.
    origin
        The `environment.origin` of the new runs.
    campaign
        Keys of all runs of the campaign. Other runs are dropped from the baseline, unless they contain a truth.

    Raises
    ------
    BaselineRefused
        If a truth of a tier above our own run differs from the baseline by more than the uncertainties, or would be
        replaced by that of another scene with the same name.
    """
    runs = {
        key: expected
        for key, expected in baseline.runs.items()
        if key in campaign or expected.fixed
    }
    conflicts: list[str] = []
    for row in rows:
        if row.status in (Status.MISSING, Status.NOT_RUN):
            continue
        conflicts += _conflicts(row, baseline)
        old = baseline.expected(row)
        fixed = {} if old is None else old.fixed
        runs[row.key] = expected_of(row, origin["conditions"], fixed)
    if conflicts:
        title = "a truth of a tier above our own run is not what the baseline says, and no update changes one:"
        raise BaselineRefused("\n  ".join([title, *conflicts]))
    return Baseline(format=FORMAT, updates=(*baseline.updates, _update(reason, origin)), runs=runs)


def _conflicts(row: Row, baseline: Baseline) -> Iterator[str]:
    """Yield in words each truth of a baseline that an update by a row would change, but must not."""
    namesake = baseline.runs.get(row.key)
    if namesake is not None and namesake.identity != row.identity and namesake.fixed:
        yield (
            f"{row.key}: the baseline's is of another scene of that name ({namesake.identity}), "
            f"now {row.identity}"
        )
    expected = baseline.expected(row)
    if expected is None:
        return
    for fixed, now, reason in moved_truths(row, expected):
        value = None if now is None else now.value
        yield f"{row.key}: {fixed.name}: {fixed.value!r}, now {value!r}: {reason}"


def _update(reason: str, origin: Mapping[str, Any]) -> _Update:
    """Return the record of a change that is made today."""
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    return _Update(
        date=datetime.now(UTC).date().isoformat(),
        reason=reason,
        commit=origin["commit"] or "",
        machine=origin["machine"]["cpu"],
        versions=versions,
    )


def expected_of(
    row: Row, conditions: str, fixed: Mapping[str, Metric] = MappingProxyType({})
) -> Expected:
    """Return a row, whose run was made under these conditions, as it is expected from now on.

    Numbers that are `fixed`, by name, replace those of the row.
    """
    metrics = {metric.name: metric for metric in row.metrics}
    metrics.update(fixed)
    numbers: dict[str, dict[str, _Number]] = defaultdict(dict)
    for metric in metrics.values():
        numbers[metric.kind][metric.name] = _number(metric)
    return Expected(
        identity=row.identity,
        version=row.version or "",
        conditions=conditions,
        status=row.status,
        reason=row.reason,
        other_ends=row.other_ends,
        **numbers,
    )


def _number(metric: Metric) -> _Number:
    """Return a number as it is written to a baseline."""
    value = metric.value
    if metric.kind in _ROUNDED:
        value = _with_few_digits(value)
    return _Number(
        value=value,
        uncertainty=_with_few_digits(metric.uncertainty),
        tier=metric.tier,
        rounding=_with_few_digits(metric.rounding),
    )


def _with_few_digits(value: Any) -> Any:
    """Return a number with `DIGITS` significant digits; None stays None."""
    return None if value is None else float(f"{value:.{DIGITS}g}")


def moved_truths(row: Row, expected: Expected) -> Iterator[tuple[Metric, Metric | None, str]]:
    """Yield the truths that no update may change and that a row contradicts.

    Each is yielded as expected, as in the row (None if the row lacks it), and with the reason in words.
    """
    measured = {metric.name: metric for metric in row.metrics}
    for name, fixed in expected.fixed.items():
        now = measured.get(name)
        if now is None:
            yield fixed, now, f"{fixed.tier.label}; found nothing: {row.reason or row.status}"
            continue
        allowed = (now.uncertainty or 0.0) + (fixed.uncertainty or 0.0)
        difference = abs(now.value - fixed.value)
        # Written such that a truth that is not a number is a contradiction, too.
        if not difference <= allowed:
            reason = (
                f"{fixed.tier.label}, now {now.tier.label}: they differ by {difference:.2g}, "
                f"the uncertainties of both allow {allowed:.2g}"
            )
            yield fixed, now, reason


def write_baseline(baseline: Baseline, path: Path) -> None:
    """Write a baseline to a file, completely or not at all (`atomic_files.whole_file`)."""
    lines = [_HEAD, f"format = {FORMAT}"]
    for update in baseline.updates:
        lines += ["", "[[updates]]"]
        lines += [f"{key} = {_toml(value)}" for key, value in update]
    for key, expected in sorted(baseline.runs.items()):
        lines += ["", f"[runs.{_toml(key)}]", *_lines_of(key, expected)]
    write_text(path, "\n".join(lines) + "\n")


def _lines_of(key: str, expected: Expected) -> Iterator[str]:
    """Yield the lines of a run below its heading."""
    yield f"identity = {_toml(expected.identity)}"
    if expected.version:
        yield f"version = {_toml(expected.version)}"
    if expected.conditions:
        yield f"conditions = {_toml(expected.conditions)}"
    yield f"status = {_toml(expected.status)}"
    yield f"reason = {_toml(expected.reason)}"
    if expected.other_ends:
        yield f"other_ends = [{', '.join(map(_toml, expected.other_ends))}]"
    for kind in (TRUTH, *KINDS):
        for name, number in sorted(getattr(expected, kind).items()):
            fields = ", ".join(
                f"{field} = {_toml(value)}" for field, value in number if value is not None
            )
            line = f"{kind}.{_toml(name)} = {{ {fields} }}"
            reason = not_judged(expected.metrics[name], _parameter_of(key))
            yield f"{line}  # {reason}" if reason else line


def _parameter_of(key: str) -> str:
    """Return the parameter in the key of a run, ``<scene>/<variant>/<parameter>=<step>``.

    The file has no other record of it. Keys of truths have none, and the result is then the name of another part.
    """
    return key.rpartition("/")[2].partition("=")[0]


def _toml(value: str | float) -> str:
    """Return a string or a number in TOML, whose basic strings are escaped as in JSON."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if value.is_integer() and abs(value) < 2**53:
        return repr(int(value))
    return repr(value)
