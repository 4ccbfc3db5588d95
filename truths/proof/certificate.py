"""Certificates: JSON files with claims that `Format.check` proves again.

All numbers that the claims depend on are exact: ``"m*2^e"`` with whole numbers m and e; a ball is ``[centre, radius]``.
Decimals are for readers, and contain the exact numbers.
"""

from __future__ import annotations

import gzip
import json
import tomllib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flint import arb, arb_mat, ctx

from stiction.scenes import InputError, Scene, scene_from_dict
from stiction.scenes.atomic_files import whole_file

_INWARDS = 1 - arb(2) ** -20
"""Factor of a radius that is rounded inwards: balls have radii of 30 bits, so that 20 bits leave a reserve."""
_MORE_DIGITS = 6
"""Number of digits that are written in addition to the requested ones, because the radius takes some."""

Claims = dict[str, Any]


class NotACertificate(InputError):
    """A file does not have the tables of a certificate."""


@dataclass(frozen=True)
class Failure:
    """A claim that was not proven again.

    Attributes
    ----------
    part : int
        Index of the part of the certificate; -1 for the whole.
    reason : str
        Why the claim is not proven.
    """

    part: int
    reason: str


@dataclass(frozen=True)
class Format:
    """A kind of certificate.

    Attributes
    ----------
    name, part : str
        Names of the kind and of its parts.
    count : callable
        Returns the number of parts of a certificate.
    failures : callable
        Proves the claims again, and yields the failures.
    """

    name: str
    part: str
    count: Callable[[Claims], int]
    failures: Callable[[Claims], Iterator[Failure]]

    def check(self, claims: Claims) -> list[Failure]:
        """Prove all claims again, and return the failures.

        Raises
        ------
        NotACertificate
            If tables are incomplete or have entries of a wrong kind.
        """
        try:
            return list(self.failures(claims))
        except NotACertificate:
            raise
        except (KeyError, TypeError, IndexError, ValueError, ZeroDivisionError) as error:
            raise NotACertificate(
                f"found {type(error).__name__}: {error}; expected the tables of {self.name!r}"
            ) from error


def write_certificate(claims: Claims, path: Path) -> None:
    """Write claims to a file, completely or not at all; compressed if its name ends in .gz."""
    if path.suffix == ".gz":
        content = gzip.compress(json.dumps(claims, separators=(",", ":")).encode(), mtime=0)
    else:
        content = f"{json.dumps(claims, indent=1)}\n".encode()
    with whole_file(path) as partial:
        partial.write_bytes(content)


def read_certificate(path: Path, formats: Collection[str]) -> Claims:
    """Return the claims of a file in one of the formats; raise NotACertificate for any other file."""
    try:
        content = path.read_bytes()
        claims = json.loads(gzip.decompress(content) if path.suffix == ".gz" else content)
    except (OSError, EOFError, ValueError) as error:
        raise NotACertificate(
            f"{path}: found {type(error).__name__}: {error}; "
            "expected a certificate of `stiction prove`"
        ) from None
    name = claims.get("format") if isinstance(claims, dict) else type(claims).__name__
    # The formats are converted to a list because the name may be of an unhashable type.
    if name not in [*formats]:
        raise NotACertificate(
            f"{path}: format: found {name!r}; expected {' or '.join(map(repr, formats))}"
        )
    return claims


def claimed_scene(claims: Claims) -> Scene:
    """Return the scene of a certificate."""
    return scene_from_dict(tomllib.loads(claims["file"]), claims["scene"])


def exact_text(number: arb) -> str:
    """Return a ball without radius as ``"m*2^e"``."""
    return "{}*2^{}".format(*number.man_exp())


def ball_texts(number: arb) -> list[str]:
    """Return a ball as ``[centre, radius]``."""
    return [exact_text(number.mid()), exact_text(number.rad())]


def matrix_texts(matrix: arb_mat) -> list[list[str]]:
    """Return the rows of an exact matrix as texts."""
    return [[exact_text(x) for x in row] for row in matrix.tolist()]


def read_number(text: str) -> arb:
    """Return the number of ``"m*2^e"``; raise NotACertificate if the working precision rounds it."""
    mantissa, exponent = text.split("*2^")
    value = arb(int(mantissa)) * arb(2) ** int(exponent)
    if not value.is_exact():
        raise NotACertificate(
            f"found a number of more than {ctx.prec} bits: {text[:40]}..; "
            "expected one of the precision that the file names"
        )
    return value


def read_matrix(rows: Sequence[Sequence[str]]) -> arb_mat:
    """Return an exact matrix from its texts."""
    return arb_mat([[read_number(x) for x in row] for row in rows])


def read_ball(pair: Sequence[str]) -> arb:
    """Return a ball that contains the ball ``[centre, radius]``; radii are rounded up."""
    centre, radius = map(read_number, pair)
    if radius < 0:
        raise NotACertificate(f"found the radius {pair[1]}; expected at least 0")
    return centre + radius * arb(0, 1)


def read_ball_within(pair: Sequence[str]) -> arb:
    """Return a ball within the ball ``[centre, radius]``: what it contains is in the claimed ball too."""
    return read_ball(pair).mid() + read_number(pair[1]) * _INWARDS * arb(0, 1)


def decimals(ball: arb, digits: int) -> str:
    """Return a ball in decimals, rounded outwards, as ``centre +/- radius``."""
    return ball.str(digits + _MORE_DIGITS).strip("[]")


def contains(text: str, ball: arb) -> bool:
    """Return True if a ball in decimals is proven to contain another ball."""
    return arb(f"[{text}]").contains(ball)
