"""A small validation, with runs that came out and runs lost in every way, for the tests of the reports."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.variants import COEFFICIENTS, Coefficients, Record, Variant, run_key
from stiction.comparisons.hard.examination import INEXPRESSIBLE, NOT_INSTALLED
from stiction.comparisons.measures.accuracy import errors, size_of
from stiction.comparisons.measures.drift import drift
from stiction.comparisons.measures.torque_jumps import torque_table
from stiction.comparisons.studies.long_drift import NONE, PAPERS, STEPS, LongRun, drift_study
from stiction.engines.isolation import Outcome
from stiction.reports.figures.style import Drawing, save_all
from stiction.scenes import Trajectory, load_scene

CASE, T_END = "slider-bar-case-1", 9.0  # one period and a bit: holds a whole stick phase
LOST = {
    "failed": "Newton did not converge at t = 1.25 s | really",
    "crashed": "SIGSEGV: free(): invalid pointer",
    "missing": "pymunk: No module named 'pymunk'",
    "timed out": "no result within 60 s",
    "refused": "has no contact fidelity",
}


def record(
    variant: Variant, step: float, status: str = "ok", reason: str = "", value=None
) -> Record:
    key = run_key(load_scene(CASE), variant, step)
    return Record(key, CASE, variant, step, Outcome(key, status, value, reason))


def timed(run: Trajectory) -> Trajectory:
    """The run with times that are made up: the same in each worker of the tests."""
    return replace(run, cost=replace(run.cost, setup_s=0.01, compile_s=0.0, stepping_s=0.25))


def leave_dots(drawings, folder, *_) -> None:
    """In place of `stiction.reports.figures.style.save_all`, which takes most of a report's time: a dot for each picture."""
    for drawing in drawings:
        (folder / f"{drawing.name}.svg").write_text(
            "<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'/>"
        )
        (folder / f"{drawing.name}.pdf").touch()


def save_one(drawings: Sequence[Drawing], folder: Path, *others, name: str = "") -> None:
    """In place of `save_all` of a paper: the drawing of this name, or the first, is saved, and stands for all others."""
    kept = next(
        (drawing for drawing in drawings if drawing.name == name), drawings[0] if drawings else None
    )
    if kept is not None:
        save_all([kept], folder, *others)
    for drawing in drawings:
        if drawing is not kept:
            shutil.copy(folder / f"{kept.name}.pdf", folder / f"{drawing.name}.pdf")


@contextmanager
def unsaved_figures() -> Iterator[None]:
    """Reports draw their figures and save none: for what is not about how they look."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stiction.reports.markdown.validation_report.save_all", leave_dots)
        yield


def study_tables() -> dict[str, pd.DataFrame]:
    """A study of drift of made-up runs: without stabilization it grows, with it, it does not."""
    runs, outcomes = [], []
    for choice, power, error in ((NONE, 1.5, 1e-4), (PAPERS, 0.0, 2e-4)):
        for step in STEPS[2:]:
            octaves = tuple((24.0 * 2**k, 1e-9 * step * 2 ** (power * k)) for k in range(4))
            row = {
                "reason": "",
                "position_drift_24s": 1e-9 * step,
                "position_drift": octaves[-1][1],
                "growth_240s": "grows" if power else "bounded",
                "growth_exponent_240s": power,
                "growth_exponent_uncertainty_240s": 0.1,
                "walk_spread_240s": 0.1,
                "position_error": error,
                "position_uncertainty": 1e-13,
            }
            runs.append(LongRun(load_scene(CASE), choice, step, 240.0))
            outcomes.append(Outcome(f"drift/{runs[-1].name}", "ok", (row, octaves)))
    return dict(drift_study(runs, outcomes).tables)


def validation_of(records: list[Record], truths: dict) -> Results:
    truth_for = {record.key: truths[CASE] for record in records}
    came_out = [record.describe() for record in records if record.trajectory is not None]
    threshold = pd.DataFrame(
        [
            {
                **{name: row[name] for name in row if name not in ("cpu_time", "version")},
                "with_stick": 4.2119563,
                "without_stick": 4.2119564,
                "mu": 0.03,
                "mus": 0.04,
                "true_threshold": 4.21195632,
                "true_threshold_uncertainty": 6e-8,
                "threshold_error": 3e-8,
                "threshold_uncertainty": 1e-7,
                "paper_threshold": None,
            }
            for row in came_out
        ]
    )
    claims = pd.DataFrame(
        [
            {
                "case": "1",
                "claim": "the motion is periodic",
                "verdict": "holds",
                "figure": "period 8 s",
                "source": "Sect. 5",
            },
            {
                "case": "1-3",
                "claim": "there is no stick phase",
                "verdict": "does not hold",
                "figure": 0.6,
                "source": "made up",
            },
        ]
    )
    return Results(
        tuple(records),
        truths,
        {
            "accuracy": pd.DataFrame(
                [
                    {
                        **record.describe(),
                        COEFFICIENTS: str(Coefficients.BOTH),
                        **errors(
                            record.trajectory, truth_for[record.key], size_of(load_scene(CASE))
                        ),
                    }
                    for record in records
                ]
            ),
            "drift": pd.DataFrame(
                [{**record.describe(), **drift(record.trajectory)} for record in records]
            ),
            "threshold": threshold,
            "torque": torque_table(records, truth_for).assign(
                **{COEFFICIENTS: str(Coefficients.BOTH)}
            ),
            "claims": claims,
            **study_tables(),
        },
        {"engines": ["a", "b"]},
        12.5,
        20.25,
    )


def hard_table() -> pd.DataFrame:
    """Two cases by four variants; the second case is not expressible in one, one engine is not installed, and one has no row of it."""
    rows = [
        ("no motion", "reference", "right"),
        ("no motion", "other", "wrong"),
        ("no motion", "paper's scheme", "degraded"),
        ("no motion", "absent", NOT_INSTALLED),
        ("two motions", "reference", "declined"),
        ("two motions", "paper's scheme", INEXPRESSIBLE),
        ("two motions", "absent", NOT_INSTALLED),
    ]
    return pd.DataFrame(
        [
            {
                "topic": "existence",
                "case": case,
                "scene": case,
                "must": "stop",
                "variant": variant,
                "engine": variant,
                "version": "1",
                "fidelity": "joint",
                "parameter": "dt",
                "step": 1e-3,
                "verdict": verdict,
                "about": "made up",
                "size": 0.5,
                "limit": 0.0,
                "cpu_time": 1.0,
                "engine_time": 0.5,
            }
            for case, variant, verdict in rows
        ]
    )
