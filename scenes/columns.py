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
    condition under which it has them, in words; `needs_friction` and `needs_length` are the same as data.
    """

    owner: str
    names: tuple[str, ...]
    unit: str
    meaning: str
    where: str = ""
    needs_friction: bool = False
    needs_length: bool = False


BODY_COLUMNS = (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
"""Columns of a body's coordinates, velocities and accelerations."""
_MODE_MEANING = (
    "-1: slip against the direction, 0: stick, 1: slip along it; not reported by every engine"
)
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
        "GUIDE",
        ("friction",),
        "N",
        "friction force on the slider along the direction",
        "if the guide has friction",
        needs_friction=True,
    ),
    Column("GUIDE", ("mode",), "", _MODE_MEANING, "if the guide has friction", needs_friction=True),
    Column(
        "GUIDE",
        ("F1", "F2", "F3", "F4"),
        "N",
        "corner forces: 1: lower rear, 2: lower front, 3: upper front, 4: upper rear",
        "if the guide has a length",
        needs_length=True,
    ),
    Column(
        "GUIDE",
        ("friction_lower", "friction_upper"),
        "N",
        "friction forces of the two surfaces",
        "if the guide has a length and friction",
        needs_friction=True,
        needs_length=True,
    ),
    Column(
        "PIN",
        ("friction",),
        "N m",
        "torque of dry friction on the first body",
        "if the pin has friction",
        needs_friction=True,
    ),
    Column(
        "PIN",
        ("slip_velocity",),
        "rad/s",
        "angular velocity of the first body relative to the second",
        "if the pin has friction",
        needs_friction=True,
    ),
    Column(
        "PIN",
        ("mode",),
        "",
        "sign of the slip velocity while the pin turns, 0: stick; not reported by every engine",
        "if the pin has friction",
        needs_friction=True,
    ),
    Column("DRIVE", ("effort",), "N m or N", "torque or force of the drive on its first body"),
    Column(
        "drift", ("position",), "m, rad", "Euclidean norm of Phi, the residuals of the constraints"
    ),
    Column("drift", ("velocity",), "m/s, rad/s", "Euclidean norm of Phi'"),
)


def columns_of(scene: Scene) -> list[str]:
    """Names of all columns that a trajectory of the scene can have, the time left out."""
    guides, frictional = scene.guides, scene.frictional_joints
    owners: dict[str, Iterable[str]] = {
        "BODY": scene.bodies,
        "PIN": scene.pins,
        "GUIDE": guides,
        "DRIVE": scene.drives,
        "drift": ["drift"],
    }

    def applies(column: Column, owner: str) -> bool:
        if column.needs_friction and owner not in frictional:
            return False
        return not column.needs_length or guides[owner].length is not None

    return [
        f"{owner}.{name}"
        for column in COLUMNS
        for owner in owners[column.owner]
        if applies(column, owner)
        for name in column.names
    ]


def _entry_of(column: str, scene: Scene | None) -> Column | None:
    """Return the entry of a trajectory's column among `COLUMNS`, None for a column that is not among them.

    Pins and guides have columns of the same names. Without the scene they are taken for those of guides.
    """
    owner, _, name = column.rpartition(".")
    entries = [entry for entry in COLUMNS if name in entry.names]
    if scene is not None and owner in scene.pins:
        entries = [entry for entry in entries if entry.owner == "PIN"]
    return entries[0] if entries else None


def unit_of(column: str, scene: Scene | None = None) -> str:
    """The unit of a trajectory's column, empty if it has none; of an effort that of the scene's drive."""
    owner, _, name = column.rpartition(".")
    if column == "t":
        return "s"
    if name == "effort" and scene is not None:
        return "N m" if scene.drives[owner].type == "angle" else "N"
    entry = _entry_of(column, scene)
    return entry.unit if entry else ""


def meaning_of(column: str, scene: Scene | None = None) -> str:
    """What a trajectory's column has, in words; empty for one that is not of the `COLUMNS`."""
    entry = _entry_of(column, scene)
    return entry.meaning if entry else ""
