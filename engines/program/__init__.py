"""Engines that are programs in any language, each declared in a TOML file."""
