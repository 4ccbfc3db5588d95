"""How kernels are compiled, cached and called, and the linear algebra that all of them share."""
