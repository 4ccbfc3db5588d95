"""DART behind the engine protocol."""
