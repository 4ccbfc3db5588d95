"""Names, units and meanings of the columns of a trajectory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stiction.scenes.model import Scene


@dataclass(frozen=True)
class Column:
    """Columns ``<owner>.<name>`` that have one unit and one meaning.

    Attributes
    ----------
    owner : str
        ``BODY``, ``PIN``, ``GUIDE`` or ``DRIVE``, which stands for the name of each such element, or ``drift``.
    names : tuple of str
        The names of the columns.
    unit : str
        Unit of the values; empty if they have none.
    meaning : str
        Description of the values.
    needs_friction : bool
        True if only a joint with friction has these columns.
    needs_length : bool
        True if only a guide with a length has these columns.
    needs_limit : bool
        True if only a drive with an `effort_limit` has these columns.
    """

    owner: str
    names: tuple[str, ...]
    unit: str
    meaning: str
    needs_friction: bool = False
    needs_length: bool = False
    needs_limit: bool = False

    @property
    def where(self) -> str:
        """Condition in words under which an element has the columns; empty if there is none."""
        if self.needs_limit:
            return "if the drive has a limit"
        kind = "pin" if self.owner == "PIN" else "guide"
        if self.needs_friction and self.needs_length:
            return f"if the {kind} has a length and friction"
        if self.needs_friction:
            return f"if the {kind} has friction"
        if self.needs_length:
            return f"if the {kind} has a length"
        return ""


BODY_COLUMNS = (("x", "y", "angle"), ("vx", "vy", "omega"), ("ax", "ay", "alpha"))
"""Columns of the coordinates, velocities and accelerations of a body."""
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
        needs_friction=True,
    ),
    Column("GUIDE", ("mode",), "", _MODE_MEANING, needs_friction=True),
    Column(
        "GUIDE",
        ("F1", "F2", "F3", "F4"),
        "N",
        "corner forces: 1: lower rear, 2: lower front, 3: upper front, 4: upper rear",
        needs_length=True,
    ),
    Column(
        "GUIDE",
        ("friction_lower", "friction_upper"),
        "N",
        "friction forces of the two surfaces",
        needs_friction=True,
        needs_length=True,
    ),
    Column(
        "PIN",
        ("friction",),
        "N m",
        "torque of dry friction on the first body",
        needs_friction=True,
    ),
    Column(
        "PIN",
        ("slip_velocity",),
        "rad/s",
        "angular velocity of the first body relative to the second",
        needs_friction=True,
    ),
    Column(
        "PIN",
        ("mode",),
        "",
        "sign of the slip velocity while the pin turns, 0: stick; not reported by every engine",
        needs_friction=True,
    ),
    Column("DRIVE", ("effort",), "N m or N", "torque or force of the drive on its first body"),
    Column(
        "DRIVE",
        ("slip_velocity",),
        "rad/s or m/s",
        "rate of the drive's coordinate minus the rate of its law",
        needs_limit=True,
    ),
    Column(
        "DRIVE",
        ("lag",),
        "rad or m",
        "value of the drive's law minus its coordinate",
        needs_limit=True,
    ),
    Column(
        "DRIVE",
        ("mode",),
        "",
        "sign of the slip velocity while the drive gives way, 0: it holds the rate of its law",
        needs_limit=True,
    ),
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
    "lag": r"lag $\Delta$",
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
    """Return the names of all columns that a trajectory of the scene can have, without the time."""
    guides = scene.guides
    frictional_joints = scene.frictional_joints
    owners: dict[str, Iterable[str]] = {
        "BODY": scene.bodies,
        "PIN": scene.pins,
        "GUIDE": guides,
        "DRIVE": scene.drives,
        "drift": ["drift"],
    }
    columns = []
    for entry in COLUMNS:
        for owner in owners[entry.owner]:
            if entry.needs_friction and owner not in frictional_joints:
                continue
            if entry.needs_length and guides[owner].length is None:
                continue
            if entry.needs_limit and not scene.drives[owner].is_limited:
                continue
            columns += [f"{owner}.{name}" for name in entry.names]
    return columns


def _entry_of(column: str, scene: Scene | None) -> Column | None:
    """Return the entry of a trajectory's column among `COLUMNS`, None for a column that is not among them.

    Pins and guides have columns of the same names. Without the scene they are taken for those of guides.
    """
    owner, _, name = column.rpartition(".")
    entries = [entry for entry in COLUMNS if name in entry.names]
    for kind, owners in (("PIN", scene.pins), ("DRIVE", scene.drives)) if scene is not None else ():
        if owner in owners:
            entries = [entry for entry in entries if entry.owner == kind]
    return entries[0] if entries else None


def unit_of(column: str, scene: Scene | None = None) -> str:
    """Return the unit of a column; empty if it has none.

    Parameters
    ----------
    column
        The name of the column, such as ``"t"`` or ``"guide.friction"``.
    scene
        The scene, which determines the unit of the effort of a drive. Without it, both units are returned.
    """
    if column == "t":
        return "s"
    owner, _, name = column.rpartition(".")
    entry = _entry_of(column, scene)
    unit = "" if entry is None else entry.unit
    if scene is not None and owner in scene.drives and " or " in unit:
        of_angle, of_distance = unit.split(" or ")
        return of_angle if scene.drives[owner].type == "angle" else of_distance
    return unit


def label_of(column: str, scene: Scene) -> str:
    """Return the label of an axis that shows a column of a scene: words, symbol, owner and unit.

    For example ``normal force $R$ of guide [N]``; the symbol is in the mathematics of matplotlib. A
    column that is not of the `COLUMNS` is its own label.
    """
    words = words_of(column, scene)
    if words == column:
        return column
    # Lines of a label that is too long are broken at spaces, but not within a unit.
    unit = unit_of(column, scene).replace(" ", "\N{NO-BREAK SPACE}")
    return f"{words} [{unit}]" if unit else words


def words_of(column: str, scene: Scene) -> str:
    """Return the words, symbol and owner of a column of a scene: its label without the unit (`label_of`)."""
    owner, _, name = column.rpartition(".")
    if name == "effort" and owner in scene.drives:
        words = "torque $M$" if scene.drives[owner].type == "angle" else "force $F$"
    elif name in WORDS:
        words = WORDS[name]
    else:
        return column
    return f"{words} of {owner}"


def meaning_of(column: str, scene: Scene | None = None) -> str:
    """Return the description of a column; empty if it is not in `COLUMNS`."""
    entry = _entry_of(column, scene)
    return "" if entry is None else entry.meaning
