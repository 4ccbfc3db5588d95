"""Web pages of a run and of the history of nightly runs, each in one file that needs no network."""

from stiction.reports.page.history_page import write_history_page
from stiction.reports.page.run_page import write_run_page

__all__ = ["write_history_page", "write_run_page"]
