"""The frame of all pages of a site: navigation, heading, content, and the origin of the numbers."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from stiction.comparisons.regression.night_changes import short_commit
from stiction.reports.page.document import sections_html, with_scripts
from stiction.reports.run_folder.provenance import commit_in_words
from stiction.reports.site.content import SiteContent, SiteRun

INDEX = "index.html"
"""Path of the front page, which marks a folder as a site."""
NIGHTS = "nights/index.html"
"""Path of the page of the history."""
RUN = "run/index.html"
"""Path of the page of the newest run of `stiction validate`."""
DOCS = "docs"
"""Folder of the documentation."""


@dataclass(frozen=True)
class NavigationEntry:
    """An entry of the navigation: its text, its address, and whether it is the page itself."""

    text: str
    target: str
    is_current: bool


def relative(target: str, page: str) -> str:
    """Return the address of a target, a path in the site with or without ``#anchor``, as seen from a page."""
    return posixpath.relpath(target, posixpath.dirname(page) or ".")


def page(
    content: SiteContent,
    path: str,
    title: str,
    subtitle: str,
    sections: Iterable[tuple[str, Sequence[str]]],
) -> str:
    """Return the HTML of a page.

    Parameters
    ----------
    content : SiteContent
        The content of the whole site.
    path : str
        Path of the page in the site.
    title, subtitle : str
        Heading of the page, and the line below it.
    sections : iterable of (str, sequence of str)
        As for `sections_html`.
    """
    html = sections_html(sections)
    body = (
        _environment()
        .get_template("page.html")
        .render(
            navigation=_navigation(content, path),
            title=title,
            subtitle=subtitle,
            sections=Markup(html.links),
            content=Markup(html.content),
            origins=origins(content),
        )
    )
    style = (files("stiction.reports.site") / "site.css").read_text(encoding="utf-8")
    return with_scripts(f"{title} - stiction", body, style)


def _navigation(content: SiteContent, path: str) -> list[NavigationEntry]:
    """Return the entries of the navigation as seen from a page."""
    targets = {
        "Start": INDEX,
        "Questions": f"{INDEX}#questions",
        "Engines": f"{INDEX}#engines",
        "Nights": NIGHTS,
    }
    if content.newest_run is not None:
        targets["Whole run"] = RUN
    if content.submissions:
        targets["Submissions"] = f"{INDEX}#submissions"
    if content.downloads:
        targets["Download"] = f"{INDEX}#download"
    if content.docs is not None:
        targets["Documentation"] = f"{DOCS}/index.html"
    return [
        NavigationEntry(text, relative(target, path), target == path)
        for text, target in targets.items()
    ]


def origins(content: SiteContent) -> list[str]:
    """Return a line about the newest night and one about the newest run: date, version and commit."""
    night = content.newest
    origin = content.nights.origins[night]
    version = origin.get("versions", {}).get("stiction", "of unknown version")
    lines = [
        f"Night of {night}: stiction {version}, commit {short_commit(origin.get('commit'))}, "
        f"{origin['conditions']}."
    ]
    if content.newest_run is not None:
        commit = commit_in_words(content.newest_run.stored.origin)
        lines.append(f"{run_origin(content.newest_run)} ({commit}).")
    return lines


def run_origin(run: SiteRun) -> str:
    """Return date, version and commit of a run of `stiction validate` as text."""
    origin = run.stored.origin
    commit = short_commit(origin["commit"]["hash"] if origin["commit"] else None)
    return (
        f"Run of stiction validate of {time_in_words(run.date)}: stiction {origin['versions']['stiction']}, "
        f"commit {commit}"
    )


def time_in_words(time: str) -> str:
    """Return the name of a night, or the date of a run, to the minute: ``2026-11-27 02:17 UTC``.

    Both are times in the format of ISO 8601.
    """
    return f"{time[:10]} {time[11:16]} UTC"


def bullet_list(items: Iterable[str]) -> str:
    """Return an HTML list of items, which are HTML."""
    return "<ul>\n" + "\n".join(f"<li>{item}</li>" for item in items) + "\n</ul>"


def anchor(text: str, target: str) -> str:
    """Return the HTML of a link within a text."""
    return f'<a href="{escape(target)}">{escape(text)}</a>'


@cache
def _environment() -> Environment:
    """Return the Jinja2 environment of the templates of pages, which escapes what is not markup."""
    return Environment(
        loader=PackageLoader("stiction.reports", "templates/site"),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
