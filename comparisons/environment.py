"""Where numbers come from: versions, machine, commit."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("stiction", "numpy", "scipy", "numba", "pandas", "pyarrow", "matplotlib")
ROOT = Path(__file__).resolve().parent.parent


def origin() -> dict[str, Any]:
    """``versions``, ``machine``, ``conditions`` and ``commit`` (its hash, ``-dirty`` where files differ, or None), ready for JSON."""
    found = commit()
    return {"versions": versions(), "machine": machine(), "conditions": conditions(), "commit": found and found["hash"] + "-dirty" * found["dirty"]}


def versions() -> dict[str, str]:
    return {"python": platform.python_version(), **{name: _installed(name) for name in PACKAGES}}


def machine() -> dict[str, Any]:
    return {"cpu": _cpu_model(), "logical cores": os.cpu_count(), "os": platform.platform()}


def conditions() -> str:
    """Of what rounding and times depend on besides the code that is judged: processor, interpreter, numerical libraries.

    A processor's marketing name may stand for several generations ("AMD EPYC" in virtual machines), so LLVM's name of its architecture
    is with it. Linear algebra picks its kernels by the widest vectors, which a virtual machine may hide.
    """
    from llvmlite import binding as llvm

    features = llvm.get_host_cpu_features()
    widest = next((name for name in ("avx512f", "avx2") if features.get(name)), "no AVX2")
    python = ".".join(platform.python_version_tuple()[:2])
    return f"{_cpu_model()} ({llvm.get_host_cpu_name()}, {widest}); python {python}, " + ", ".join(
        f"{name} {_installed(name)}" for name in ("numpy", "scipy", "numba"))


def commit(root: Path = ROOT) -> dict[str, Any] | None:
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


def source_digest() -> str:
    """Of the code and the catalogue that numbers come from: a run is the same as another only if it is."""
    digest = hashlib.sha256()
    for package in ("scenes", "reference_impl", "engines", "comparisons"):
        for path in sorted(path for path in (ROOT / package).rglob("*") if path.suffix == ".py" or path.suffix == ".toml" and package == "scenes"):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


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
