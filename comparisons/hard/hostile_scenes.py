"""Hostile scenes: those that no solver may accept, with the words that the refusal must contain, and those of which it may be
more than it can do, which it then must say."""

from __future__ import annotations

from stiction.comparisons.depth import Depth
from stiction.comparisons.hard.case import MOTION_OR_WORD, REFUSAL, HardCase
from stiction.comparisons.hard.checks import at_rest, both, follows
from stiction.scenes import Scene, Trajectory

SOUND = """\
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


def hostile_cases() -> list[HardCase]:
    """At loading or assembly refused for all solvers alike, unless a solver gets to see them."""
    def changed(name: str, found: str, replacement: str, must: str, words: str) -> HardCase:
        assert SOUND.count(found) == 1
        return _case(name, SOUND.replace(found, replacement), must, words)

    return [
        changed("zero mass", "mass = 2", "mass = 0", "refused: the mass is not > 0", "bodies.sled.mass"),
        changed("negative inertia", "inertia = 1", "inertia = -1", "refused: the inertia is not > 0", "bodies.sled.inertia"),
        changed("not a number", "mu = 0.2", "mu = nan", "refused: not finite", "joints.guide.mu"),
        changed("infinite length", "length = 0.4", "length = inf", "refused: not finite", "joints.guide.length"),
        changed("overflow", "mass = 2", 'mass = "10^400"', "refused: beyond the largest number", "bodies.sled.mass"),
        _case("gigantic file", "#" * (5 * 2 ** 20) + "\n" + SOUND, "refused unread: more than 4 MiB", "bytes"),
        _case("nested without end", "x = " + "[" * 50_000, "refused: nested too deep", "nested"),
        changed("joint of a body that is not there", 'slider = "sled"', 'slider = "sledge"', "refused: no such body", "sledge"),
        HardCase("body that nothing holds", "hostile scenes", "", "the stone falls, g t^2/2, the sled beside it rests", 1e-3,
                 both(at_rest("sled"), follows(stone__y=lambda scene, t: 5 - 9.81 * t ** 2 / 2)), text=SOUND + STONE),
        HardCase("ten thousand bodies", "hostile scenes", "", "hangs at rest; or the word that this is too much", 1e-3,
                 at_rest(f"b{LINKS - 1}"), expected=MOTION_OR_WORD, text=chain, words="at most", depth=Depth.FULL),
        HardCase("contradictory drives", "hostile scenes", "", "no motion: two drives of one coordinate that part after the start",
                 1e-3, _parted, expected=REFUSAL, text=SOUND.replace("inertia = 1", "inertia = 1\nvelocity = [2, 0]") + DRIVES),
    ]


def _case(name: str, text: str, must: str, words: str) -> HardCase:
    return HardCase(name, "hostile scenes", "", must, 1e-3, expected=REFUSAL, text=text, words=words,
                    depth=Depth.QUICK if words == "bytes" else Depth.DEFAULT)


def _parted(_: list[Scene], runs: list[Trajectory]) -> dict[str, float]:
    return {"drift accepted": float(runs[0]["drift.position"][-1])}
