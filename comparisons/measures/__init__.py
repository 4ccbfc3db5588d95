"""From trajectories to numbers: errors, distances, drift, jumps of the driving effort."""
