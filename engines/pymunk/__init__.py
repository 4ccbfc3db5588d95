"""pymunk behind the engine protocol."""
