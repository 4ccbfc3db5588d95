"""The report of a run as Markdown, page by page."""
