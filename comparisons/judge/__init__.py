"""Judgements of tables of results and of engines, and folders of truths."""
