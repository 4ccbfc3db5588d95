"""A step of the build: the commit of the checkout goes into the package, which then knows it without git.

Everything else of the build is in pyproject.toml. Nothing is written into the sources.
"""

import json
import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
CODE = ("scenes", "truths", "reference_impl", "engines", "comparisons", "reports", "stiction")
"""Folders in which a file that git does not know is a change of the code; elsewhere it may be a note."""


def git(*words: str) -> str:
    """What git says of the checkout; an error where there is no git, or no checkout."""
    return subprocess.run(
        ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True, timeout=20
    ).stdout.strip()


def is_dirty() -> bool:
    """Test if the code differs from the commit: files changed, or new ones among the code."""
    changed = git("status", "--porcelain", "--untracked-files=no")
    return bool(changed or git("ls-files", "--others", "--exclude-standard", "--", *CODE))


class BuildWithCommit(build_py):
    """Copies the packages, and writes ``built_from.json`` for `comparisons.bench.environment`."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            # what is imported then is the checkout itself, which knows its commit
            return
        file = Path(self.build_lib) / "stiction" / "comparisons" / "built_from.json"
        file.unlink(missing_ok=True)  # of an earlier build in the same folder
        if not (ROOT / ".git").exists():
            # an archive, perhaps within the checkout of something else
            return
        try:
            found = {"hash": git("rev-parse", "HEAD"), "dirty": is_dirty()}
        except (OSError, subprocess.SubprocessError) as error:
            print(f"stiction: the commit is not known to this installation: {error}")
            return
        file.write_text(json.dumps(found) + "\n", encoding="utf-8")


setup(cmdclass={"build_py": BuildWithCommit})
