"""What scenes and trajectories look like: the mechanism, its motion, its quantities over time. Needs scenes and matplotlib only."""
