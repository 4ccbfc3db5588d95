"""`stiction prove`: a motion with a proof, and the check of one that was written."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.exit_codes import FAILED, ended

if TYPE_CHECKING:
    import pandas as pd

commands = typer.Typer()
_MOST_DIGITS, _MOST_PLACES = 1000, 11


@commands.command()
def prove(scene: Annotated[str, typer.Argument(
              metavar="SCENE", help="Name of the catalogue or a TOML file; with --check a file that `stiction prove` "
              "has written.")],
          digits: Annotated[int, typer.Option(
              metavar="N", help="Decimal places of positions, velocities and times of events.")] = 12,
          overrides: Annotated[list[str], typer.Option(
              "--set", metavar="KEY=VALUE", help="Replace a value of the scene. Repeatable.")] = [],
          t_end: Annotated[str | None, typer.Option(
              "--t-end", metavar="S", help="Seconds to prove; the scene's own if not given.")] = None,
          out: Annotated[Path | None, typer.Option(
              metavar="FILE", help="Write the proof: .json, to be checked with --check.")] = None,
          check: Annotated[bool, typer.Option("--check", help="Prove anew every claim of a file.")] = False,
          threshold: Annotated[int | None, typer.Option(
              "--threshold", metavar="N", help="Instead: prove the largest F0 with a stick phase to N decimal places "
              "(slider-bar).")] = None) -> None:
    """Enclose a motion with a proof: contact modes, events, existence, uniqueness; the scene's numbers as written."""
    from stiction.scenes import InputError

    _require_library()
    if t_end is not None:  # as text: the number as it is written
        overrides = [*overrides, f"t_end={t_end}"]
    if not 1 <= digits <= _MOST_DIGITS:
        raise InputError(f"--digits: found {digits}; expected 1 .. {_MOST_DIGITS}")
    if out is not None and out.suffix != ".json":
        raise InputError(f"--out: found {out}; expected a file that ends in .json")
    if check:
        if overrides or out is not None:
            raise InputError("--check: found --set, --t-end or --out, too; expected a file alone")
        _check(Path(scene))
    elif threshold is not None:
        if not 1 <= threshold <= _MOST_PLACES:
            raise InputError(f"--threshold: found {threshold}; expected 1 .. {_MOST_PLACES}")
        _prove_threshold(scene, threshold, overrides, out)
    else:
        _prove(scene, digits, overrides, out)


def verified_set(solver: str, problems: Path | None) -> pd.DataFrame:
    """Return the table of `stiction replay --verify`."""
    _require_library()
    from stiction.comparisons.proof.verification import verified

    return verified(solver, problems)


def _require_library() -> None:
    if find_spec("flint") is None:
        raise ended(FAILED, "python-flint is not installed; it comes with the extra stiction[proof]")


def _check(path: Path) -> None:
    from stiction.comparisons.proof import motion_certificate, threshold_certificate, truth_certificate
    from stiction.comparisons.proof.certificate import read_certificate

    formats = {each.FORMAT.name: each.FORMAT for each in (motion_certificate, threshold_certificate, truth_certificate)}
    claims = read_certificate(path, formats)
    form = formats[claims["format"]]
    failures = form.check(claims)
    what = f"{form.count(claims)} {form.part}s"
    for failure in failures:
        print(f"{form.part} {failure.part}: {failure.reason}")
    if failures:
        raise ended(FAILED, f"{path}: {len(failures)} of {what} are not proven")
    print(f"{claims['scene']}: all {what} proven anew")


def _prove(name: str, digits: int, overrides: list[str], out: Path | None) -> None:
    from stiction.comparisons.proof.certificate import write_certificate
    from stiction.comparisons.proof.enclosures import NotProven
    from stiction.comparisons.proof.motion import prove_scene
    from stiction.comparisons.proof.motion_certificate import motion_certificate
    from stiction.scenes import load_scene, parse_override

    scene = load_scene(name, dict(parse_override(text) for text in overrides))
    try:
        motion = prove_scene(scene, digits)
    except NotProven as error:
        raise ended(FAILED, f"{scene.name}: {error}") from None
    claims = motion_certificate(motion, scene, digits)
    print(f"{scene.name}: proven, {len(motion.steps)} steps, {claims['bits']} bits, order {claims['order']}, "
          f"largest width {claims['largest width']}")
    for number, event in enumerate(claims["events"], 1):
        print("  ".join([f"event {number}", *(f"{key} {value}" for key, value in event.items())]))
    state = (f"{key} {value}" for key, value in claims["state at t_end"].items())
    print("  ".join([f"t_end {claims['t_end [s]']}", *state]))
    if out is not None:
        write_certificate(claims, out)


def _prove_threshold(name: str, places: int, overrides: list[str], out: Path | None) -> None:
    from stiction.comparisons.proof.certificate import write_certificate
    from stiction.comparisons.proof.enclosures import NotProven
    from stiction.comparisons.proof.threshold import proven_threshold
    from stiction.comparisons.proof.threshold_certificate import threshold_certificate
    from stiction.scenes import load_scene, parse_override

    scene = load_scene(name, dict(parse_override(text) for text in overrides))
    try:
        found = proven_threshold(scene, places)
    except NotProven as error:
        raise ended(FAILED, f"{scene.name}: {error}") from None
    claims = threshold_certificate(found, scene)
    for sentence in claims["theorem"]:
        print(sentence)
    if out is not None:
        write_certificate(claims, out)
