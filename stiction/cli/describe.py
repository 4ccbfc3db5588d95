"""Lists of scenes and engines, and what is made of a scene: ``scenes``, ``engines``, ``explain``, ``export``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.exit_codes import FAILED, ended
from stiction.cli.options import Overrides, SceneName, Timeout, scene_of, written
from stiction.cli.render import EVENTS_SHOWN, announce, print_or_write, show

if TYPE_CHECKING:
    from stiction.engines import Engine, EngineMissing
    from stiction.scenes import Scene

commands = typer.Typer()


@commands.command("scenes")
def list_scenes(
    folder: Annotated[
        str,
        typer.Argument(
            metavar="[FOLDER]",
            help="Folder of the catalogue, for example hard, which contains the scenes of "
            "`stiction compare hard`.",
        ),
    ] = "",
) -> None:
    """List the scenes of the catalogue, or of one of its folders, and the effects that they contain."""
    from stiction.reference_impl.multibody.equation_summary import blocks
    from stiction.scenes import catalogue, load_scene

    if not (names := catalogue(folder)):
        raise typer.BadParameter(f"found {folder!r}; expected hard", param_hint="FOLDER")
    show(
        ("scene", "title", "effects"),
        [
            (
                name,
                scene.title,
                ", ".join(block.name for block in blocks(scene)[1:] if block.elements),
            )
            for name, scene in zip(names, map(load_scene, names))
        ],
    )


@commands.command("engines")
def list_engines(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Describe this engine (a name, module:Class, FILE.toml or FILE.fmu): its "
            "settings, their defaults and meaning.",
        ),
    ] = None,
    try_it: Annotated[
        bool,
        typer.Option(
            "--try",
            help="Run the engine on five scenes, from a free body to the slider-bar, and "
            "report what is wrong in the first failing one.",
        ),
    ] = False,
    timeout: Timeout = 120,
) -> None:
    """List the engines with version (or why they are missing), fidelities, friction law, and who supplies this law."""
    if try_it:
        _try(name or "", timeout)
    elif name is not None:
        _describe(name)
    else:
        show(
            (
                "engine",
                "version",
                "fidelity",
                "mus",
                "order",
                "reactions from",
                "friction law (supplied by)",
            ),
            [row for each, engine in _known() for row in _rows_of(each, engine)],
        )


@commands.command()
def explain(scene: SceneName, overrides: Overrides = []) -> None:
    """Show what the reference assembles for a scene: equations, complementarity problem, and engines that refuse it."""
    from stiction.reference_impl.multibody.equation_summary import (
        blocks,
        constraint_components,
        constraint_rows,
        hlcp_size,
        rank,
    )
    from stiction.reference_impl.multibody.subsystems import independent_parts

    loaded = scene_of(scene, overrides)
    print(f"{loaded.name}: {loaded.title}\n\nAssembled:")
    show(
        ("block", "elements", "equation", "size"),
        [
            (block.name, _few(block.elements), block.equation, block.size)
            for block in blocks(loaded)
            if block.elements
        ],
    )
    print("Left out, because the scene does not declare it:")
    show(
        ("block", "so"),
        [(block.name, block.absence) for block in blocks(loaded) if not block.elements],
    )
    coordinates, rows, independent = 3 * len(loaded.bodies), constraint_rows(loaded), rank(loaded)
    redundant = (
        f" ({rows - independent} redundant at the start: minimum-norm forces)"
        if independent < rows
        else ""
    )
    print(
        f"Degrees of freedom: {coordinates - independent} = {coordinates} coordinates - {independent} independent of "
        f"{rows} constraint rows{redundant}\n\nSize of the problem for the forces in each contact mode: complementary "
        "pairs in the horizontal linear complementarity problem (HLCP), and equations in the linear system that is "
        "solved while the mode does not change:"
    )
    sliders = len(loaded.frictional_guides)
    show(
        ("contact mode", "HLCP", "linear"),
        [
            (_mode(sliders, sticking), str(hlcp_size(loaded, sticking)), str(rows + sticking))
            for sticking in sorted({0, min(1, sliders), sliders})
        ],
    )
    groups = constraint_components(loaded)
    print(
        f"Independent parts, each integrated on its own: {len(independent_parts(loaded))}\n"
        f"Independent components of the constraint graph: {len(groups)}"
    )
    show(
        ("component", "bodies"),
        [(str(i), _few(group)) for i, group in enumerate(groups[:EVENTS_SHOWN], 1)],
    )
    print("Engines:")
    show(("engine", "fidelity", "represents it"), list(_refusals(loaded)))


@commands.command()
def export(
    scene: SceneName,
    overrides: Overrides = [],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="Format: mjcf (MuJoCo), urdf, exudyn (a Python script), or resolved (JSON "
            "with all keys present and all expressions evaluated; see `stiction "
            "schema --resolved`).",
        ),
    ] = "mjcf",
    fidelity: Annotated[
        str,
        typer.Option(
            metavar="joint|contact",
            help="Model of sliders: bilateral joints, or (mjcf only) boxes between two surfaces.",
        ),
    ] = "joint",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            callback=written(),
            help="File to write. Default: standard output.",
        ),
    ] = None,
) -> None:
    """Write the scene in the model format of an engine."""
    from stiction.engines.exudyn.engine import scene_as_script
    from stiction.engines.mujoco.engine import scene_as_mjcf
    from stiction.engines.pybullet.urdf import urdf
    from stiction.engines.shared.fixed_step import DEFAULT_STEP
    from stiction.scenes import Fidelity
    from stiction.scenes.resolved import resolved_text

    named = shlex.join([scene, *(part for text in overrides for part in ("--set", text))])
    writers = {
        "mjcf": lambda loaded: scene_as_mjcf(loaded, DEFAULT_STEP, Fidelity(fidelity)),
        "urdf": urdf,
        "exudyn": lambda loaded: scene_as_script(loaded, named),
        "resolved": resolved_text,
    }
    if to not in writers:
        raise typer.BadParameter(f"found {to!r}; expected {', '.join(writers)}", param_hint="--to")
    can = tuple(Fidelity) if to == "mjcf" else (Fidelity.JOINT,)
    if fidelity not in can:
        raise typer.BadParameter(
            f"found {fidelity!r}; expected {' or '.join(can)} with --to {to}",
            param_hint="--fidelity",
        )
    print_or_write(writers[to](scene_of(scene, overrides)), out)


def _try(name: str, timeout: float) -> None:
    from stiction.comparisons.judge.conformance import RIGHT, conformance
    from stiction.engines.status import Status

    announce(f"{name}: five scenes, up to {timeout:g} s each")
    for trial in conformance(name, timeout):
        print(f"{trial.scene}: {trial.verdict}: " + "\n  ".join(trial.words))
    if trial.verdict not in (RIGHT, Status.REFUSED):
        raise ended(FAILED, f"{name}: {trial.scene}: {trial.verdict}")


def _describe(name: str) -> None:
    from stiction.comparisons.bench.environment import ROOT
    from stiction.engines import load_engine

    engine = load_engine(name)
    can = engine.capabilities
    print(
        f"{engine.name} {engine.version}: order {can.order}; reactions: {can.reactions}\n\n"
        f"{cleandoc(type(engine).__doc__ or '')}\n"
    )
    show(("fidelity", "mus", "friction law (supplied by)"), fidelities_of(engine))
    heading, *rows = table_of_defaults(engine)
    if rows:
        print(f"Settings, for `stiction run SCENE --engine {name} --setting KEY=VALUE`:")
        show(heading, rows)
    page = ROOT / "docs" / "engines" / f"{name}.md"
    if page.is_file():  # in a checkout
        print(f"How it is driven, why these defaults, what was measured: {page}")


def fidelities_of(engine: Engine) -> list[tuple[str, str, str]]:
    """Return by fidelity whether it has a static coefficient, and its friction law."""
    can = engine.capabilities
    return [
        (
            fidelity,
            "yes" if can.static_coefficient.get(fidelity) else "no",
            can.friction_law.get(fidelity, ""),
        )
        for fidelity in can.fidelities
    ]


def table_of_defaults(engine: Engine) -> list[tuple[str, ...]]:
    """Return a heading, then by setting its default in each fidelity, empty where the fidelity has no such setting."""
    from stiction.scenes.wording import as_given

    defaults = {
        fidelity: engine.default_settings(fidelity) for fidelity in engine.capabilities.fidelities
    }
    names = dict.fromkeys(key for known in defaults.values() for key in known)
    return [
        ("setting", *(f"default, {fidelity}" for fidelity in defaults)),
        *(
            (key, *(as_given(known[key]) if key in known else "" for known in defaults.values()))
            for key in names
        ),
    ]


def _rows_of(name: str, engine: Engine | EngineMissing) -> list[tuple[str, ...]]:
    """A row per fidelity of an engine, or one that says why it is missing."""
    from stiction.engines import EngineMissing

    if isinstance(engine, EngineMissing):
        return [(name, engine.state, *[""] * 4, str(engine))]
    return [
        (
            name,
            engine.version,
            fidelity,
            mus,
            engine.capabilities.order,
            engine.capabilities.reactions,
            law,
        )
        for fidelity, mus, law in fidelities_of(engine)
    ]


def _refusals(scene: Scene) -> Iterator[tuple[str, str, str]]:
    from stiction.engines import EngineMissing

    for name, engine in _known():
        if isinstance(engine, EngineMissing):
            yield name, "", f"{engine.state}: {engine}"
            continue
        for fidelity in engine.capabilities.fidelities:
            try:
                reason = engine.refusal(scene, fidelity)
            except Exception as error:
                # an adapter of others: its row says so, and the other engines have theirs
                reason = f"its adapter fails: {type(error).__name__}: {error}"
            yield name, fidelity, "yes" if reason is None else f"no: {reason}"


def _known() -> Iterator[tuple[str, Engine | EngineMissing]]:
    """All known engines, or why one cannot be had."""
    from stiction.engines import EngineMissing, engine_names, load_engine

    for name in engine_names():
        try:
            yield name, load_engine(name)
        except EngineMissing as error:
            yield name, error


def _mode(sliders: int, sticking: int) -> str:
    if not sliders:
        return "no friction: no complementarity problem"
    if sliders == 1:
        return "sticking" if sticking else "slipping"
    return f"{sticking} of {sliders} guides sticking"


def _few(names: Sequence[str], most: int = 8) -> str:
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")
