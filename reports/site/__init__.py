"""The static site of results: pages of HTML that need no server and no network."""

from stiction.reports.site.site import write_site

__all__ = ["write_site"]
