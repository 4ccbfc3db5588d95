"""Cost of runs, and of the code before."""
