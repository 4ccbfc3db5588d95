"""Where the numbers come from: versions, machine, commit, settings, and the choices that the paper leaves open."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from comparisons.validation import Validation

PACKAGES = ("stiction", "numpy", "scipy", "numba", "pandas", "pyarrow", "matplotlib")
CHOICES = {
    "gravity": "the paper does not give g; it is a parameter of the scenes",
    "spring": "force -k (x - L0): natural length where the slider is at x = L0",
    "start": "slider at rest at x = L0, the bar horizontal and already turning at w0",
    "friction": "of the two coefficients mus, the larger, is the static one",
}
"""What the paper does not say, or what our copy of its text has lost, and what the scenes say instead."""


def provenance(validation: Validation) -> dict[str, Any]:
    """All of it, ready for JSON."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {"python": platform.python_version(), **{name: _installed(name) for name in PACKAGES}},
        "engines": engine_versions(validation),
        "machine": {"cpu": _cpu_model(), "logical cores": os.cpu_count(), "os": platform.platform()},
        "commit": _commit(Path(__file__).resolve().parent.parent),
        "campaign": {**{name: _plain(value) for name, value in validation.settings.items()},
                     "runs": len(validation.records), "wall [s]": validation.wall_s, "cpu [s]": validation.cpu_s},
        "choices": CHOICES,
    }


def engine_versions(validation: Validation) -> dict[str, str]:
    """By name, as the trajectories say; an engine none of whose runs ended has told no version."""
    versions = {record.variant.engine: "unknown: none of its runs ended" for record in validation.records}
    return versions | {record.variant.engine: record.trajectory.version
                       for record in validation.records if record.trajectory is not None}


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"


def _cpu_model() -> str:
    """The processor's own name; Linux has it in /proc/cpuinfo, elsewhere the platform's word has to do."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.lower().startswith(("model name", "hardware"))]
    return next(iter(names), platform.processor() or platform.machine() or "unknown")


def _commit(root: Path) -> dict[str, Any] | None:
    """Commit of the checkout whose root is `root` and whether files in it differ; None outside of a checkout."""
    if not (root / ".git").exists():
        return None
    try:
        head, changes = (subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=True,
                                        timeout=20).stdout.strip()
                         for words in (["rev-parse", "HEAD"], ["status", "--porcelain"]))
    except (OSError, subprocess.SubprocessError):  # no git, or a checkout that it will not read: nothing known
        return None
    return {"hash": head, "dirty": bool(changes)}


def _plain(value: Any) -> Any:
    """As JSON has it: mappings and sequences of numbers and text, anything else by its words."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(entry) for entry in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
