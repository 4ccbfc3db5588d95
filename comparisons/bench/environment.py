"""Origin of numbers: versions, machine, commit."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Any

import psutil
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

SUITE = "stiction"
PACKAGES = (SUITE, "numpy", "scipy", "numba", "pandas", "pyarrow", "matplotlib", "python-flint")
UNKNOWN = "the system does not tell"
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
"""Caches of the first processor on Linux."""
ROOT = Path(__file__).resolve().parents[2]
"""The folder in which the packages lie."""
CODE = ("scenes", "truths", "reference_impl", "engines", "comparisons", "reports", "stiction")
"""Folders in which a file that git does not know is a change of the code; elsewhere it may be a note."""
BUILT_FROM = ROOT / "comparisons" / "built_from.json"
"""Commit of the checkout that an installation was built from: ``setup.py`` writes it into the package."""


def origin() -> dict[str, Any]:
    """Return versions, machine, conditions and commit (None, or its hash, ``-dirty`` where files differ) for JSON."""
    checkout = commit()
    return {
        "versions": versions(),
        "machine": machine(),
        "conditions": conditions(),
        "commit": checkout and checkout["hash"] + "-dirty" * checkout["dirty"],
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that a result may depend on."""
    return {"python": platform.python_version(), **{name: _installed(name) for name in PACKAGES}}


def requirements() -> list[str]:
    """Return installed requirements of the suite and its engines as pip reads them: ``name==version``, sorted."""
    # The graph of requirements from the suite on. A package is visited once for each set of its
    # extras.
    installed: dict[str, str] = {}
    waiting = [Requirement(f"{SUITE}[all]")]
    seen: set[tuple[str, ...]] = set()
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if (name, *sorted(wanted.extras)) in seen:
            continue
        seen.add((name, *sorted(wanted.extras)))
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue  # of an extra
        installed[name] = package.version
        needed = map(Requirement, package.requires or ())
        extras = [{"extra": extra} for extra in ("", *wanted.extras)]
        waiting += [
            requirement
            for requirement in needed
            if requirement.marker is None or any(map(requirement.marker.evaluate, extras))
        ]
    return [f"{name}=={number}" for name, number in sorted(installed.items()) if name != SUITE]


def machine() -> dict[str, Any]:
    """Return what stays the same from run to run, some of it unknown to the system; ``load`` has what does not."""
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
    """Return frequency, processes that wait for a processor (mean of a minute), and memory left, now."""
    return {
        "frequency": _frequency("current"),
        "load": round(psutil.getloadavg()[0], 2),
        "memory left": f"{psutil.virtual_memory().available / 2**30:.1f} GiB",
    }


def conditions() -> str:
    """Return the processor, interpreter and numerical libraries, on which rounding and times depend besides the code.

    A processor's marketing name may stand for several generations ("AMD EPYC" in virtual machines), so LLVM's name of
    its architecture is with it. Linear algebra picks its kernels by the widest vectors, which a virtual machine may
    hide.
    """
    from llvmlite import binding as llvm

    features = llvm.get_host_cpu_features()
    widest = next((name for name in ("avx512f", "avx2") if features.get(name)), "no AVX2")
    python = ".".join(platform.python_version_tuple()[:2])
    return f"{_cpu_model()} ({llvm.get_host_cpu_name()}, {widest}); python {python}, " + ", ".join(
        f"{name} {_installed(name)}" for name in ("numpy", "scipy", "numba")
    )


def commit() -> dict[str, Any] | None:
    """Return the commit of the checkout, or that which an installation was built from, and whether files in it differ.

    None for an installation from something else than a checkout, such as an archive.
    """
    if not (ROOT / ".git").exists():
        try:
            return json.loads(BUILT_FROM.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
    try:
        head, *changes = (
            subprocess.run(
                ["git", "-C", str(ROOT), *words],
                capture_output=True,
                text=True,
                check=True,
                timeout=20,
            ).stdout.strip()
            for words in (
                ["rev-parse", "HEAD"],
                ["status", "--porcelain", "--untracked-files=no"],
                ["ls-files", "--others", "--exclude-standard", "--", *CODE],
            )
        )
    except (
        OSError,
        subprocess.SubprocessError,
    ):
        # no git, or a checkout that it will not read: nothing known
        return None
    return {"hash": head, "dirty": any(changes)}


def source_digest() -> str:
    """Return the digest of the code, the catalogue and the proven truths that numbers come from."""
    digest = hashlib.sha256()
    for package in ("scenes", "truths", "reference_impl", "engines", "comparisons"):
        kinds = (".py", ".gz", ".toml") if package == "scenes" else (".py", ".gz")
        for path in sorted(path for path in (ROOT / package).rglob("*") if path.suffix in kinds):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"


def _frequency(which: str) -> str:
    """Current or largest (max) frequency of the processors."""
    try:
        frequency = getattr(psutil.cpu_freq(), which)
    except (AttributeError, NotImplementedError, OSError):  # None where it is not known
        frequency = 0.0  # as virtual machines state it
    return f"{frequency:.0f} MHz" if frequency else UNKNOWN


def _caches() -> str:
    """``L1d 32K, L1i 32K, L2 1024K, L3 36608K``; empty where the system has none."""
    sizes = {}
    for index in CACHES.glob("index*"):
        try:
            level, kind, size = (
                (index / name).read_text().strip() for name in ("level", "type", "size")
            )
        except OSError:
            continue
        letter = "" if kind == "Unified" else kind[0].lower()
        sizes[f"L{level}{letter}"] = size
    return ", ".join(f"{name} {size}" for name, size in sorted(sizes.items()))


def _cpu_model() -> str:
    """Return the processor's name; Linux has it in /proc/cpuinfo, elsewhere the platform's word has to do."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [
        line.partition(":")[2].strip()
        for line in lines
        if line.lower().startswith(("model name", "hardware"))
    ]
    return next(iter(names), platform.processor() or platform.machine() or "unknown")
