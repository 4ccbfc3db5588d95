"""Pages for a browser, for those who would rather look than read: of a run, and of the history of the nights."""

from stiction.reports.page.history_page import write_history_page
from stiction.reports.page.run_page import write_run_page

__all__ = ["write_history_page", "write_run_page"]
