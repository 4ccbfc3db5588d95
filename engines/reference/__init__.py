"""The suite's own methods behind the engine protocol."""
