"""Mistakes that authors of solvers make, as changes of a text in docs/examples/solvers/solver.py, each a right solver but for it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import tomli_w

SOLVERS = Path(__file__).parents[2] / "docs" / "examples" / "solvers"
_PRINT = '                print(k * h, *mechanism.q, *mechanism.v, *mean, sep=",", file=file)'
_MOVE = "x + h / 2 * (old + new) for x, old, new in zip(mechanism.q, mechanism.v, w)"
_STATE = "row = [k * h, *mechanism.q, *mechanism.v, *mean]"


def _written(change: str) -> tuple[str, str]:
    """A change of the row before it is written."""
    return _PRINT, "\n".join(
        " " * 16 + line for line in (_STATE, change, 'print(*row, sep=",", file=file)')
    )


class Bug(NamedTuple):
    """What is wrong, and texts of the solver with what stands in their place."""

    name: str
    changes: tuple[tuple[str, str], ...]


BUGS = tuple(
    Bug(name, changes)
    for name, *changes in (
        (
            "friction of the other sign, in the column alone",
            _written("n = 1 + 9 * len(scene['bodies']); row[n:] = [-f for f in row[n:]]"),
        ),
        (
            "friction half as large, in the column alone",
            _written(
                "row[1 + 9 * len(scene['bodies']):] = [f / 2 for f in row[1 + 9 * len(scene['bodies']):]]"
            ),
        ),
        ("friction that drives", ("<= hold else found", "<= hold else -found")),
        (
            "spring of the other sign",
            (
                'pull = spring["stiffness"] * (value - rest)',
                'pull = -spring["stiffness"] * (value - rest)',
            ),
        ),
        (
            "damper of the other sign",
            ('+ spring["damping"] * dot(row, v)', '- spring["damping"] * dot(row, v)'),
        ),
        ("damper left out", ('+ spring["damping"] * dot(row, v)', "")),
        (
            "rest length left out",
            ('spring["stiffness"] * (value - rest)', 'spring["stiffness"] * value'),
        ),
        ("load twice as large", ("size /= math.hypot(x, y)", "size *= 2 / math.hypot(x, y)")),
        ("load of the other sign", ("size /= math.hypot(x, y)", "size /= -math.hypot(x, y)")),
        (
            "lever of a load left out",
            ("enumerate((x, y, arm[0] * y - arm[1] * x))", "enumerate((x, y, 0.0))"),
        ),
        (
            "lever of friction left out (width)",
            ('abs(N - guide["width"] / 2 * kappa * R)', "abs(N)"),
        ),
        (
            "load of the corners without the moment",
            ("return max(abs(R), 2 * abs", "return abs(R) if abs else max(abs(R), 2 * abs"),
        ),
        ("mus taken for mu", ('most = guide["mu"] *', 'most = guide["mus"] *')),
        (
            "mus ignored",
            ('hold = guide["mus"] * load(', 'hold = guide["mu"] * load('),
            ('math.copysign(guide["mus"], held),', 'math.copysign(guide["mu"], held),'),
        ),
        ("mu 3 % too large", ('most = guide["mu"] *', 'most = 1.03 * guide["mu"] *')),
        (
            "stick ignored",
            (
                "P[k] = held if at_rest and abs(held) <= hold else found",
                "P[k] = math.copysign(most, held)",
            ),
        ),
        (
            "friction by the load of the step before",
            (
                "R, N = now[n + normal : n + normal + 2]",
                "R, N = getattr(self, 'old', now[n + normal:n + normal + 2])",
            ),
            (
                "        return sums(free, P, units)[:n], P",
                "        if self.guides:\n            self.old = sums(free, P, units)[n + self.guides[0][1]:n + self.guides[0][1] + 2]\n        return sums(free, P, units)[:n], P",
            ),
        ),
        (
            "explicit Euler",
            (_MOVE, "x + h * old for x, old in zip(mechanism.q, mechanism.v)"),
        ),
        (
            "semi-implicit Euler",
            (_MOVE, "x + h * new for x, new in zip(mechanism.q, w)"),
        ),
        (
            "g = 9.8",
            (
                "for m, g in zip(self.mass, (gx, gy, 0.0)",
                "for m, g in zip(self.mass, (gx * 9.8 / 9.81, gy * 9.8 / 9.81, 0.0)",
            ),
        ),
        (
            "weight left out",
            (
                "for m, g in zip(self.mass, (gx, gy, 0.0)",
                "for m, g in zip(self.mass, (0.0, 0.0, 0.0)",
            ),
        ),
        (
            "weight twice",
            (
                "for m, g in zip(self.mass, (gx, gy, 0.0)",
                "for m, g in zip(self.mass, (2 * gx, 2 * gy, 0.0)",
            ),
        ),
        (
            "inertia about another point",
            (
                'body["mass"], body["mass"], body["inertia"])',
                'body["mass"], body["mass"], body["inertia"] + 0.1 * body["mass"])',
            ),
        ),
        (
            "degrees for radians in the table",
            _written(
                "n = 3 * len(scene['bodies']); row[3:n + 1:3] = [57.29577951308232 * a for a in row[3:n + 1:3]]"
            ),
        ),
        ("millimetres in one column", _written("row[1] *= 1000")),
        (
            "a row late",
            _written(
                "row[1:], self_late = mechanism.__dict__.get('late', row[1:]), mechanism.__dict__.update(late=list(row[1:]))"
            ),
        ),
        ("time a step late", _written("row[0] = max(0, k - 1) * h if k < steps else row[0]")),
        (
            "single precision",
            _written(
                "import struct; row[1:] = [struct.unpack('f', struct.pack('f', x))[0] for x in row[1:]]"
            ),
        ),
        (
            "drive without its rate",
            ('wanted = law(row["law"], t + h)[1] - error / (10 * h)', "wanted = -error / (10 * h)"),
        ),
        (
            "acceleration of the other sign",
            _written(
                "n = 1 + 6 * len(scene['bodies']); m = n + 3 * len(scene['bodies']); row[n:m] = [-a for a in row[n:m]]"
            ),
        ),
    )
)


def declared(folder: Path, bug: Bug | None) -> Path:
    """Write the solver, with a bug, and its declaration to a folder; return the latter's path."""
    text = (SOLVERS / "solver.py").read_text()
    for old, new in bug.changes if bug else ():
        assert text.count(old) == 1, (bug, old)
        text = text.replace(old, new)
    folder.mkdir(exist_ok=True)
    (folder / "solver.py").write_text(text)
    path = folder / "mine.toml"
    path.write_text(
        tomli_w.dumps(
            {
                "name": "mine",
                "version": [sys.executable, "solver.py", "--version"],
                "command": [
                    sys.executable,
                    "solver.py",
                    "{scene}",
                    "{result}",
                    "{dt}",
                    "{output_step}",
                ],
                "capabilities": {
                    "friction_law": "Coulomb, set-valued",
                    "static_coefficient": True,
                    "impulses": True,
                    "order": "1",
                },
            }
        )
    )
    return path
