"""Reports: the text, tables and figures of finished runs, in Markdown, LaTeX, HTML and as data.

This package selects and lays out numbers; it does not compute them.
"""

from stiction.reports.markdown.validation_report import REPORT, write_report
from stiction.reports.report import report_of
from stiction.reports.run_folder.overwriting import FolderRefused, check_folder

__all__ = ["REPORT", "FolderRefused", "check_folder", "report_of", "write_report"]
