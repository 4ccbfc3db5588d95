"""Description of a scene in plain text, with which it can be implemented without stiction."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from stiction.scenes import Scene
from stiction.scenes.fields import GROUND
from stiction.scenes.resolved import resolved_scene

WIDTH = 100
"""Characters in a line."""
CONVENTIONS = """\
All quantities are in SI units (m, kg, s, N, rad), angles counter-clockwise. The mechanism moves in the
x-y plane; the ground is fixed and has its origin at (0, 0). The state of a body is the position (x, y) of
its centre of mass in ground axes and the angle of its own axes to those of the ground. A point of a body
is given in the axes of this body, from its centre of mass; a point of the ground in ground axes."""
FRICTION_LAW = """\
Friction in guides. R is the normal force on the slider, positive along n, the direction turned by +90
degrees. T is the total moment on the slider about its reference point, of the normal forces and of the
friction of both surfaces. It follows from the moments on the slider: if the reference point is the centre of
mass, T is the moment of inertia times the angular acceleration, minus the moment of all other loads about it. On
a guide that does not turn, T is therefore minus the moment of the other loads about the reference point,
and 0 if all of them act there. In a guide of the length a and the width b, the slider is a box that touches
the guide at its ends, at -a/2 and a/2 along the direction, on the lower or on the upper surface, at -b/2
and b/2 along n. With d = +1 for slip along the direction and d = -1 against it, the load of the
corners is
    N(c, d) = max(|R|, (2/a) |T + (b/2) c d R|),
where c is the coefficient of friction, mu or mus, and N = |R| in a guide without length. While the slider
slips in the direction d, the friction on it is f = -mu d N(mu, d). While it is at rest, f is the force that
keeps it at rest, and d is the direction opposite to f, in which the slider would otherwise start to move. It
stays at rest while |f| <= mus N(mus, d). When |f| would have to be larger, the slider starts to slip in the
direction d. The friction of the lower surface acts at -b/2 and has the share of the corners that touch it,
that of the upper surface acts at b/2: their moment is part of T."""
MODE = """The mode of a joint is 0 while it is at rest, and otherwise the sign of its slip velocity. Where a slip
velocity is zero only for an instant, the mode is that of the slip which follows and, in the first of two
rows of this instant, that of the slip before it."""


def description_of(scene: Scene, row: Mapping[str, Any]) -> str:
    """Return the description of a scene; `row` is its row in the table of scenes of the benchmark."""
    data = resolved_scene(scene)["scene"]
    blocks = [
        f"{scene.name}: {scene.title}\n{'=' * (len(scene.name) + len(scene.title) + 2)}",
        f"Simulate from t = 0 to t = {_number(data['t_end'])} s.",
        _wrapped(f"Source: {' '.join(data['source'].split())}"),
        CONVENTIONS,
        _section("Gravity", [_vector(data["gravity"]) + " m/s^2"]),
        _section("Bodies, and their state at t = 0", _bodies(data["bodies"])),
        _section("Joints", _joints(data["joints"])),
        _section("Motors", _drives(data["drives"])),
        _section("Springs", _springs(data["springs"])),
        _section("Loads", _loads(data["forces"])),
        _section("Result", _columns(data, row)),
    ]
    has_guide_friction = any(joint.get("mu") is not None for joint in data["joints"].values())
    if has_guide_friction:
        blocks.insert(-1, FRICTION_LAW)
    return "\n\n".join(block for block in blocks if block) + "\n"


def _section(title: str, lines: Sequence[str] | Iterator[str]) -> str:
    """Return a titled section with its lines indented; empty if there are none."""
    wrapped = [_wrapped(line, "  ") for line in lines]
    return "\n".join([title, *wrapped]) if wrapped else ""


def _wrapped(text: str, indent: str = "") -> str:
    """Return a text in lines of `WIDTH` characters."""
    return textwrap.fill(
        text,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + "  " if indent else "",
        break_on_hyphens=False,
    )


def _number(value: float) -> str:
    """Return a number with all its digits."""
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)


def _vector(vector: Sequence[float]) -> str:
    """Return a vector or a point with all its digits."""
    return f"({', '.join(_number(value) for value in vector)})"


def _point(point: Sequence[float], body: str) -> str:
    """Return the words for a point of a body."""
    if body == GROUND:
        return f"the point {_vector(point)} of the ground"
    if not any(point):
        return f"the centre of mass of {body}"
    return f"the point {_vector(point)} of {body}"


def _bodies(bodies: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of all bodies."""
    for name, body in bodies.items():
        yield (
            f"{name}: mass {_number(body['mass'])} kg, moment of inertia about the centre of mass "
            f"{_number(body['inertia'])} kg m^2; position {_vector(body['position'])} m, angle "
            f"{_number(body['angle'])} rad; velocity {_vector(body['velocity'])} m/s, angular velocity "
            f"{_number(body['angular_velocity'])} rad/s"
        )


def _joints(joints: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of all joints."""
    for name, joint in joints.items():
        if joint["type"] == "revolute":
            first, second = joint["bodies"]
            yield (
                f"{name} (pin): {_sentence(_point(joint['points'][0], first))} coincides with "
                f"{_point(joint['points'][1], second)}."
            )
            yield from _constant_friction(
                joint,
                f"the angular velocity of {first} relative to {second}",
                f"torque on {first}",
                "N m",
            )
            if joint["damping"]:
                yield (
                    f"  Viscous damping: a torque on {first} of -{_number(joint['damping'])} N m s/rad times "
                    "that angular velocity."
                )
            continue
        yield from _guide(name, joint)


def _guide(name: str, guide: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a guide."""
    slider, carrier = guide["slider"], guide["guide"]
    of_carrier = "the ground" if carrier == GROUND else carrier
    yield (
        f"{name} (guide): {_sentence(_point(guide['slider_point'], slider))}, its reference point, moves on the "
        f"straight line through {_point(guide['point'], carrier)} with the direction "
        f"{_vector(guide['direction'])} in the axes of {of_carrier}. The angle of {slider} minus that of "
        f"{of_carrier} is {_number(guide['angle'])} rad."
    )
    yield (
        f"  displacement: the distance of the two points along the direction; slip velocity: its rate, as seen "
        f"from {of_carrier}."
    )
    if guide["mu"] is not None:
        size = "no length"
        if guide["length"] is not None:
            size = f"length a = {_number(guide['length'])} m, width b = {_number(guide['width'])} m"
        yield (
            f"  Coulomb friction: mu = {_number(guide['mu'])} in slip, mus = {_number(guide['mus'])} at rest; "
            f"{size}."
        )
    elif guide["friction"] is None:
        yield "  No friction."
    yield from _constant_friction(guide, "the slip velocity", f"force on {slider}", "N")


def _constant_friction(
    joint: Mapping[str, Any], rate: str, effort: str, unit: str
) -> Iterator[str]:
    """Yield the line of friction with a constant bound, if a joint has it."""
    if joint["friction"] is None:
        return
    yield (
        f"  Dry friction with a bound that does not depend on other forces: a {effort} of "
        f"{_number(joint['friction'])} {unit} against {rate} in slip; at rest any {effort} up to "
        f"{_number(joint['static_friction'])} {unit} that keeps the joint at rest."
    )


def _drives(drives: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of all motors."""
    for name, drive in drives.items():
        first, second = drive["bodies"]
        if drive["type"] == "angle":
            coordinate = f"the angle of {first} minus that of {second}"
            effort = (
                f"the torque (N m) that the motor exerts on {first}; {second} gets the opposite one"
            )
        else:
            coordinate = _distance(drive)
            effort = f"the force (N) that the motor exerts on {first} along it"
        yield f"{name}: prescribes {coordinate}: {_law(drive['law'])}. Its effort is {effort}."


def _distance(element: Mapping[str, Any]) -> str:
    """Return the words for the coordinate between two points."""
    first, second = element["bodies"]
    ends = f"from {_point(element['points'][1], second)} to {_point(element['points'][0], first)}"
    if element["axis"] is None:
        return f"the distance {ends}"
    of_second = "the ground" if second == GROUND else second
    return f"the component along {_vector(element['axis'])}, in the axes of {of_second}, of the vector {ends}"


def _springs(springs: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of all springs."""
    for name, spring in springs.items():
        first, second = spring["bodies"]
        if spring["type"] == "torsional":
            coordinate = f"u, the angle of {first} minus that of {second}"
            units, rest = ("N m/rad", "N m s/rad"), spring["rest_angle"]
            effect = f"a torque of -k (u - u0) - c u' on {first} and the opposite one on {second}"
        else:
            coordinate = f"u, {_distance(spring)}"
            units, rest = ("N/m", "N s/m"), spring["rest_length"]
            effect = (
                f"a force of -k (u - u0) - c u' along it on that point of {first}, and the opposite one on that "
                f"of {second}"
            )
        yield (
            f"{name}: acts on {coordinate}: {effect}; k = {_number(spring['stiffness'])} {units[0]}, c = "
            f"{_number(spring['damping'])} {units[1]}, u0 = {_number(rest)}."
        )


def _loads(loads: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of all applied forces and torques."""
    for name, load in loads.items():
        if load["type"] == "torque":
            yield f"{name}: a torque on {load['body']}, N m: {_law(load['law'])}."
        else:
            yield (
                f"{name}: a force on {_point(load['point'], load['body'])} in the direction "
                f"{_vector(load['direction'])} of the ground, N: {_law(load['law'])}."
            )


def _law(law: Mapping[str, Any]) -> str:
    """Return a law of time as a formula."""
    if law["type"] == "constant":
        return f"{_number(law['value'])} at all times"
    if law["type"] == "linear":
        return f"{_number(law['offset'])} + {_number(law['rate'])} t"
    if law["type"] == "sine":
        return (
            f"{_number(law['offset'])} + {_number(law['amplitude'])} sin({_number(law['frequency'])} t + "
            f"{_number(law['phase'])})"
        )
    raise ValueError(f"law: found {law['type']}; expected constant, linear or sine")


def _columns(data: Mapping[str, Any], row: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines about the table that a solver writes."""
    yield (
        f"A row at least every {row['max_step']:g} s from t = 0 to {_number(data['t_end'])} s, with the column t "
        "and one or more of:"
    )
    yield "BODY.x, BODY.y, BODY.angle, BODY.vx, BODY.vy, BODY.omega for each body"
    for name, joint in data["joints"].items():
        has_friction = joint["mu"] is not None or joint["friction"] is not None
        if joint["type"] == "translational":
            yield f"{name}.displacement, {name}.slip_velocity, {name}.normal_force (R on the slider)"
        if has_friction:
            quantity = "force on the slider along the direction"
            if joint["type"] == "revolute":
                quantity = f"torque on {joint['bodies'][0]}"
                yield f"{name}.slip_velocity"
            yield f"{name}.friction ({quantity}), {name}.mode"
    for name in data["drives"]:
        yield f"{name}.effort"
    if row["rest_speed"] is not None:
        yield " ".join(MODE.split())
    yield (
        f"Bound of the position error: {row['position_bound']:g} m, where the error of an angle counts times "
        f"{row['mechanism_size']:.6g} m."
    )
    if row["effort_bound"] is not None:
        yield (
            f"The motors prescribe the motion: the mean error of their efforts counts as well, and its bound is "
            f"{row['effort_bound']:g} in the unit of the effort."
        )
    if row["rest_speed"] is not None:
        yield f"A joint is at rest if its slip velocity is at most {row['rest_speed']:g} m/s (pins: rad/s)."


def _sentence(text: str) -> str:
    """Return a text with a capital letter at its beginning."""
    return text[0].upper() + text[1:]
