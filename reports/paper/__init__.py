"""A run as an author needs it: figures, tables, captions, methods, references, and a PDF of all that."""

from reports.paper.folder import write_paper

__all__ = ["write_paper"]
