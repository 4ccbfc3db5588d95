"""`stiction prove`: a motion with a proof, and the check of one that was written."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, ended
from stiction.cli.options import Overrides, count, scene_of, written

if TYPE_CHECKING:
    import pandas as pd

    from stiction.scenes import Scene

commands = typer.Typer()


def _up_to(most: int) -> Callable[[int | str], int]:
    """Return the parser of a whole number 1 .. `most`."""

    def number(text: int | str) -> int:
        if (value := count(text)) > most:
            raise typer.BadParameter(f"found {text!r}; expected 1 .. {most}")
        return value

    return number


@commands.command()
def prove(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="Name of a scene of the catalogue, or path of a TOML file; with --check, "
            "a file written by `stiction prove`.",
        ),
    ],
    digits: Annotated[
        int,
        typer.Option(
            metavar="N",
            parser=_up_to(1000),
            help="Decimal places of positions, velocities and event times.",
        ),
    ] = 12,
    overrides: Overrides = [],
    t_end: Annotated[
        str | None,
        typer.Option(
            "--t-end", metavar="S", help="End of the proven motion, s. Default: that of the scene."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            callback=written(".json"),
            help="Write the proof to this file (.json), which --check verifies.",
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Verify every claim of a proof file.")
    ] = False,
    threshold: Annotated[
        int | None,
        typer.Option(
            "--threshold",
            metavar="N",
            parser=_up_to(11),
            help="Instead of a motion, prove the stick threshold to N decimal places: the upper "
            "end of the band of F0 with stick phases that is nearest to the scene's F0 "
            "(slider-bar only).",
        ),
    ] = None,
) -> None:
    """Prove enclosures of a motion, its contact modes and events, and its existence and uniqueness.

    The proof is for the numbers of the scene as written, not for their rounded values.
    """
    _require_library()
    if t_end is not None:  # as text: the number as it is written
        overrides = [*overrides, f"t_end={t_end}"]
    if check:
        if overrides or out is not None:
            raise typer.BadParameter(
                "found --set, --t-end or --out, too; expected a file alone", param_hint="--check"
            )
        _check(Path(scene))
        return
    from stiction.truths.proof.certificate import write_certificate
    from stiction.truths.proof.enclosures import NotProven

    loaded = scene_of(scene, overrides)
    try:
        claims = (
            _proven_motion(loaded, digits)
            if threshold is None
            else _proven_threshold(loaded, threshold)
        )
    except NotProven as error:
        raise ended(FAILED, f"{loaded.name}: {error}") from None
    if out is not None:
        write_certificate(claims, out)


def verified_set(solver: str, problems: Path | None) -> pd.DataFrame:
    """Return the table of `stiction replay --verify`."""
    _require_library()
    from stiction.comparisons.bench.complementarity.verification import verified

    return verified(solver, problems)


def _require_library() -> None:
    if find_spec("flint") is None:
        raise ended(
            FAILED, "python-flint is not installed; it comes with the extra stiction[proof]"
        )


def _check(path: Path) -> None:
    from stiction.truths.proof import motion_certificate, threshold_certificate, truth_certificate
    from stiction.truths.proof.certificate import read_certificate

    formats = {
        each.FORMAT.name: each.FORMAT
        for each in (motion_certificate, threshold_certificate, truth_certificate)
    }
    claims = read_certificate(path, formats)
    form = formats[claims["format"]]
    failures = form.check(claims)
    what = f"{form.count(claims)} {form.part}s"
    for failure in failures:
        print(f"{form.part} {failure.part}: {failure.reason}")
    if failures:
        raise ended(FAILED, f"{path}: {len(failures)} of {what} are not proven")
    print(f"{claims['scene']}: all {what} proven anew")


def _proven_motion(scene: Scene, digits: int) -> dict[str, Any]:
    """Claims of a motion; they are printed."""
    from stiction.truths.proof.motion import prove_scene
    from stiction.truths.proof.motion_certificate import motion_certificate

    motion = prove_scene(scene, digits)
    claims = motion_certificate(motion, scene, digits)
    print(
        f"{scene.name}: proven, {len(motion.steps)} steps, {claims['bits']} bits, order {claims['order']}, "
        f"largest width {claims['largest width']}"
    )
    instants = [(f"event {number}", event) for number, event in enumerate(claims["events"], 1)]
    for name, values in (*instants, (f"t_end {claims['t_end [s]']}", claims["state at t_end"])):
        print("  ".join([name, *(f"{key} {value}" for key, value in values.items())]))
    return claims


def _proven_threshold(scene: Scene, places: int) -> dict[str, Any]:
    """Claims of a threshold; the theorem is printed."""
    from stiction.truths.proof.threshold import proven_threshold
    from stiction.truths.proof.threshold_certificate import threshold_certificate

    claims = threshold_certificate(proven_threshold(scene, places), scene)
    for sentence in claims["theorem"]:
        print(sentence)
    return claims
