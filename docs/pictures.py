"""Draws the pictures of the README and of the documentation: ``python docs/pictures.py [NAME ..]``.

Each picture is drawn by a function with the decorator `picture`, which returns a figure of matplotlib. The
function ``tutorial_run`` draws ``docs/pictures/tutorial-run.png``. Tests check that functions, files and
pages agree.
"""

from __future__ import annotations

import contextlib
import io
import re
import sqlite3
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from stiction.comparisons.bench.campaign import load_campaign
from stiction.comparisons.bench.complementarity.replay import replay
from stiction.comparisons.bench.depth import Depth
from stiction.comparisons.bench.results import Results
from stiction.comparisons.bench.runner import make
from stiction.comparisons.bench.study import Scope, planned, union
from stiction.comparisons.judge.judgement import judge
from stiction.comparisons.measures.accuracy import errors, truth_over_time
from stiction.comparisons.measures.scene_truth import ground_truth
from stiction.comparisons.measures.steady_state_measures import SteadyRun
from stiction.comparisons.regression.baseline import Baseline
from stiction.comparisons.regression.nightly import run_night
from stiction.comparisons.studies import studies
from stiction.comparisons.sweep.axes import parse_axis
from stiction.comparisons.sweep.sweep import Specification, sweep, usual_end
from stiction.engines import isolate, load_engine
from stiction.reports.figures.charts import draw_figures
from stiction.reports.figures.style import rc
from stiction.reports.figures.sweep_figures import sweep_drawings
from stiction.reports.judgement_page import judgement_section
from stiction.reports.text import section_of
from stiction.scenes import Scene, load_scene, new_scene_text
from stiction.scenes.pictures.geometry import poses_at, view_of
from stiction.scenes.pictures.mechanism import canvas, draw_mechanism
from stiction.scenes.pictures.web import force_columns, largest_force

FOLDER = Path(__file__).parent / "pictures"
"""Folder of the pictures."""
SOLVERS = Path(__file__).parent / "examples" / "solvers"
DOTS_PER_INCH = 160
"""Resolution of the pictures: enough for a high-resolution display, at some tens of kilobytes each."""
COLOURS = 256
"""Number of colours of a picture: enough for line drawings, and a third of the file size."""

POINT_TIMEOUT_S = 60.0
"""Time limit of a point of a sweep, s; a point takes a few hundredths of a second."""

PICTURES: dict[str, Callable[[], Figure]] = {}
"""The function that draws a picture, by the picture's name."""


def picture(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """Register a function that draws a picture, under its name with hyphens."""
    PICTURES[draw.__name__.replace("_", "-")] = draw
    return draw


def figure_of_study(name: str, scene: str, *engines: str) -> Figure:
    """Return the figure of ``stiction compare NAME SCENE --quick --engines ENGINES --plot FILE``."""
    return figures_of_study(name, Scope((load_scene(scene),), Depth.QUICK, engines))[0]


def figures_of_study(name: str, scope: Scope) -> list[Figure]:
    """Return all figures of a study."""
    [study] = [study for study in studies() if study.name == name]
    comparison = planned({study: scope})[study]
    results = union(make([comparison], timed_by=isolate), scenes=scope.scenes)
    with rc():
        drawings = list(draw_figures(section_of(study, results).figures, results))
    return [drawing.figure for drawing in drawings]


@cache
def figures_of_clearance() -> list[Figure]:
    """Return the figures of the study of clearance for the paper's cases, as `stiction validate` makes them."""
    scenes = tuple(load_scene(f"slider-bar-case-{case}") for case in (1, 2, 3))
    return figures_of_study(
        "clearance", Scope(scenes, Depth.DEFAULT, ("moreau",), is_campaign=True)
    )


# Pictures of README and tutorial

ENGINE_STEPS = (4e-2, 2e-2, 1e-2, 5e-3, 2.5e-3, 1e-3)
"""Step sizes of the refinement series of engines, s; with coarser ones some do not follow the motion."""


@dataclass(frozen=True)
class Series:
    """A method with its refinement series, and the style of its line.

    Attributes
    ----------
    label : str
        Text beside the last run.
    engine : str
        Engine that makes the runs.
    parameter : str
        Argument that is refined, ``dt`` or ``rtol``.
    values : tuple of float
        Values of this argument, s if it is ``dt``.
    colour, marker : str
        Style of the line.
    raised : float
        Distance by which the label is raised, points.
    settings : mapping
        Settings of the engine.
    """

    label: str
    engine: str
    parameter: str
    values: tuple[float, ...]
    colour: str
    marker: str = "o"
    raised: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)


REFINEMENTS = (
    Series(
        "reference: tolerance\n$10^{-6}$ to $10^{-12}$",
        "reference",
        "rtol",
        (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12),
        "black",
        settings={"stabilization": "projection"},
    ),
    Series(
        "paper's scheme",
        "reference",
        "dt",
        (1e-2, 5e-3, 2.5e-3, 1e-3),
        "tab:purple",
        marker="s",
        raised=-3.0,
        settings={"method": "paper"},
    ),
    Series("", "pymunk", "dt", ENGINE_STEPS, "tab:blue"),
    Series(
        "pymunk, PyBullet",
        "pybullet",
        "dt",
        ENGINE_STEPS,
        "tab:blue",
        marker="x",
        raised=1.0,
    ),
    Series(
        "Exudyn, bristle friction",
        "exudyn",
        "dt",
        ENGINE_STEPS[1:],
        "tab:green",
        raised=3.0,
        settings={"method": "bristles"},
    ),
    Series("Exudyn, events located\nby the adapter", "exudyn", "dt", ENGINE_STEPS, "tab:red"),
)


@picture
def results() -> Figure:
    """Draw the position error over the number of steps, and the driving torque at a reversal.

    The scene is slider-bar-case-1, whose exact motion is enclosed by a proof. Since steps are counted,
    the picture does not depend on the speed of the machine.
    """
    scene = load_scene("slider-bar-case-1")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    draw_position_errors(left, scene)
    draw_torque_at_reversal(right, scene)
    return figure


def draw_position_errors(axes: Axes, scene: Scene) -> None:
    """Draw the largest position error of each method over 24 s, over the steps that it takes."""
    truth = ground_truth(scene)
    for series in REFINEMENTS:
        steps = []
        position_errors = []
        for value in series.values:
            run = load_engine(series.engine).simulate(
                scene, **{series.parameter: value}, **series.settings
            )
            steps.append(run.cost.counters["steps"])
            position_errors.append(errors(run, truth)["position_error"])
        axes.loglog(steps, position_errors, marker=series.marker, markersize=5, color=series.colour)
        axes.annotate(
            series.label,
            (steps[-1], position_errors[-1]),
            (9.0, series.raised),
            textcoords="offset points",
            color=series.colour,
            fontsize=9,
            verticalalignment="center",
        )
    # Dashed lines show the slopes of methods of first and second order.
    for order, steps_at, error_at in ((1, 1500.0, 0.2), (2, 500.0, 2e-4)):
        span = np.array([steps_at, 8 * steps_at])
        axes.loglog(span, error_at * (span / steps_at) ** -order, "--", color="gray", linewidth=1)
        axes.annotate(
            f"order {order}",
            (span[0], error_at),
            (-4.0, 0.0),
            textcoords="offset points",
            color="gray",
            fontsize=9,
            verticalalignment="center",
            horizontalalignment="right",
        )
    axes.set_xlim(30, 4e6)
    axes.set_ylim(3e-13, 1)
    axes.grid(alpha=0.3)
    axes.set_title("Position error over 24 s", fontsize=11)
    axes.set_xlabel("number of steps")
    axes.set_ylabel("largest position error [m]")


def draw_torque_at_reversal(axes: Axes, scene: Scene) -> None:
    """Draw the motor's torque where the slider reverses and the load moves to another corner."""
    step = 2.5e-3  # s
    first = 2.61  # s, begin of the time that is shown
    last = 2.76  # s, its end
    for label, colour, label_position, engine, settings in (
        ("Exudyn, bristle friction", "tab:green", (2.643, -7.2), "exudyn", {"method": "bristles"}),
        (
            "PyBullet,\ncorners in contact",
            "tab:blue",
            (2.68, -10.0),
            "pybullet",
            {"fidelity": "contact"},
        ),
    ):
        run = load_engine(engine).simulate(scene, t_end=last, dt=step, output_step=step, **settings)
        shown = run.t >= first
        axes.plot(run.t[shown], run["motor.effort"][shown], ".-", color=colour, linewidth=1)
        axes.annotate(label, label_position, color=colour, fontsize=9)
    exact = truth_over_time(ground_truth(scene), "motor.effort", np.linspace(first, last, 500))
    axes.plot(*exact, color="black", linewidth=1.5)
    axes.annotate(
        "exact: a jump of \N{MINUS SIGN}0.99 N m\nat the reversal", (2.641, -6.5), fontsize=9
    )
    axes.grid(alpha=0.3)
    axes.set_title(f"Driving torque at a reversal, steps of {1e3 * step:g} ms", fontsize=11)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("driving torque [N m]")


@picture
def tutorial_run() -> Figure:
    """Draw the figure of ``stiction run mine.toml --t-end 12 --plot run.png`` in the tutorial."""
    return load_engine("reference").simulate(load_scene("slider-bar-case-1"), t_end=12.0).plot()


@picture
def tutorial_loads() -> Figure:
    """Draw the slip velocity for the load amplitudes 3 N and 5 N, with stick phases marked."""
    figure, axes = plt.subplots(figsize=(7.0, 3.0), layout="constrained")
    for amplitude, colour in ((3.0, "black"), (5.0, "tab:red")):
        scene = load_scene("slider-bar-case-1", {"F0": amplitude})
        run = load_engine("reference").simulate(scene, t_end=24.0)
        axes.plot(
            run.t,
            run["guide.slip_velocity"],
            color=colour,
            linewidth=1,
            label=f"F0 = {amplitude:g} N",
        )
        # The slider is at rest at the start. A stick phase lasts until the next slip, or to the end.
        begins = [0.0, *(event.time for event in run.events if event.kind == "stick")]
        ends = [*(event.time for event in run.events if event.kind == "slip"), run.t[-1]]
        for begin, end in zip(begins, ends):
            axes.plot([begin, end], [0.0, 0.0], color=colour, linewidth=5, solid_capstyle="butt")
    axes.grid(alpha=0.3)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("slip velocity [m/s]")
    axes.legend(loc="upper right")
    axes.set_title("Slip velocity; thick: the slider sticks", fontsize=11)
    return figure


# Pictures of the how-to pages


@picture
def new_scene() -> Figure:
    """Draw the scene that ``stiction new`` writes, as ``stiction draw`` shows it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "sled.toml"
        file.write_text(new_scene_text(), encoding="utf-8")
        return load_scene(file).draw()


@picture
def trammel_run() -> Figure:
    """Draw the figure of ``stiction run elliptic-trammel --t-end 2 --plot trammel.png``."""
    return load_engine("reference").simulate(load_scene("elliptic-trammel"), t_end=2.0).plot()


@picture
def film_frame() -> Figure:
    """Draw one frame of ``stiction run elliptic-trammel --t-end 2 --animate trammel.gif``."""
    scene = load_scene("elliptic-trammel")
    run = load_engine("reference").simulate(scene, t_end=2.0)
    row = len(run.t) // 2
    view = view_of(scene, [poses_at(scene, run, i) for i in range(len(run.t))])
    forces = {name: float(run[name][row]) for name in force_columns(scene)}
    with rc():
        figure, axes = canvas(scene, view)
        draw_mechanism(
            axes,
            scene,
            poses_at(scene, run, row),
            view,
            float(run.t[row]),
            forces,
            largest_force(scene, run),
        )
    axes.set_title(f"{scene.name}: t = {run.t[row]:.3f} s", fontsize=8)
    return figure


@picture
def two_engines() -> Figure:
    """Draw a run of the reference and a coarse run of pymunk, for the page on looking at runs."""
    scene = load_scene("slider-bar-case-1")
    exact = load_engine("reference").simulate(scene, t_end=8.0)
    coarse = load_engine("pymunk").simulate(scene, t_end=8.0, dt=0.1)
    return exact.plot("motor.effort", "guide.slip_velocity", against=[coarse])


@picture
def judgement() -> Figure:
    """Draw the figure of ``stiction judge slider-bar-case-1 mine.csv --out judged``, for a run of pymunk."""
    scene = load_scene("slider-bar-case-1")
    run = load_engine("pymunk").simulate(scene, dt=1e-3)
    section = judgement_section(judge(scene, run.to_frame()))
    with rc():
        [drawing] = draw_figures(section.figures, Results((), {}, {}))
    return drawing.figure


@picture
def sweep_map() -> Figure:
    """Draw the map of the first command on the page about sweeps: the fraction of time in stick."""
    scene = load_scene("slider-bar-case-1", {"mus": "4/3*mu"})
    end = usual_end(scene)
    specification = Specification(
        scene,
        (parse_axis("F0=3:6:8"), parse_axis("mu=0.02:0.06:8")),
        ("stick-fraction",),
        SteadyRun(end / 3, end),
        POINT_TIMEOUT_S,
    )
    with tempfile.TemporaryDirectory() as folder:
        result = sweep(specification, Path(folder) / "sweep")
    with rc():
        [drawing] = sweep_drawings(result)
    return drawing.figure


@picture
def sweep_bands() -> Figure:
    """Draw the map of bands on the page about sweeps: rest, stick and slip over load and friction."""
    scene = load_scene("slider-bar-case-1")
    end = usual_end(scene)
    specification = Specification(
        scene,
        (parse_axis("mu=0.005:0.035:13"), parse_axis("F0=0:12:2")),
        ("threshold",),
        SteadyRun(end / 3, end),
        POINT_TIMEOUT_S,
    )
    with tempfile.TemporaryDirectory() as folder:
        result = sweep(specification, Path(folder) / "sweep")
    with rc():
        [drawing] = [one for one in sweep_drawings(result) if one.name == "map-bands"]
    return drawing.figure


@picture
def lemke_outcomes() -> Figure:
    """Draw the results of ``stiction replay`` for Lemke's method as bars, one for each class of problems."""
    table = replay().set_index("class")
    outcomes = {
        "solved": "#009E73",
        "rightly none": "#0072B2",
        "none found": "#E69F00",
        "wrong": "#D55E00",
        "not an LCP": "#CCCCCC",
    }
    figure, axes = plt.subplots(figsize=(7.0, 4.2), layout="constrained")
    left = np.zeros(len(table))
    for outcome, color in outcomes.items():
        axes.barh(table.index, table[outcome], left=left, color=color, label=outcome)
        left += table[outcome].to_numpy()
    axes.invert_yaxis()
    axes.tick_params(labelsize=8)
    # The limit is beyond the longest bar, so that its end is visible.
    axes.set_xlim(0.0, 42.0)
    axes.set_xlabel("number of problems in the class")
    figure.legend(loc="outside upper center", ncols=len(outcomes), fontsize=8)
    return figure


@picture
def compare_accuracy() -> Figure:
    """Draw the figure of ``stiction compare accuracy slider-bar-case-1 --quick --engines pymunk``."""
    return figure_of_study("accuracy", "slider-bar-case-1", "pymunk")


@picture
def clearance_torque() -> Figure:
    """Draw the torque around the flight of a corner through gaps of 1, 0.1 and 0.01 mm."""
    return figures_of_clearance()[0]


@picture
def clearance_effect() -> Figure:
    """Draw the changes of torque and position over the clearance."""
    return figures_of_clearance()[1]


@picture
def program_accuracy() -> Figure:
    """Draw the figure of ``stiction compare accuracy`` for the solver in Python of the page on programs."""
    return figure_of_study("accuracy", "slider-bar-case-1", str(SOLVERS / "python.toml"))


@picture
def history_of_nights() -> Figure:
    """Draw the position error over four nights of a campaign; only in the third the engine has an error."""
    rows = nights_with_an_error()
    error = rows[rows["metric"] == "position_error"]
    is_regression = error["verdict"] == "regression"
    figure, axes = plt.subplots(figsize=(7.0, 2.8), layout="constrained")
    axes.semilogy(range(1, len(error) + 1), error["value"], "o-", color="black")
    axes.semilogy(
        1 + np.flatnonzero(is_regression),
        error["value"][is_regression],
        "o",
        markersize=14,
        markerfacecolor="none",
        markeredgecolor="red",
        label="regression",
    )
    axes.set_xticks(range(1, len(error) + 1))
    axes.set_xlabel("night")
    axes.set_ylabel("position error [m]")
    axes.legend()
    return figure


def nights_with_an_error() -> pd.DataFrame:
    """Run four nights with the engine of the page on engines, and return the rows of their history.

    In the third night, the engine computes its positions with a wrong factor.
    """
    page = (Path(__file__).parent / "how-to" / "engine.md").read_text(encoding="utf-8")
    files = dict(re.findall(r"^```\w+\n(?=# ([\w.]+)\n)(.*?)^```$", page, re.MULTILINE | re.DOTALL))
    campaign = (
        'scenes = ["ball.toml"]\nmeasure = ["accuracy", "motion"]\n'
        '[variants.flight]\nengine = "free_flight:FreeFlight"\ndt = [1e-2]\n'
    )
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("ball.toml").write_text(files["ball.toml"])
        Path("campaign.toml").write_text(campaign)
        sys.path.insert(0, folder)
        for night in range(4):
            factor = "0.5001 * t" if night == 2 else "0.5 * t"
            Path("free_flight.py").write_text(files["free_flight.py"].replace("0.5 * t", factor))
            chosen = load_campaign("campaign.toml")
            run_night(chosen, Path("nights"), Baseline(format=2), lambda result: None)
        with contextlib.closing(sqlite3.connect("nights/history.sqlite")) as connection:
            rows = pd.read_sql("SELECT * FROM history", connection)
        sys.path.remove(folder)
    return rows


def main(names: list[str]) -> None:
    """Draw the pictures with the given names, or all pictures."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or sorted(PICTURES):
        figure = PICTURES[name]()
        image_file = io.BytesIO()
        figure.savefig(image_file, format="png", dpi=DOTS_PER_INCH)
        plt.close(figure)
        image = Image.open(image_file).convert("RGB").quantize(COLOURS)
        image.save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
