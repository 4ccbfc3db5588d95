"""Ball arithmetic for motions: `exact` numbers, `series`, Taylor polynomials over an `arc`, `zeros`; no mechanisms."""

from stiction.scenes import StictionError


class NotProven(StictionError, ArithmeticError):
    """A claim that a proof does not go through for; it may be true."""
