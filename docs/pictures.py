"""The pictures of README and pages; ``python docs/pictures.py [NAME ..]`` draws them anew.

A picture is a function of this module that returns a matplotlib figure and is decorated by `picture`. The picture of
the function ``driving_torque`` is ``docs/pictures/driving-torque.png``; tests hold the folder, the functions and the
pages to each other.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from stiction.engines import load_engine
from stiction.scenes import load_scene

FOLDER = Path(__file__).parent / "pictures"
DOTS_PER_INCH = 160
"""Sharp on a display of high resolution at the width of a page, and some tens of kilobytes each."""

PICTURES: dict[str, Callable[[], Figure]] = {}
"""The function that draws a picture, by the picture's name."""


def picture(draw: Callable[[], Figure]) -> Callable[[], Figure]:
    """Register a function that draws a picture, under its name with hyphens."""
    PICTURES[draw.__name__.replace("_", "-")] = draw
    return draw


@picture
def driving_torque() -> Figure:
    """Position of the slider and torque of the motor over two periods of the first slider-bar."""
    run = load_engine("reference").simulate(load_scene("slider-bar-case-1"), t_end=4.0)
    figure, (position, torque) = plt.subplots(
        2, 1, sharex=True, figsize=(7.0, 4.2), layout="constrained"
    )
    position.plot(run.t, run["slider.x"])
    position.set_ylabel("slider position x in m")
    torque.plot(run.t, run["motor.effort"])
    torque.set_ylabel("driving torque in N m")
    torque.set_xlabel("time in s")
    return figure


def main(names: list[str]) -> None:
    """Draw the pictures of these names, or all of them."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or sorted(PICTURES):
        figure = PICTURES[name]()
        figure.savefig(FOLDER / f"{name}.png", dpi=DOTS_PER_INCH)
        plt.close(figure)


if __name__ == "__main__":
    main(sys.argv[1:])
