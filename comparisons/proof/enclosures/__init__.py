"""Ball arithmetic for motions: `exact` numbers, `series`, Taylor polynomials over an `arc`, `zeros`; no mechanisms."""
