"""Questions with a table as the answer: work and precision, effects, drift suppression, thresholds, sweeps, replays."""
