"""The command ``prove``: proofs of motions and of stick thresholds, and their verification."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stiction.cli.exit_codes import FAILED, exit_with
from stiction.cli.options import Overrides, count, scene_of, written

if TYPE_CHECKING:
    import pandas as pd

    from stiction.scenes import Scene

commands = typer.Typer()


def _up_to(maximum: int) -> Callable[[int | str], int]:
    """Return a parser of whole numbers from 1 to `maximum`."""

    def parse(text: int | str) -> int:
        value = count(text)
        if value > maximum:
            raise typer.BadParameter(f"found {text!r}; expected 1 .. {maximum}")
        return value

    return parse


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
    """Prove bounds for a motion and its events, its contact modes, and that the motion exists and is unique.

    The proof holds for the numbers as they are written in the scene, not for their rounded values.
    """
    _require_library()
    if t_end is not None:
        # The text is passed on, because the proof is for the number as it is written.
        overrides = [*overrides, f"t_end={t_end}"]
    if check:
        if overrides or out is not None:
            raise typer.BadParameter(
                "found --set, --t-end or --out as well; expected only a proof file",
                param_hint="--check",
            )
        _check(Path(scene))
        return
    from stiction.truths.proof.certificate import write_certificate
    from stiction.truths.proof.enclosures import NotProven

    loaded = scene_of(scene, overrides)
    try:
        if threshold is None:
            claims = _prove_motion(loaded, digits)
        else:
            claims = _prove_threshold(loaded, threshold)
    except NotProven as error:
        raise exit_with(FAILED, f"{loaded.name}: {error}") from None
    if out is not None:
        write_certificate(claims, out)


def verified_set(solver: str, problems: Path | None) -> pd.DataFrame:
    """Return the table of `stiction replay --verify`, in which the existence of solutions is proven."""
    _require_library()
    from stiction.comparisons.bench.complementarity.verification import verified

    return verified(solver, problems)


def _require_library() -> None:
    """Check that the library for interval arithmetic is installed."""
    if find_spec("flint") is None:
        raise exit_with(
            FAILED, "python-flint is not installed; it is part of the extra stiction[proof]"
        )


def _check(path: Path) -> None:
    """Verify all claims of a proof file, print those that are not proven, and fail if there are any."""
    from stiction.truths.proof import motion_certificate, threshold_certificate, truth_certificate
    from stiction.truths.proof.certificate import read_certificate

    modules = (motion_certificate, threshold_certificate, truth_certificate)
    formats = {module.FORMAT.name: module.FORMAT for module in modules}
    claims = read_certificate(path, formats)
    certificate_format = formats[claims["format"]]
    failures = certificate_format.check(claims)
    for failure in failures:
        print(f"{certificate_format.part} {failure.part}: {failure.reason}")
    parts = f"{certificate_format.count(claims)} {certificate_format.part}s"
    if failures:
        raise exit_with(FAILED, f"{path}: {len(failures)} of {parts} are not proven")
    print(f"{claims['scene']}: all {parts} were proven again")


def _prove_motion(scene: Scene, digits: int) -> dict[str, Any]:
    """Prove a motion to a number of decimal places, print its events, and return the claims."""
    from stiction.truths.proof.motion import prove_scene
    from stiction.truths.proof.motion_certificate import motion_certificate

    motion = prove_scene(scene, digits)
    claims = motion_certificate(motion, scene, digits)
    print(
        f"{scene.name}: proven, {len(motion.steps)} steps, {claims['bits']} bits, order {claims['order']}, "
        f"largest width {claims['largest width']}"
    )
    instants = [(f"event {number}", event) for number, event in enumerate(claims["events"], 1)]
    instants.append((f"t_end {claims['t_end [s]']}", claims["state at t_end"]))
    for name, values in instants:
        print("  ".join([name, *(f"{key} {value}" for key, value in values.items())]))
    return claims


def _prove_threshold(scene: Scene, places: int) -> dict[str, Any]:
    """Prove a stick threshold to a number of decimal places, print the theorem, and return the claims."""
    from stiction.truths.proof.threshold import proven_threshold
    from stiction.truths.proof.threshold_certificate import threshold_certificate

    claims = threshold_certificate(proven_threshold(scene, places), scene)
    for sentence in claims["theorem"]:
        print(sentence)
    return claims
