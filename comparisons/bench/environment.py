"""Provenance of results: versions, machine, commit."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Any

import psutil
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

SUITE = "stiction"
"""Name of the distribution."""
PACKAGES = (SUITE, "numpy", "scipy", "numba", "pandas", "pyarrow", "matplotlib", "python-flint")
"""Distributions whose versions are recorded with results."""
UNKNOWN = "the system does not tell"
"""Value of a property of the machine that the operating system does not report."""
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
"""Description of the caches of the first processor, on Linux."""
ROOT = Path(__file__).resolve().parents[2]
"""Folder that contains the packages."""
CODE = ("scenes", "truths", "reference_impl", "engines", "comparisons", "reports", "stiction")
"""Folders of code. An untracked file in one of them makes a checkout dirty; elsewhere it may be a
note."""
BUILT_FROM = ROOT / "comparisons" / "built_from.json"
"""File with the commit of the checkout that an installation was built from, written by
``setup.py``."""


def origin() -> dict[str, Any]:
    """Return versions, machine, conditions and commit, for JSON.

    The commit is a hash, followed by ``-dirty`` if files differ from it, or None if it is unknown.
    """
    checkout = commit()
    label = None
    if checkout is not None:
        label = checkout["hash"] + ("-dirty" if checkout["dirty"] else "")
    return {
        "versions": versions(),
        "machine": machine(),
        "conditions": conditions(),
        "commit": label,
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of `PACKAGES`."""
    return {"python": platform.python_version(), **{name: _installed(name) for name in PACKAGES}}


def requirements() -> list[str]:
    """Return the installed requirements of the suite and its engines as ``name==version``, sorted."""
    # Search the graph of requirements, beginning at the suite. A package has other requirements
    # with other extras, and is therefore visited once for each set of extras.
    installed: dict[str, str] = {}
    pending = [Requirement(f"{SUITE}[all]")]
    visited: set[tuple[str, ...]] = set()
    while pending:
        requirement = pending.pop()
        name = canonicalize_name(requirement.name)
        node = (name, *sorted(requirement.extras))
        if node in visited:
            continue
        visited.add(node)
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue  # the requirement of an extra that is not installed
        installed[name] = package.version
        extras = ("", *requirement.extras)
        required = [Requirement(text) for text in package.requires or ()]
        pending += [each for each in required if _applies(each, extras)]
    return [f"{name}=={number}" for name, number in sorted(installed.items()) if name != SUITE]


def _applies(requirement: Requirement, extras: Iterable[str]) -> bool:
    """Return whether a requirement applies to this machine with any of the extras ("" for none)."""
    marker = requirement.marker
    if marker is None:
        return True
    return any(marker.evaluate({"extra": extra}) for extra in extras)


def machine() -> dict[str, Any]:
    """Return the properties of the machine that do not change from run to run; see `load` for others."""
    physical = psutil.cpu_count(logical=False)
    return {
        "cpu": _cpu_model(),
        "logical cores": os.cpu_count(),
        "physical cores": physical or UNKNOWN,
        "largest frequency": _frequency("max"),
        "caches": _caches() or UNKNOWN,
        "memory": f"{psutil.virtual_memory().total / 2**30:.1f} GiB",
        "os": platform.platform(),
    }


def load() -> dict[str, Any]:
    """Return the current frequency, the load average of the last minute, and the available memory."""
    return {
        "frequency": _frequency("current"),
        "load": round(psutil.getloadavg()[0], 2),
        "memory left": f"{psutil.virtual_memory().available / 2**30:.1f} GiB",
    }


def conditions() -> str:
    """Return the processor, interpreter and numerical libraries, which determine rounding and times.

    The marketing name of a processor may denote several generations ("AMD EPYC" in virtual
    machines); therefore LLVM's name of its architecture is included. The widest vector instructions
    are included because libraries of linear algebra select their kernels by them, and a virtual
    machine may hide them.
    """
    from llvmlite import binding as llvm

    features = llvm.get_host_cpu_features()
    vectors = "no AVX2"
    if features.get("avx512f"):
        vectors = "avx512f"
    elif features.get("avx2"):
        vectors = "avx2"
    processor = f"{_cpu_model()} ({llvm.get_host_cpu_name()}, {vectors})"
    python = ".".join(platform.python_version_tuple()[:2])
    libraries = ", ".join(f"{name} {_installed(name)}" for name in ("numpy", "scipy", "numba"))
    return f"{processor}; python {python}, {libraries}"


def commit() -> dict[str, Any] | None:
    """Return ``hash`` of the commit, and ``dirty``: whether files of the checkout differ from it.

    An installation reports the checkout that it was built from. Returns None if there was none,
    for example if it was installed from an archive, or if git cannot read the checkout.
    """
    if not (ROOT / ".git").exists():
        try:
            return json.loads(BUILT_FROM.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
    try:
        head = _git("rev-parse", "HEAD")
        modified = _git("status", "--porcelain", "--untracked-files=no")
        untracked = _git("ls-files", "--others", "--exclude-standard", "--", *CODE)
    except (OSError, subprocess.SubprocessError):
        return None
    return {"hash": head, "dirty": bool(modified or untracked)}


def _git(*arguments: str) -> str:
    """Return the output of a git command in the checkout; it raises if git is missing or fails."""
    process = subprocess.run(
        ["git", "-C", str(ROOT), *arguments],
        capture_output=True,
        text=True,
        check=True,
        timeout=20,
    )
    return process.stdout.strip()


def source_digest() -> str:
    """Return the digest of the code, the catalogue and the proven truths, which determine results."""
    digest = hashlib.sha256()
    for package in ("scenes", "truths", "reference_impl", "engines", "comparisons"):
        endings = (".py", ".gz", ".toml") if package == "scenes" else (".py", ".gz")
        paths = [path for path in (ROOT / package).rglob("*") if path.suffix in endings]
        for path in sorted(paths):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _installed(package: str) -> str:
    """Return the version of an installed distribution, or that it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"


def _frequency(which: str) -> str:
    """Return the frequency of the processors in MHz: ``current``, or ``max`` for the largest possible."""
    try:
        frequency = getattr(psutil.cpu_freq(), which)
    except (AttributeError, NotImplementedError, OSError):
        # psutil returns None, or raises, depending on the system.
        return UNKNOWN
    # virtual machines report 0
    return f"{frequency:.0f} MHz" if frequency else UNKNOWN


def _caches() -> str:
    """Return the sizes of caches, ``L1d 32K, L1i 32K, L2 1024K, L3 36608K``; empty if unknown."""
    sizes = {}
    for folder in CACHES.glob("index*"):
        try:
            level = (folder / "level").read_text().strip()
            kind = (folder / "type").read_text().strip()
            size = (folder / "size").read_text().strip()
        except OSError:
            continue
        # d for data, i for instructions
        letter = "" if kind == "Unified" else kind[0].lower()
        sizes[f"L{level}{letter}"] = size
    return ", ".join(f"{name} {size}" for name, size in sorted(sizes.items()))


def _cpu_model() -> str:
    """Return the name of the processor, from /proc/cpuinfo on Linux and from `platform` elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    for line in lines:
        # "Hardware" is the key on some processors by ARM
        if line.lower().startswith(("model name", "hardware")):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine() or "unknown"
