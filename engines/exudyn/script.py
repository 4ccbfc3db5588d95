"""A scene as a Python script for Exudyn, the model that its users would write by hand.

The script adds the same items as the adapter's `Model`, in the same order: a recorder takes the place of Exudyn's
system, and each item becomes a line. Friction is that of Exudyn's bristles (`bristles`), because the located switches
of `stepping` are a program of the adapter, and cannot be part of a model.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from functools import partial, partialmethod
from typing import Any

import numpy as np

from stiction.engines.assembly import Assembly
from stiction.engines.exudyn.bristles import LEAST, BristleGuide, bristles_of
from stiction.engines.exudyn.model import Model
from stiction.engines.exudyn.solver import INTEGRATORS
from stiction.engines.exudyn.stepping import (
    DISCONTINUOUS_TOLERANCE,
    FRICTION_REPETITIONS,
    GRID_ROUNDING,
)
from stiction.engines.protocol import Refused
from stiction.engines.shared.law_expression import law_expression
from stiction.reference_impl.multibody.equation_summary import constraint_rows, rank
from stiction.scenes import Scene
from stiction.scenes.laws import Law
from stiction.scenes.model import Drive, LinearSpring

_SCRIPT = '''"""{title}

Exudyn builds and runs this scene of stiction ({name}). The adapter of stiction makes the same motion with
method=bristles and the settings below: `stiction run {scene} --engine exudyn{options} --dt {dt!r} --t-end {t_end!r}`.
"""

{math}import exudyn as exu
from exudyn.itemInterface import (
{imported})

container = exu.SystemContainer()
mbs = container.AddSystem()

{items}
{friction}
settings = exu.SimulationSettings()
settings.solution.file.write = False
settings.linearSolver.solverType = exu.LinearSolverType.{solver}
settings.linearSolver.ignoreSingularJacobian = {redundant}
integration = settings.timeIntegration
integration.verboseMode = 0
integration.endTime, integration.numberOfSteps = {t_end!r}, {steps}
integration.adaptiveStep = integration.automaticStepSize = False
integration.generalizedAlpha.useNewmark, integration.generalizedAlpha.useIndex2Constraints = {newmark}, {index_2}
integration.generalizedAlpha.spectralRadius = {spectral_radius!r}
integration.newton.relativeTolerance = integration.newton.absoluteTolerance = {newton_tolerance!r}
integration.discontinuous.iterationTolerance = {discontinuous_tolerance!r}
integration.discontinuous.maxIterations = {repetitions}
integration.discontinuous.ignoreMaxIterations = False
mbs.SolveDynamic(settings)

print("t = {t_end:g} s; x, y (m), angle (rad), and their rates, of")
for name, node in {nodes}:
    kinds = exu.OutputVariableType.Coordinates, exu.OutputVariableType.Coordinates_t
    state = [mbs.GetNodeOutput(node, kind) for kind in kinds]
    print(f"{{name}}:", *(float(value) for part in state for value in part))
'''

_FRICTION = """

# Friction. With R the normal force and M the moment of a guide, both multipliers of its joint, the surfaces of a slider
# of length a and width b bear N = |n1| + |n2| = max(|R|, (2/a) |M|). Exudyn has no friction whose bound depends on a
# reaction: before each step the bristles get the bounds mu N, (mus - mu) N of the multipliers of the step before, and
# the slider the moment (b/2) (f/N) R of friction f on its surfaces. The excess falls to 37 % at the speed that it makes
# in a step.
# Joint, bristles, loads of the surfaces' moment with their signs, mu, mus - mu, that speed over the excess,
# 2/a (0 without a length), b/2, and the constant parts of both bounds:
guides = (
{guides}
)


def renew_friction(mbs, t):
    multipliers = mbs.systemData.GetAECoordinates()
    for joint, bristles, moments, mu, excess, decay, lever, half_width, bound, more in guides:
        R, M = (multipliers[row] for row in mbs.systemData.GetObjectLTGAE(joint))
        N = max(abs(R), lever * abs(M))
        friction = -mbs.GetObjectOutput(bristles, exu.OutputVariableType.Force)  # of the step before, with its bounds
        # bristles without a force are left out
        mbs.SetObjectParameter(bristles, "dynamicFrictionForce", max(bound + mu * N, {least}))
        mbs.SetObjectParameter(bristles, "staticFrictionOffsetForce", excess * N + more)
        mbs.SetObjectParameter(bristles, "exponentialDecayStatic", max(decay * (excess * N + more), {least}))
        for load, sign in moments:
            mbs.SetLoadParameter(load, "loadVector", [0.0, 0.0, sign * half_width * friction / N * R if N else 0.0])
    return True


mbs.SetPreStepUserFunction(renew_friction)
"""


def exudyn_script(
    scene: Scene, dt: float, t_end: float, options: Mapping[str, Any], named: str
) -> str:
    """Return a script that builds and runs the scene with Exudyn alone, and prints the states at the end.

    If `t_end` is no multiple of `dt`, all steps are a little shorter. `options` are all settings of the adapter's
    ``method="bristles"``; `named` is the scene's name in the command line of the script's docstring.

    Raises
    ------
    Refused
        If the scene has a law by table, a drive or a spring that Exudyn has no item for, or surface friction with both
        kinds of bounds.
    """
    # Building the model records its lines; what the friction needs of each guide follows from it.
    model = _Written(scene)
    bristles = bristles_of(model, options, dt, Assembly(scene).whole)
    # Constant bounds are parameters of the items; those of the others are renewed in each step.
    guides = [each for each in bristles if isinstance(each, BristleGuide) and each.mus > 0.0]
    for guide in guides:
        if guide.static_constant > 0.0 and guide.half_width > 0.0:
            raise Refused(
                f"joints.{guide.name}: a constant bound beside mu, in a guide with a width, is not written as a "
                "script; expected one of them"
            )
    model.assemble()
    redundant = rank(scene) < constraint_rows(scene)
    # A row of the script's table of guides for each; see `_FRICTION` for its entries.
    rows = [
        _text(
            (
                model.constraints[guide.name],
                guide.bristles,
                tuple(guide.moments),
                guide.coefficient,
                guide.mus - guide.coefficient,
                guide.decay,
                guide.lever,
                guide.half_width,
                guide.constant,
                guide.static_constant - guide.constant,
            )
        )
        for guide in guides
    ]
    newmark, index_2 = INTEGRATORS[options["integrator"]]
    nodes = [(name, model.nodes[name]) for name in scene.bodies]
    # Functions are surrounded by two empty lines each; neighbours share them.
    items = re.sub(r"\n{4,}", "\n\n\n", "\n".join(model.system.lines))
    return _SCRIPT.format(
        title=scene.title,
        name=scene.name,
        scene=named,
        options=" --setting method=bristles" if bristles else "",
        imported=textwrap.fill(
            ", ".join(sorted(model.items.used)),
            140,
            initial_indent=" " * 4,
            subsequent_indent=" " * 4,
        ),
        math="import math\n\n" if "math." in items else "",
        items=items,
        friction=_FRICTION.format(guides="\n".join(f"    {row}," for row in rows), least=LEAST)
        if guides
        else "",
        solver="EigenDense" if redundant else "EXUdense",
        redundant=redundant,
        newmark=newmark,
        index_2=index_2,
        discontinuous_tolerance=DISCONTINUOUS_TOLERANCE,
        repetitions=FRICTION_REPETITIONS,
        dt=dt,
        t_end=t_end,
        steps=math.ceil(t_end / dt - GRID_ROUNDING),
        nodes=_text(tuple(nodes)),
        **{key: options[key] for key in ("spectral_radius", "newton_tolerance")},
    )


_NO_ITEM = "{}: Exudyn has no item for it, and the adapter's function is not written as a script"


class _Name(str):
    """A variable of the script, whose representation is its name without quotes."""

    __repr__ = str.__str__


class _Items:
    """Stand-in for `exudyn.itemInterface`: makes any item a dict of its arguments; `used` are the items made."""

    def __init__(self) -> None:
        self.used: set[str] = set()

    def __getattr__(self, item: str) -> Any:
        self.used.add(item)
        return partial(dict, item=item)


class _System:
    """Stand-in for Exudyn's system: each item that is added becomes one of `lines`, its number a variable."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._taken: set[str] = set()

    def _add(self, kind: str, item: dict[str, Any]) -> _Name:
        variable = self.variable(item.get("name", ""), kind.lower())
        made = item.pop("item")
        arguments = ", ".join(f"{key}={_text(value)}" for key, value in item.items())
        self.lines.append(f"{variable} = mbs.Add{kind}({made}({arguments}))")
        return variable

    AddNode = partialmethod(_add, "Node")
    AddObject = partialmethod(_add, "Object")
    AddMarker = partialmethod(_add, "Marker")
    AddLoad = partialmethod(_add, "Load")

    def Assemble(self) -> None:
        self.lines.append("mbs.Assemble()")

    def variable(self, name: str, kind: str) -> _Name:
        """Return a variable's name that the script does not have yet, numbered from the second one on."""
        wanted = "_".join(part for part in (re.sub(r"\W", "_", name), kind) if part)
        free = wanted
        number = 1
        while free in self._taken:
            number += 1
            free = f"{wanted}_{number}"
        self._taken.add(free)
        return _Name(free)


class _Written(Model):
    """The adapter's model as lines of a script, in which variables hold the numbers of objects."""

    def _open(self) -> None:
        self.items, self.system = _Items(), _System()

    def multipliers(self, item: int) -> list[int]:
        """Return none: the script looks them up, when the system has been assembled."""
        return []

    def _general_drive(self, name: str, drive: Drive) -> Any:
        raise Refused(_NO_ITEM.format(f"drives.{name}"))

    def _spring_along_moving_axis(self, name: str, spring: LinearSpring) -> None:
        raise Refused(_NO_ITEM.format(f"springs.{name}"))

    def _function(self, element: str, item: str, name: str, law: Law, derivative: int) -> _Name:
        # A function in the script, before the item that uses it. Exudyn calls functions of loads and
        # of connectors with different arguments.
        if (value := law_expression(law, derivative)) is None:
            raise Refused(
                f"{element}: a law by table is not written as a script; expected another type of law"
            )
        variable = self.system.variable(element, re.sub("UserFunction", "", name).lower())
        arguments, result = "item, offset", value
        if name == "loadVectorUserFunction":
            arguments, result = "load", f"[{value} * x for x in load]"
        self.system.lines += [f"\n\ndef {variable}(mbs, t, {arguments}):\n    return {result}\n\n"]
        return variable


def _text(value: Any) -> str:
    """Return a value, which may contain variables and numbers of NumPy, as Python source."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, tuple):
        return "(" + ", ".join(map(_text, value)) + ("," if len(value) == 1 else "") + ")"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(_text, value)) + "]"
    return repr(value.item() if isinstance(value, np.generic) else value)
