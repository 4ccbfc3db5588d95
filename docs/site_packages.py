"""A hook of MkDocs: the packages of the checkout below one name, where mkdocstrings finds them.

The folders of the packages (``scenes``, ``engines``, ..) are at the root of the checkout, but are imported as
``stiction.scenes``, ``stiction.engines``, .. mkdocstrings reads sources without importing them, so it needs a folder
``stiction`` with all of them inside. The hook makes a temporary one, with symbolic links to the folders and copies of
the files. A linked ``__init__.py`` would be resolved to the checkout, beside which the other folders are not found.
"""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority

ROOT = Path(__file__).resolve().parent.parent
_folders: list[TemporaryDirectory[str]] = []
"""Folders of this process, which are removed at its end; `mkdocs serve` makes one for each build."""


@event_priority(100)  # before mkdocstrings, which reads its settings in this event
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Make the folder, from the checkout as it is now, and name it to mkdocstrings."""
    _folders.append(TemporaryDirectory(prefix="stiction-site-"))
    package = Path(_folders[-1].name) / "stiction"
    package.mkdir()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name, folder in project["tool"]["setuptools"]["package-dir"].items():
        (package / name.removeprefix("stiction.")).symlink_to(ROOT / folder)
    for path in (ROOT / "stiction").iterdir():
        if path.is_file():
            shutil.copy(path, package)
        elif path.name != "__pycache__":
            (package / path.name).symlink_to(path)
    python = config.plugins["mkdocstrings"].config.handlers["python"]
    python["paths"] = [str(package.parent)]
    return config
