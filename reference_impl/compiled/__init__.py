"""Compilation, cache and calls of kernels, and the linear algebra that all of them share."""
