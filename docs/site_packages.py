"""Hooks of MkDocs: a folder in which mkdocstrings finds the packages of stiction, and links of notebooks.

The folders of the packages (``scenes``, ``engines``, ..) are at the root of the checkout, but are imported as
``stiction.scenes``, ``stiction.engines``, .. Since mkdocstrings reads the sources without importing them, it
needs a folder ``stiction`` that contains all of them. The first hook creates a temporary one.

MkDocs converts the links between Markdown pages. The second hook converts those of notebooks, which lead to
Markdown pages too, so that they can be followed where a notebook is read from the repository.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
_folders: list[TemporaryDirectory[str]] = []
"""Temporary folders, which are removed when the process ends; `mkdocs serve` creates one for each build."""


# The priority makes this hook run before mkdocstrings, which reads its settings in the same event.
@event_priority(100)
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Create the folder from the checkout, and set it as the path that mkdocstrings searches."""
    _folders.append(TemporaryDirectory(prefix="stiction-site-"))
    package = Path(_folders[-1].name) / "stiction"
    package.mkdir()
    # Folders are linked and files are copied: a linked `__init__.py` would be resolved to the checkout,
    # beside which the other folders are not found.
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


def on_page_content(html: str, page: Page, **_: object) -> str:
    """Return the text of a page, with the links of a notebook to the pages of the site."""
    if not page.file.src_uri.endswith(".ipynb"):
        return html
    return re.sub(r'(href="(?!\w+:)[^"#]+)\.md(["#])', r"\1.html\2", html)
