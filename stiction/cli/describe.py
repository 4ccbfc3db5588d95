"""Commands that describe scenes and engines: ``scenes``, ``engines``, ``explain``, ``export``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stiction.cli.exit_codes import FAILED, exit_with
from stiction.cli.options import Assemble, Overrides, SceneName, Timeout, scene_of, written
from stiction.cli.render import EVENTS_SHOWN, announce, print_or_write, show

if TYPE_CHECKING:
    from stiction.engines import Engine, EngineMissing
    from stiction.scenes import Scene

commands = typer.Typer()

MAX_NAMES_SHOWN = 8
"""Names of bodies or elements in one cell; a longer list would hide the other columns of its table."""


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

    names = catalogue(folder)
    if not names:
        raise typer.BadParameter(f"found {folder!r}; expected hard", param_hint="FOLDER")
    rows = []
    for name in names:
        scene = load_scene(name)
        # The first block, of the bodies, is part of every scene.
        effects = [block.name for block in blocks(scene)[1:] if block.elements]
        rows.append((name, scene.title, ", ".join(effects)))
    show(("scene", "title", "effects"), rows)


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
        if not name:
            raise typer.BadParameter(
                "found none; expected the name of an engine: stiction engines NAME --try",
                param_hint="NAME",
            )
        _try_engine(name, timeout)
    elif name is not None:
        _describe_engine(name)
    else:
        _list_all_engines()


@commands.command()
def explain(
    scene: SceneName,
    overrides: Overrides = [],
    assemble: Assemble = False,
    clearance: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Predict the flights of corners through this gap to each surface, in guides with a "
            "length, from the motion of ideal joints.",
        ),
    ] = None,
) -> None:
    """Show the equations of a scene, the sizes of its complementarity problems, and which engines can represent it."""
    loaded = scene_of(scene, overrides, assemble)
    print(f"{loaded.name}: {loaded.title}\n")
    if clearance is not None:
        _show_flights(loaded, clearance)
        return
    _show_blocks(loaded)
    _show_freedoms(loaded)
    _show_problem_sizes(loaded)
    _show_independent_parts(loaded)
    print("Engines:")
    show(("engine", "fidelity", "represents it"), list(_refusal_rows(loaded)))


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

    # The scene as it stands in a command line that makes it again.
    words = [scene]
    for override in overrides:
        words += ["--set", override]
    command_words = shlex.join(words)
    writers = {
        "mjcf": lambda loaded: scene_as_mjcf(loaded, DEFAULT_STEP, Fidelity(fidelity)),
        "urdf": urdf,
        "exudyn": lambda loaded: scene_as_script(loaded, command_words),
        "resolved": resolved_text,
    }
    if to not in writers:
        raise typer.BadParameter(f"found {to!r}; expected {', '.join(writers)}", param_hint="--to")
    fidelities = tuple(Fidelity) if to == "mjcf" else (Fidelity.JOINT,)
    if fidelity not in fidelities:
        raise typer.BadParameter(
            f"found {fidelity!r}; expected {' or '.join(fidelities)} with --to {to}",
            param_hint="--fidelity",
        )
    print_or_write(writers[to](scene_of(scene, overrides)), out)


def _try_engine(name: str, timeout: float) -> None:
    """Run the scenes of the conformance test, print each verdict, and fail at the first wrong one."""
    from stiction.comparisons.judge.conformance import RIGHT, conformance
    from stiction.engines.status import Status

    announce(f"{name}: five scenes, up to {timeout:g} s each")
    has_run = False
    for trial in conformance(name, timeout):
        has_run = True
        print(f"{trial.scene}: {trial.verdict}: " + "\n  ".join(trial.words))
        if trial.verdict not in (RIGHT, Status.REFUSED):
            raise exit_with(FAILED, f"{name}: {trial.scene}: {trial.verdict}")
    if not has_run:
        raise exit_with(
            FAILED, f"{name}: the trial returned no verdict; expected one for each scene"
        )


def _describe_engine(name: str) -> None:
    """Print an engine's version, documentation, fidelities and settings."""
    from stiction.comparisons.bench.environment import ROOT
    from stiction.engines import load_engine
    from stiction.engines.listing import default_settings, fidelity_rows

    engine = load_engine(name)
    capabilities = engine.capabilities
    print(
        f"{engine.name} {engine.version}: order {capabilities.order}; "
        f"reactions: {capabilities.reactions}\n\n"
        f"{cleandoc(type(engine).__doc__ or '')}\n"
    )
    show(("fidelity", "mus", "friction law (supplied by)"), fidelity_rows(engine))
    settings = default_settings(engine)
    if settings.rows:
        print(f"Settings, for `stiction run SCENE --engine {name} --setting KEY=VALUE`:")
        show(settings.heading, settings.rows)
    # The documentation is part of a checkout, and not of an installed package.
    page = ROOT / "docs" / "engines" / f"{name}.md"
    if page.is_file():
        print(f"How it is driven, why these defaults, what was measured: {page}")


def _list_all_engines() -> None:
    """Print a row for each fidelity of each known engine."""
    from stiction.engines.listing import known_engines

    heading = (
        "engine",
        "version",
        "fidelity",
        "mus",
        "order",
        "reactions from",
        "friction law (supplied by)",
    )
    rows = []
    for name, engine in known_engines():
        rows += _engine_rows(name, engine)
    show(heading, rows)


def _engine_rows(name: str, engine: Engine | EngineMissing) -> list[tuple[str, ...]]:
    """Return a row for each fidelity of an engine, or one row that says why the engine is missing."""
    from stiction.engines import EngineMissing
    from stiction.engines.listing import fidelity_rows

    if isinstance(engine, EngineMissing):
        return [(name, engine.state, "", "", "", "", str(engine))]
    order = engine.capabilities.order
    reactions = engine.capabilities.reactions
    return [
        (name, engine.version, fidelity, has_static_coefficient, order, reactions, friction_law)
        for fidelity, has_static_coefficient, friction_law in fidelity_rows(engine)
    ]


def _show_blocks(scene: Scene) -> None:
    """Print which blocks of equations a scene has, and which ones it does not need."""
    from stiction.reference_impl.multibody.equation_summary import blocks

    assembled = []
    left_out = []
    for block in blocks(scene):
        if block.elements:
            assembled.append(
                (block.name, _shortened_list(block.elements), block.equation, block.size)
            )
        else:
            left_out.append((block.name, block.absence))
    print("Assembled:")
    show(("block", "elements", "equation", "size"), assembled)
    print("Left out, because the scene does not declare it:")
    show(("block", "so"), left_out)


def _show_flights(scene: Scene, clearance: float) -> None:
    """Print the predicted flight of each corner through a gap (m), at the events of the ideal motion."""
    from stiction.comparisons.measures.corner_flights import corner_flights
    from stiction.engines import load_engine

    if not any(guide.length is not None for guide in scene.guides.values()):
        raise typer.BadParameter(
            "found no guide with a length; expected one, whose corners can fly",
            param_hint="--clearance",
        )
    ideal = load_engine("reference").simulate(scene)
    flights = corner_flights(scene, ideal, clearance)
    print(
        f"Flights of corners through a gap of {clearance:g} m to each surface, predicted from the motion "
        f"of ideal joints up to t = {ideal.t[-1]:g} s:"
    )
    rows = []
    for flight in flights:
        rows.append(
            (
                f"{flight.time:.5f}",
                flight.guide,
                f"F{flight.corner} -> F{flight.opposite_corner}",
                str(flight.release),
                f"{flight.force:.4g}",
                f"{flight.rate:.4g}",
                f"{flight.mass:.4g}",
                f"{flight.flight_time:.4g}",
                f"{flight.impact_speed:.4g}",
                f"{flight.crowding:.2g}",
                f"{flight.mobilization:.3g}",
            )
        )
    heading = (
        "t [s]",
        "guide",
        "corner",
        "force",
        "F [N]",
        "N' [N/s]",
        "mass [kg]",
        "flight [s]",
        "impact [m/s]",
        "crowding",
        "mobilization",
    )
    show(heading, rows)
    print(
        "The crowding is the flight time over the time to the nearest other event; the mobilization is the "
        "friction of a slider at rest over its bound. The law holds where the first is small and the second "
        "below 1, up to the first impact of each flight (docs/theory/clearance.md)."
    )
    if ideal.breakdown is not None:
        print(f"The ideal motion ends early: {ideal.breakdown}")


def _show_freedoms(scene: Scene) -> None:
    """Print the degrees of freedom of a scene, and the constraint rows that are redundant at the start."""
    from stiction.reference_impl.multibody.equation_summary import constraint_rows, rank

    coordinates = 3 * len(scene.bodies)
    rows = constraint_rows(scene)
    independent = rank(scene)
    redundant = ""
    if independent < rows:
        redundant = f" ({rows - independent} redundant at the start: minimum-norm forces)"
    print(
        f"Degrees of freedom: {coordinates - independent} = {coordinates} coordinates - {independent} "
        f"independent of {rows} constraint rows{redundant}\n"
    )


def _show_problem_sizes(scene: Scene) -> None:
    """Print the sizes of the complementarity problem and of the linear solve in some contact modes.

    The modes are those in which no joint sticks, one joint sticks, and all joints stick. The first to stick is a guide
    with a coefficient of friction, if there is any.
    """
    from stiction.reference_impl.multibody.equation_summary import (
        constraint_rows,
        hlcp_size,
        two_sided_guides,
    )

    print(
        "Size of the problem for the forces in each contact mode: complementary pairs in the horizontal linear "
        "complementarity problem (HLCP), and equations in the linear system that is solved while the mode does not "
        "change:"
    )
    constraints = constraint_rows(scene)
    joints, two_sided = len(scene.bounded_elements), len(two_sided_guides(scene))
    noun = "guides" if len(scene.frictional_guides) == joints else "joints"
    rows = []
    for sticking in sorted({0, min(1, joints), joints}):
        # Each sticking joint adds the equation that holds it.
        equations = constraints + sticking
        guides = min(sticking, two_sided)
        size = hlcp_size(scene, guides, sticking - guides)
        rows.append((_contact_mode(joints, sticking, noun), str(size), str(equations)))
    show(("contact mode", "HLCP", "linear"), rows)


def _contact_mode(joints: int, sticking: int, noun: str) -> str:
    """Describe a contact mode in which `sticking` of the frictional joints stick and the others slip."""
    if joints == 0:
        return "no friction: no complementarity problem"
    if joints == 1:
        return "sticking" if sticking else "slipping"
    return f"{sticking} of {joints} {noun} sticking"


def _show_independent_parts(scene: Scene) -> None:
    """Print how many parts of a scene are integrated on their own, and which bodies constraints connect."""
    from stiction.reference_impl.multibody.equation_summary import constraint_components
    from stiction.reference_impl.multibody.subsystems import independent_parts

    components = constraint_components(scene)
    print(
        "Independent parts, each integrated on its own: "
        f"{len(independent_parts(scene))}\n"
        f"Independent components of the constraint graph: {len(components)}"
    )
    rows = [
        (str(number), _shortened_list(bodies))
        for number, bodies in enumerate(components[:EVENTS_SHOWN], 1)
    ]
    show(("component", "bodies"), rows)


def _refusal_rows(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Yield for each engine and fidelity its names and whether it can represent a scene, or why not."""
    from stiction.engines import EngineMissing
    from stiction.engines.listing import known_engines

    for name, engine in known_engines():
        if isinstance(engine, EngineMissing):
            yield name, "", f"{engine.state}: {engine}"
            continue
        for fidelity in engine.capabilities.fidelities:
            try:
                reason = engine.reason_to_refuse(scene, fidelity)
            except Exception as error:
                # Adapters may come from other packages. A failure of one is told in its own row,
                # and must not hide the rows of the other engines.
                reason = f"its adapter fails: {type(error).__name__}: {error}"
            yield name, fidelity, "yes" if reason is None else f"no: {reason}"


def _shortened_list(names: Sequence[str]) -> str:
    """Join names with commas; of more than `MAX_NAMES_SHOWN` show the first ones and the number of all."""
    shown = ", ".join(names[:MAX_NAMES_SHOWN])
    if len(names) > MAX_NAMES_SHOWN:
        return f"{shown}, ... ({len(names)} in all)"
    return shown
