"""Ball arithmetic for motions: exact numbers, power series, enclosures of solutions, and their zeros."""

from stiction.scenes import StictionError


class NotProven(StictionError, ArithmeticError):
    """A claim could not be proven; it may nevertheless be true."""
