"""Certificates: JSON files of claims that `Format.check` proves again; exact numbers, and decimals that contain them.

Every number that a claim depends on is exact: ``"m*2^e"`` with whole numbers m and e; a ball is ``[centre, radius]``.
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
"""Factor of a radius that is rounded inwards: balls keep 30 bits of theirs, so that 20 leave a reserve."""
_MORE_DIGITS = 6
"""Digits that are written beyond those that are asked for, as the radius takes some."""

Claims = dict[str, Any]


class NotACertificate(InputError):
    """A file whose tables are not those of a certificate."""


@dataclass(frozen=True)
class Failure:
    """A claim that was not proven again: number of its part (-1: the whole) and why."""

    part: int
    reason: str


@dataclass(frozen=True)
class Format:
    """A kind of certificate: its name, how many parts of which name it has, and a proof of its claims."""

    name: str
    part: str
    count: Callable[[Claims], int]
    failures: Callable[[Claims], Iterator[Failure]]

    def check(self, claims: Claims) -> list[Failure]:
        """Prove every claim anew; returns the failures, none if all hold.

        Raises NotACertificate where the tables lack something, or have something else in its place.
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
    """Write claims, compressed where the name ends in .gz; whole or not at all."""
    if path.suffix == ".gz":
        content = gzip.compress(json.dumps(claims, separators=(",", ":")).encode(), mtime=0)
    else:
        content = f"{json.dumps(claims, indent=1)}\n".encode()
    with whole_file(path) as partial:
        partial.write_bytes(content)


def read_certificate(path: Path, formats: Collection[str]) -> Claims:
    """Read the claims of a file in one of some formats; raises NotACertificate for anything else."""
    try:
        content = path.read_bytes()
        claims = json.loads(gzip.decompress(content) if path.suffix == ".gz" else content)
    except (OSError, EOFError, ValueError) as error:
        raise NotACertificate(
            f"{path}: found {type(error).__name__}: {error}; "
            "expected a certificate of `stiction prove`"
        ) from None
    name = claims.get("format") if isinstance(claims, dict) else type(claims).__name__
    # a list, as the name may be of any type, also of one without a hash
    if name not in [*formats]:
        raise NotACertificate(
            f"{path}: format: found {name!r}; expected {' or '.join(map(repr, formats))}"
        )
    return claims


def claimed_scene(claims: Claims) -> Scene:
    """Return the scene that a certificate holds."""
    return scene_from_dict(tomllib.loads(claims["file"]), claims["scene"])


def exact_text(number: arb) -> str:
    """Write a ball without radius as ``"m*2^e"``."""
    return "{}*2^{}".format(*number.man_exp())


def ball_texts(number: arb) -> list[str]:
    """Write a ball as ``[centre, radius]``."""
    return [exact_text(number.mid()), exact_text(number.rad())]


def matrix_texts(matrix: arb_mat) -> list[list[str]]:
    """Write the rows of an exact matrix."""
    return [[exact_text(x) for x in row] for row in matrix.tolist()]


def read_number(text: str) -> arb:
    """Read the number of ``"m*2^e"``; raises NotACertificate where the working precision rounds it."""
    mantissa, exponent = text.split("*2^")
    value = arb(int(mantissa)) * arb(2) ** int(exponent)
    if not value.is_exact():
        raise NotACertificate(
            f"found a number of more than {ctx.prec} bits: {text[:40]}..; "
            "expected one of the precision that the file names"
        )
    return value


def read_matrix(rows: Sequence[Sequence[str]]) -> arb_mat:
    """Read an exact matrix."""
    return arb_mat([[read_number(x) for x in row] for row in rows])


def read_ball(pair: Sequence[str]) -> arb:
    """Read a ball that contains that of ``[centre, radius]``: radii are rounded up."""
    centre, radius = map(read_number, pair)
    if radius < 0:
        raise NotACertificate(f"found the radius {pair[1]}; expected at least 0")
    return centre + radius * arb(0, 1)


def read_ball_within(pair: Sequence[str]) -> arb:
    """Read a ball within that of ``[centre, radius]``: what is proven to lie in it lies in what is claimed."""
    return read_ball(pair).mid() + read_number(pair[1]) * _INWARDS * arb(0, 1)


def decimals(ball: arb, digits: int) -> str:
    """Write a ball in decimals, rounded outwards: ``centre +/- radius``."""
    return ball.str(digits + _MORE_DIGITS).strip("[]")


def contains(text: str, ball: arb) -> bool:
    """Return whether a ball in decimals is proven to contain another one."""
    return arb(f"[{text}]").contains(ball)
