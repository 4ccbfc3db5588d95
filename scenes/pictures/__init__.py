"""Pictures of scenes and trajectories: the mechanism, its motion, its quantities over time. Needs matplotlib only."""
