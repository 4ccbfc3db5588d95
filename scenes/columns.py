"""The columns of a trajectory: which element has which, in what unit, meaning what."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiction.scenes.model import Scene


@dataclass(frozen=True)
class Column:
    """Columns ``<owner>.<name>``, one for each of `names`.

    `owner`: ``BODY``, ``PIN``, ``GUIDE``, ``DRIVE``, to be replaced by the name of the element, or ``drift``. `where`:
    condition under which it has them.
    """

    owner: str
    names: tuple[str, ...]
    unit: str
    meaning: str
    where: str = ""


BODY_COLUMNS = (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
"""Columns of a body's coordinates, velocities and accelerations."""
_FRICTION, _LENGTH = "if the guide has friction", "if the guide has a length"
COLUMNS = (
    Column("BODY", ("x", "y"), "m", "centre of mass"),
    Column("BODY", ("angle",), "rad", "angle"),
    Column("BODY", ("vx", "vy"), "m/s", "velocity of the centre of mass"),
    Column("BODY", ("omega",), "rad/s", "angular velocity"),
    Column("BODY", ("ax", "ay"), "m/s²", "acceleration of the centre of mass"),
    Column("BODY", ("alpha",), "rad/s²", "angular acceleration"),
    Column("PIN", ("fx", "fy"), "N", "force on the first body, in ground axes"),
    Column(
        "GUIDE",
        ("normal_force",),
        "N",
        "resultant force R on the slider along the normal (the direction turned by +90°)",
    ),
    Column(
        "GUIDE",
        ("moment",),
        "N m",
        "total moment of the normal forces and the surface friction on the slider, about its `slider_point`",
    ),
    Column("GUIDE", ("displacement",), "m", "displacement of the slider along the guide"),
    Column("GUIDE", ("slip_velocity",), "m/s", "velocity of the slider along the guide"),
    Column(
        "GUIDE", ("friction",), "N", "friction force on the slider along the direction", _FRICTION
    ),
    Column(
        "GUIDE",
        ("mode",),
        "",
        "-1: slip against the direction, 0: stick, 1: slip along it; not reported by every engine",
        _FRICTION,
    ),
    Column(
        "GUIDE",
        ("F1", "F2", "F3", "F4"),
        "N",
        "corner forces: 1: lower rear, 2: lower front, 3: upper front, 4: upper rear",
        _LENGTH,
    ),
    Column(
        "GUIDE",
        ("friction_lower", "friction_upper"),
        "N",
        "friction forces of the two surfaces",
        "if the guide has a length and friction",
    ),
    Column("DRIVE", ("effort",), "N m or N", "torque or force of the drive on its first body"),
    Column(
        "drift", ("position",), "m, rad", "Euclidean norm of Phi, the residuals of the constraints"
    ),
    Column("drift", ("velocity",), "m/s, rad/s", "Euclidean norm of Phi'"),
)


WORDS = {
    "x": "position $x$",
    "y": "position $y$",
    "angle": r"angle $\varphi$",
    "vx": r"velocity $\dot x$",
    "vy": r"velocity $\dot y$",
    "omega": r"angular velocity $\omega$",
    "ax": r"acceleration $\ddot x$",
    "ay": r"acceleration $\ddot y$",
    "alpha": r"angular acceleration $\alpha$",
    "fx": "force $F_x$",
    "fy": "force $F_y$",
    "normal_force": "normal force $R$",
    "moment": "moment $T$",
    "displacement": "displacement $s$",
    "slip_velocity": r"slip velocity $\dot s$",
    "friction": "friction force $f$",
    "mode": "contact mode",
    "F1": "corner force $F_1$",
    "F2": "corner force $F_2$",
    "F3": "corner force $F_3$",
    "F4": "corner force $F_4$",
    "friction_lower": "friction force $f_-$ (lower)",
    "friction_upper": "friction force $f_+$ (upper)",
}
"""Words and symbol of each column in labels of figures; an effort is a torque or a force."""


def columns_of(scene: Scene) -> list[str]:
    """Names of all columns that a trajectory of the scene can have, the time left out."""
    guides = scene.guides
    owners: dict[str, Iterable[str]] = {
        "BODY": scene.bodies,
        "PIN": scene.pins,
        "GUIDE": guides,
        "DRIVE": scene.drives,
        "drift": ["drift"],
    }

    def applies(column: Column, owner: str) -> bool:
        guide = guides.get(owner)
        return (
            not column.where
            or guide is not None
            and ("friction" not in column.where or guide.frictional)
            and ("length" not in column.where or guide.length is not None)
        )

    return [
        f"{owner}.{name}"
        for column in COLUMNS
        for owner in owners[column.owner]
        if applies(column, owner)
        for name in column.names
    ]


def unit_of(column: str, scene: Scene | None = None) -> str:
    """The unit of a trajectory's column, empty if it has none; of an effort that of the scene's drive."""
    owner, _, name = column.rpartition(".")
    if name == "effort" and scene is not None:
        return "N m" if scene.drives[owner].type == "angle" else "N"
    return (
        "s" if column == "t" else next((entry.unit for entry in COLUMNS if name in entry.names), "")
    )


def label_of(column: str, scene: Scene) -> str:
    """Return the label of an axis that shows a column of a scene: words, symbol, owner and unit.

    For example ``normal force $R$ of guide [N]``; the symbol is in the mathematics of matplotlib. A
    column that is not of the `COLUMNS` is its own label.
    """
    owner, _, name = column.rpartition(".")
    if name == "effort" and owner in scene.drives:
        words = "torque $M$" if scene.drives[owner].type == "angle" else "force $F$"
    elif name in WORDS:
        words = WORDS[name]
    else:
        return column
    # Lines of a label that is too long are broken at spaces, but not within a unit.
    unit = unit_of(column, scene).replace(" ", "\N{NO-BREAK SPACE}")
    return f"{words} of {owner} [{unit}]" if unit else f"{words} of {owner}"


def meaning_of(column: str) -> str:
    """What a trajectory's column has, in words; empty for one that is not of the `COLUMNS`."""
    name = column.rpartition(".")[2]
    return next((entry.meaning for entry in COLUMNS if name in entry.names), "")
