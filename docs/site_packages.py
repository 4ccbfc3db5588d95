"""A hook of MkDocs: the packages of the checkout below one name, where mkdocstrings finds them.

The folders of the packages (``scenes``, ``engines``, ..) are at the root of the checkout, but are imported as
``stiction.scenes``, ``stiction.engines``, .. mkdocstrings reads sources without importing them, so it needs a folder
``stiction`` with all of them inside. The hook fills this folder: with symbolic links to the folders and copies of the
files. A linked ``__init__.py`` would be resolved to the checkout, beside which the other folders are not found.
"""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "build" / "site-packages" / "stiction"
"""The parent is the value of ``paths`` in mkdocs.yml."""


@event_priority(100)  # before mkdocstrings, which drops paths that do not exist
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fill the folder anew, from the checkout as it is now."""
    shutil.rmtree(PACKAGE, ignore_errors=True)  # of an earlier build, perhaps of another version
    PACKAGE.mkdir(parents=True)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name, folder in project["tool"]["setuptools"]["package-dir"].items():
        (PACKAGE / name.removeprefix("stiction.")).symlink_to(ROOT / folder)
    for path in (ROOT / "stiction").iterdir():
        if path.is_file():
            shutil.copy(path, PACKAGE)
        elif path.name != "__pycache__":
            (PACKAGE / path.name).symlink_to(path)
    return config
