"""PyBullet behind the engine protocol."""
