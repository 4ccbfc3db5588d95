"""Storage and exchange of complementarity problems, and comparison of solvers on them."""
