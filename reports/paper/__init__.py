"""A run as an author needs it: figures, tables, captions, methods, references, and a PDF of all that."""

from stiction.reports.paper.folder import AUTHORS, MAIN, write_paper

__all__ = ["AUTHORS", "MAIN", "write_paper"]
