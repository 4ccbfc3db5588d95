"""The folder that an author needs for a paper about a run: figures, tables, text, references and a PDF."""

from stiction.reports.paper.folder import AUTHORS, MAIN, write_paper

__all__ = ["AUTHORS", "MAIN", "write_paper"]
