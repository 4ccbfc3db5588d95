"""From finished comparisons to what a person reads; no computing beyond selection and layout."""

from reports.folder import FolderRefused, check_folder
from reports.report import REPORT, write_report

__all__ = ["REPORT", "FolderRefused", "check_folder", "write_report"]
