"""Markdown of reports: studies, tables, failures, validation and regression."""
