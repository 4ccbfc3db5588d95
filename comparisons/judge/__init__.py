"""The judge of results from anywhere: tables, programs, and the truths as folders."""
