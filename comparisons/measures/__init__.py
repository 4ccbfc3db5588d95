"""Functions that reduce trajectories to numbers: errors, distances, drift, jumps of efforts, creep."""
