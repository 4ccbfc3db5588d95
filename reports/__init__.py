"""From finished comparisons to what a person reads; no computing beyond selection and layout."""

from stiction.reports.markdown.validation_report import REPORT, write_report
from stiction.reports.report import report_of
from stiction.reports.run_folder.overwriting import FolderRefused, check_folder

__all__ = ["REPORT", "FolderRefused", "check_folder", "report_of", "write_report"]
