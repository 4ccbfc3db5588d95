"""Baseline of the runs: a versioned TOML file with every number, its uncertainty and the tier of the truth behind it.

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

A run is found by its identity (`measurement.PlannedRun.identity`), whatever its name. `conditions` are those under
which its numbers were made (`environment.conditions`), `version` is that of the engine. `rounding` is the largest
change of a number by rounding alone (`tolerances.with_rounding`). A number that it moves beyond its tolerance is not
judged, which a comment says. `other_ends` are statuses in which the run ends with other rounding.

It is sorted and has one line per number, so that a change of it can be reviewed like code. Errors, events, drift,
counters and times of our own runs are rewritten by `update`. A truth whose tier is above our own run never is: where it
has moved, the suite that finds it is wrong, or the file must be changed by hand, with the derivation.
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
DIGITS = 3
"""Significant digits of what is held to a bound of tens of per cent or more; truths and counts are written in full."""
_ROUNDED = ("accuracy", "drift", "time")
_HEAD = (
    "# What every run of the campaign is held to; see comparisons/regression/baseline.py. "
    "Written by `stiction baseline update`, which leaves truths\n"
    "# of a tier above our own run alone. Reviewed like code.\n"
)


class BaselineError(FileError):
    """A baseline that cannot be used."""


class BaselineRefused(StictionError):
    """An update would touch a truth; the message names each, with what was found."""


def _of_a_truth(tier: Tier) -> Tier:
    """Refuse the tier of what is not known."""
    if tier == Tier.NONE:
        raise ValueError("expected the tier of a truth")
    return tier


class _Number(Model):
    value: float
    uncertainty: float | None = None
    tier: Annotated[Tier, AfterValidator(_of_a_truth)]
    rounding: Annotated[float, Field(allow_inf_nan=True)] | None = None


_Numbers = dict[str, _Number]


class Expected(Model):
    """A run as it is expected: its status, why it ended early (empty where it did not), its numbers by kind and name.

    `version` and `conditions` are empty where they are not known.
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
        return outcome_of(self.status, self.reason)

    @property
    def metrics(self) -> dict[str, Metric]:
        """Numbers by name."""
        return {
            name: Metric(name, kind, number.value, number.uncertainty, number.tier, number.rounding)
            for kind in (TRUTH, *KINDS)
            for name, number in getattr(self, kind).items()
        }

    @property
    def fixed(self) -> dict[str, Metric]:
        """Numbers that no update may touch."""
        return {
            name: metric
            for name, metric in self.metrics.items()
            if metric.kind == TRUTH and metric.tier != Tier.OWN_RUN
        }


class _Update(Model):
    date: str
    reason: str
    commit: str = ""
    machine: str = ""
    versions: str = ""


class Baseline(Model):
    """A baseline: the expected runs by name, and who changed it when and why."""

    format: Literal[2]
    updates: tuple[_Update, ...] = ()
    runs: dict[str, Expected] = {}

    def expected(self, row: Row) -> Expected | None:
        """Return the expected run of this identity; where several names have it, under the same name."""
        same = {
            key: expected
            for key, expected in self.runs.items()
            if expected.identity == row.identity
        }
        return same.get(row.key) or next(iter(same.values()), None)


def load_baseline(reference: str | None = None) -> Baseline:
    """Read a baseline: the suite's own file where None, another file, or a version of git's.

    That is a commit, for the suite's own baseline, or ``COMMIT:PATH``, as ``git show`` has it. Raises `BaselineError`
    with all problems of the file at once.
    """
    if reference is None or Path(reference).is_file():
        path = DEFAULT if reference is None else Path(reference)
        return _parsed(path.read_bytes(), str(path))
    what = reference if ":" in reference else f"{reference}:./{DEFAULT.name}"
    try:
        found = subprocess.run(
            ["git", "show", "--end-of-options", what],
            capture_output=True,
            timeout=60,
            check=True,
            cwd=None if ":" in reference else DEFAULT.parent,
        )
    except (OSError, subprocess.SubprocessError) as error:
        words = " ".join(
            (getattr(error, "stderr", None) or str(error).encode()).decode(errors="replace").split()
        )
        raise BaselineError(
            reference,
            [
                Problem(
                    "baseline",
                    f"no such file, and git says: {shortened(words, 200)}",
                    "expected a file, a commit, or COMMIT:PATH",
                )
            ],
        ) from None
    return _parsed(found.stdout, what)


def _parsed(text: bytes, origin: str) -> Baseline:
    try:
        raw = tomllib.loads(text.decode())
        if raw.get("runs") and raw.get("format") != FORMAT:  # one problem, not one per run
            raise BaselineError(
                origin,
                [
                    Problem(
                        "format",
                        shown(raw.get("format")),
                        f"expected {FORMAT}: make it anew with `stiction baseline update`",
                    )
                ],
            )
        return Baseline.model_validate(raw)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BaselineError(
            origin, [Problem("file", shortened(str(error), 160), "expected TOML in UTF-8")]
        ) from None
    except ValidationError as error:
        raise BaselineError(
            origin,
            [
                Problem(
                    shortened(".".join(map(str, detail["loc"])), 200),
                    found_in(detail),
                    expectation(detail),
                )
                for detail in error.errors(include_url=False)
            ],
        ) from None


def updated(
    baseline: Baseline,
    rows: Iterable[Row],
    reason: str,
    origin: Mapping[str, Any],
    campaign: Collection[str],
) -> Baseline:
    """Return the baseline with the numbers of the rows, whose `environment.origin` is `origin`.

    Runs that were not made keep what they have, unless they are not among the keys of the campaign.

    Raises
    ------
    BaselineRefused
        If a truth of a tier above our own run is not, within the uncertainties, that of the baseline, or would be
        dropped for that of another scene under its name.
    """
    runs = {
        key: expected
        for key, expected in baseline.runs.items()
        if key in campaign or expected.fixed
    }
    moved: list[str] = []
    for row in rows:
        if row.status in (Status.MISSING, Status.NOT_RUN):
            continue  # says nothing about a run that comes again
        named = baseline.runs.get(row.key)
        if named is not None and named.identity != row.identity and named.fixed:
            moved.append(
                f"{row.key}: the baseline's is of another scene of that name ({named.identity}), "
                f"now {row.identity}"
            )
        old = baseline.expected(row) or Expected(identity=row.identity)
        moved += [
            f"{row.key}: {fixed.name}: {fixed.value!r}, now {now and now.value!r}: {why}"
            for fixed, now, why in moved_truths(row, old)
        ]
        runs[row.key] = expected_of(row, origin["conditions"], old.fixed)
    if moved:
        title = "a truth of a tier above our own run is not what the baseline says, and no update changes one:"
        raise BaselineRefused("\n  ".join([title, *moved]))
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    update = _Update(
        date=datetime.now(UTC).date().isoformat(),
        reason=reason,
        commit=origin["commit"] or "",
        machine=origin["machine"]["cpu"],
        versions=versions,
    )
    return Baseline(format=FORMAT, updates=(*baseline.updates, update), runs=runs)


def expected_of(
    row: Row, conditions: str, fixed: Mapping[str, Metric] = MappingProxyType({})
) -> Expected:
    """Return what a row, made under these conditions, makes expected; numbers that are `fixed` stay as they are."""
    numbers: dict[str, dict[str, _Number]] = defaultdict(dict)
    for metric in ({metric.name: metric for metric in row.metrics} | dict(fixed)).values():
        number = _Number(
            value=metric.value,
            uncertainty=metric.uncertainty,
            tier=metric.tier,
            rounding=metric.rounding,
        )
        short = {
            name: float(f"{value:.{DIGITS}g}")
            for name, value in number
            if isinstance(value, float) and (name != "value" or metric.kind in _ROUNDED)
        }
        numbers[metric.kind][metric.name] = number.model_copy(update=short)
    return Expected(
        identity=row.identity,
        version=row.version or "",
        conditions=conditions,
        status=row.status,
        reason=row.reason,
        other_ends=row.other_ends,
        **numbers,
    )


def moved_truths(row: Row, expected: Expected) -> Iterator[tuple[Metric, Metric | None, str]]:
    """Yield truths that no update may touch and that the row contradicts: as expected, as found, and the reason."""
    found = {metric.name: metric for metric in row.metrics}
    for name, fixed in expected.fixed.items():
        now = found.get(name)
        if now is None:
            yield fixed, now, f"{fixed.tier.label}; found nothing: {row.reason or row.status}"
            continue
        allowed, moved = (
            (now.uncertainty or 0.0) + (fixed.uncertainty or 0.0),
            abs(now.value - fixed.value),
        )
        if moved > allowed:
            yield (
                fixed,
                now,
                (
                    f"{fixed.tier.label}, now {now.tier.label}: they differ by {moved:.2g}, "
                    f"the uncertainties of both allow {allowed:.2g}"
                ),
            )


def write_baseline(baseline: Baseline, path: Path) -> None:
    """Write the file, whole or not at all; errors as of `atomic_files.whole_file`."""
    lines = [_HEAD, f"format = {FORMAT}"]
    for update in baseline.updates:
        lines += ["", "[[updates]]", *(f"{key} = {_toml(value)}" for key, value in update)]
    for key, expected in sorted(baseline.runs.items()):
        lines += ["", f"[runs.{_toml(key)}]", *_lines_of(key, expected)]
    write_text(path, "\n".join(lines) + "\n")


def _lines_of(key: str, expected: Expected) -> Iterator[str]:
    for name in ("identity", "version", "conditions", "status", "reason"):
        value = getattr(expected, name)
        if value or name not in ("version", "conditions"):
            yield f"{name} = {_toml(value)}"
    if expected.other_ends:
        yield f"other_ends = [{', '.join(map(_toml, expected.other_ends))}]"
    parameter = key.rpartition("/")[2].partition("=")[0]
    for kind in (TRUTH, *KINDS):
        for name, number in sorted(getattr(expected, kind).items()):
            fields = ", ".join(
                f"{field} = {_toml(value)}" for field, value in number if value is not None
            )
            why = not_judged(expected.metrics[name], parameter)
            yield f"{kind}.{_toml(name)} = {{ {fields} }}" + (f"  # {why}" if why else "")


def _toml(value: str | float) -> str:
    """Write a string or a number as TOML has it; a basic string escapes as JSON does."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(int(value)) if value.is_integer() and abs(value) < 2**53 else repr(value)
