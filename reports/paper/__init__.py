"""A run as an author needs it: figures, tables, captions, methods, references, and a PDF of all that."""

from stiction.reports.paper.folder import MAIN, write_paper

__all__ = ["MAIN", "write_paper"]
