"""Ball arithmetic for motions: `exact` (a scene's numbers as written), `series` (automatic differentiation), `arc` (validated Taylor
polynomials), `zeros` (events). Of mechanisms they know nothing."""
