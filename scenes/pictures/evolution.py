"""The quantities of a run over time, jumps vertical, stick phases shaded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import product

import numpy as np
import pandas as pd

from stiction.scenes.columns import label_of, unit_of
from stiction.scenes.pictures.picture import COLORS, CYCLE, WIDTH, Picture, fit_labels, rc
from stiction.scenes.trajectory import Trajectory

MOST_LINES = 8
"""Lines in one panel; the legend says how many there are."""
_DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_PANELS = {
    r"\.displacement": "displacement [m]",
    r"\.slip_velocity": "slip velocity [m/s]",
    r"\.F[1-4]": "corner forces [N]",
    r"\.friction": "friction [N]",
    r"\.effort": "driving effort",
}
_WITHOUT_GUIDES = {
    r"\.[xy]": "position [m]",
    r"\.angle": "angle [rad]",
    r"\.effort": "driving effort",
    r"\.f[xy]": "pin forces [N]",
}


def evolution(
    runs: Sequence[Trajectory], columns: Sequence[str] = (), width: float = WIDTH
) -> Picture:
    """Draw a panel for each of `columns`, with a line for each run; of one run without columns, the usual quantities.

    A figure of chosen columns is one for print: it has no title, and its labels consist of words,
    symbol and unit. The reference is black, and drawn on top of other runs.

    `width` is that of the figure, inches. KeyError for a column that a run does not have.
    """
    # a column that is missing raises its KeyError here, before anything is drawn
    first, several = runs[0], len(runs) > 1
    for run, name in product(runs, columns):
        run[name]
    panels = [([name], _label(name, first)) for name in columns] or _usual(first)
    # The last line is on top of the others: that of the reference.
    runs = sorted(runs, key=lambda run: run.engine == "reference")
    frames = [run.to_frame(events=True, interpolated=True) for run in runs]
    stick = [] if several else _stick(frames[0])
    with rc():
        picture = Picture((0.6 if several else 0.4) + 1.25 * len(panels), width)
        axes = picture.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for ax, (names, label) in zip(axes, panels):
            lines = (
                [(frame, names[0], _method(run)) for run, frame in zip(runs, frames)]
                if several
                else [(frames[0], name, name) for name in names[:MOST_LINES]]
            )
            for number, (frame, name, text) in enumerate(lines):
                # a run that is drawn over an equal one is dashed, so that both are seen
                dashes = _DASHES[number % len(_DASHES)]
                color = CYCLE[number % len(CYCLE)]
                if several:
                    # Black, the first colour, is that of the last line.
                    color = CYCLE[(number + 1) % len(lines) % len(CYCLE)]
                ax.plot(
                    frame["t"].to_numpy(),
                    frame[name].to_numpy(),
                    color=color,
                    linewidth=1.0,
                    label=text,
                    linestyle=dashes,
                )
            for begin, end in stick:
                ax.axvspan(begin, end, color=COLORS["shade"], linewidth=0, zorder=0)
            ax.set_ylabel(label)
            ax.margins(x=0)
            if not columns:
                more = f"{MOST_LINES} of {len(names)}" if len(names) > MOST_LINES else None
                ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title=more)
        axes[-1].set_xlabel("$t$ [s]" + (", shaded: stick" if stick else ""))
        if several:
            axes[0].legend(
                loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2 if width >= WIDTH else 1
            )
        elif not columns:
            axes[0].set_title(
                f"{first.scene}: {first.engine} {first.version}, {first.fidelity}",
                fontsize=8,
                parse_math=False,
            )
        fit_labels(picture)
    return picture


def _label(column: str, run: Trajectory) -> str:
    """Label of an axis: words, symbol and unit if the scene is known, else the name of the column and its unit."""
    if run.mechanism is None:
        return f"{column} [{unit_of(column)}]"
    return label_of(column, run.mechanism)


def _method(run: Trajectory) -> str:
    """Engine, fidelity and what sets the accuracy."""
    accuracy = {key: run.settings.get(key) for key in ("dt", "rtol")}
    units = {"dt": " s", "rtol": ""}
    return ", ".join(
        [
            run.engine,
            run.fidelity,
            *(
                f"{key} = {value:g}{units[key]}"
                for key, value in accuracy.items()
                if isinstance(value, float)
            ),
        ]
    )


def _usual(trajectory: Trajectory) -> list[tuple[list[str], str]]:
    guides = any(name.endswith(".displacement") for name in trajectory.columns)
    efforts = [name for name in trajectory.columns if name.endswith(".effort")]
    units = dict.fromkeys(unit_of(name, trajectory.mechanism) for name in efforts)
    panels = []
    for pattern, label in (_PANELS if guides else _WITHOUT_GUIDES).items():
        names = [name for name in trajectory.columns if re.search(rf"{pattern}$", name)]
        heading = f"{label} [{', '.join(units)}]" if label == "driving effort" else label
        if names:
            panels.append((names, heading))
    return panels


def _stick(frame: pd.DataFrame) -> list[tuple[float, float]]:
    """Begin and end of each stick phase, s, with one frictional guide; none where several would share the shade."""
    modes = [name for name in frame if name.endswith(".mode")]
    if len(modes) != 1:
        return []
    # rises and falls of the condition, in pairs
    t, sticks = frame["t"].to_numpy(), frame[modes[0]].to_numpy() == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], sticks, [False]]).astype(int)))
    return [
        (float(t[begin]), float(t[end - 1]))
        for begin, end in edges.reshape(-1, 2)
        if t[end - 1] > t[begin]
    ]
