"""Exudyn behind the engine protocol."""
