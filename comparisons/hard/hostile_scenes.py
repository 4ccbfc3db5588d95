"""Texts of scenes that no solver may accept, or that may be more than it can do, which it then must say."""

from __future__ import annotations

from collections.abc import Mapping

SLED = """\
t_end = 0.5
gravity = [0, -9.81]
[bodies.sled]
mass = 2
inertia = 1
[joints.guide]
type = "translational"
slider = "sled"
length = 0.4
width = 0.1
mu = 0.2
"""

DRIVES = """
[drives.one]
type = "distance"
bodies = ["sled", "ground"]
axis = [1, 0]
law = { type = "sine", amplitude = 1, frequency = 2 }
[drives.two]
type = "distance"
bodies = ["sled", "ground"]
axis = [1, 0]
law = { type = "linear", rate = 2 }
"""
"""Both start at 0 with 2 m/s and 0 m/s^2, so that the start meets both; from then on they part, by t^3 4/3 m."""

STONE = """
[bodies.stone]
mass = 3
inertia = 1
position = [5, 5]
"""
LINKS = 10_000


def chain() -> str:
    """A scene file of `LINKS` rods that hang on each other, at rest."""
    rods = "\n".join(f"b{i} = {{ mass = 1, inertia = 0.1, position = [0, {-i - 0.5}] }}" for i in range(LINKS))
    pins = "\n".join(f'j{i} = {{ type = "revolute", bodies = ["b{i}", "{f"b{i - 1}" if i else "ground"}"], '
                     f"points = [[0, 0.5], [0, {-0.5 if i else 0}]] }}" for i in range(LINKS))
    return f"t_end = 0.01\ngravity = [0, -9.81]\n[bodies]\n{rods}\n[joints]\n{pins}\n"


def driven_twice() -> str:
    """The sled with two drives that contradict each other after the start."""
    return SLED.replace("inertia = 1", "inertia = 1\nvelocity = [2, 0]") + DRIVES


TEXTS = {"sled": lambda: SLED, "sled and stone": lambda: SLED + STONE, "sled driven twice": driven_twice,
         "chain": chain, "gigantic": lambda: "#" * (5 * 2 ** 20) + "\n" + SLED, "nested": lambda: "x = " + "[" * 50_000}
"""Texts by the names that ``cases.toml`` has for them."""


def scene_text(name: str, changes: Mapping[str, str]) -> str:
    """One of `TEXTS` with parts of it replaced, each of which it has once."""
    text = TEXTS[name]()
    for found, replacement in changes.items():
        if text.count(found) != 1:
            raise ValueError(f"{name}: found {text.count(found)} times {found!r}; expected it once")
        text = text.replace(found, replacement)
    return text
