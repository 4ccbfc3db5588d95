"""Contact modes with dry friction: the HLCP of eqs. (34)-(38), its solvers, and what follows a mode."""
