"""Certificates as tables of a JSON file: exact numbers, decimals that contain them, and what every check of one shares.

Every number that a claim depends on is exact: ``"m*2^e"`` with whole numbers m and e; a ball is ``[centre, radius]``.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx

from stiction.comparisons.atomic_files import write_text
from stiction.scenes import InputError

_INWARDS = 1 - arb(2) ** -20  # the radius of a ball has 30 bits


class NotACertificate(InputError):
    """A file whose tables are not those of a certificate."""


@dataclass(frozen=True)
class Failure:
    """A claim that was not proven again: number of the step or end (-1: of the whole) and why."""

    step: int
    reason: str


def exact_text(number: arb) -> str:
    """``"m*2^e"`` of a ball without radius."""
    mantissa, exponent = number.man_exp()
    return f"{mantissa}*2^{exponent}"


def ball_texts(number: arb) -> list[str]:
    """``[centre, radius]`` of a ball."""
    return [exact_text(number.mid()), exact_text(number.rad())]


def matrix_texts(matrix: arb_mat) -> list[list[str]]:
    """Rows of an exact matrix."""
    return [[exact_text(x) for x in row] for row in matrix.tolist()]


def read_number(text: str) -> arb:
    """Read the number of ``"m*2^e"``; raises NotACertificate where the working precision rounds it."""
    mantissa, exponent = text.split("*2^")
    value = arb(int(mantissa)) * arb(2) ** int(exponent)
    if not value.is_exact():
        raise NotACertificate(f"found a number of more than {ctx.prec} bits: {text[:40]}..; "
                              "expected one of the precision that the file names")
    return value


def read_matrix(rows: Sequence[Sequence[str]]) -> arb_mat:
    """Read an exact matrix."""
    return arb_mat([[read_number(x) for x in row] for row in rows])


def read_ball(pair: Sequence[str]) -> arb:
    """A ball that contains that of ``[centre, radius]``: radii are rounded up."""
    centre, radius = map(read_number, pair)
    if radius < 0:
        raise NotACertificate(f"found the radius {pair[1]}; expected at least 0")
    return centre + radius * arb(0, 1)


def read_ball_within(pair: Sequence[str]) -> arb:
    """A ball within that of ``[centre, radius]``: what is proven to lie in it lies in what is claimed."""
    return read_ball(pair).mid() + read_number(pair[1]) * _INWARDS * arb(0, 1)


def contains(text: str, ball: arb) -> bool:
    """Return whether a ball in decimals is proven to contain another one."""
    return arb(f"[{text}]").contains(ball)


def decimals(ball: arb, digits: int) -> str:
    """A ball in decimals, rounded outwards: ``centre +/- radius``."""
    return ball.str(digits + 6).strip("[]")


def write_tables(claims: dict[str, Any], path: str | Path) -> None:
    """Write claims as JSON, whole or not at all."""
    write_text(path, json.dumps(claims, indent=1) + "\n")


def read_certificate(path: str | Path, formats: Collection[str]) -> dict[str, Any]:
    """Read the tables of a file that has one of some formats.

    Raises
    ------
    NotACertificate
        If it is something else.
    """
    try:
        content = Path(path).read_bytes()
        claims = json.loads(gzip.decompress(content) if Path(path).suffix == ".gz" else content)
    except (OSError, EOFError, ValueError) as error:
        raise NotACertificate(f"{path}: found {type(error).__name__}: {error}; "
                              "expected a certificate of `stiction prove`") from None
    found = claims.get("format") if isinstance(claims, dict) else type(claims).__name__
    if found not in [*formats]:
        raise NotACertificate(f"{path}: format: found {found!r}; expected {' or '.join(map(repr, formats))}")
    return claims


@contextmanager
def checking(expected: str) -> Iterator[None]:
    """Report tables that lack something, or have something else in its place, as NotACertificate of a format."""
    try:
        yield
    except NotACertificate:
        raise
    except (KeyError, TypeError, IndexError, ValueError, ZeroDivisionError) as error:
        raise NotACertificate(f"found {type(error).__name__}: {error}; "
                              f"expected the tables of {expected!r}") from error
