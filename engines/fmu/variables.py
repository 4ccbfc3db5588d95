"""Variables of an FMU by the columns and parameters of a scene, and the file that renames them.

A variable with the name of a column, such as ``slider.x``, is that column; one with the name of a parameter of the
scene, or of a number in it, such as ``joints.guide.mu``, is set. Other names, and the capabilities of the FMU, are in
``model.map.toml`` next to ``model.fmu``: `Map`; docs/how-to/fmu.md shows one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, StrictBool, StrictFloat, StrictInt, StrictStr

from stiction.engines.shared.declared_engine import Declared, state_columns
from stiction.scenes import Problem, Scene
from stiction.scenes.columns import BODY_COLUMNS, columns_of
from stiction.scenes.fields import Model
from stiction.scenes.resolved import resolved_scene
from stiction.scenes.wording import did_you_mean, names, shown

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

SCENE = "stiction.scene"
"""Text variable by which an FMU states the scenes that it is made for: names or patterns such as ``slider-bar-*``."""
CO_SIMULATION, MODEL_EXCHANGE = "co-simulation", "model exchange"
_NUMBERS = ("Real", "Integer", "Boolean", "Enumeration", "Float", "Int", "UInt")
"""Beginnings of the types of variables that are numbers, in FMI 2 and 3."""
_SAME = 1e-12
"""Relative difference of a number of the scene from one that a model description contains as text."""


def flattened(tables: Any) -> Any:
    """Return the values of nested tables by dotted keys; anything else as it is."""
    if not isinstance(tables, Mapping):
        return tables
    values: dict[str, Any] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping):
            values |= {f"{key}.{rest}": inner for rest, inner in flattened(value).items()}
        else:
            values[key] = value
    return values


class FmuDeclared(Declared):
    """Capabilities of an FMU. It is made for its scenes, so that it has their friction unless it states otherwise."""

    friction_law: StrictStr = "the FMU's own"
    static_coefficient: StrictBool = True


class Map(Model):
    """Names in an FMU that are not the scene's, and its capabilities.

    `scene`: its scenes, in the format of `SCENE`. `interface`: the one to use of an FMU that has both; the default is
    co-simulation. `columns`: column -> ``"variable"``, ``"-variable"``, or a number if the FMU has no variable for it.
    `parameters`: name of a parameter or number of the scene -> ``"variable"``; ``""`` sets nothing. The capability
    `locates_events` means that events of model exchange change the variables ``GUIDE.mode``.
    """

    scene: StrictStr = ""
    interface: Literal["co-simulation", "model exchange", ""] = ""
    columns: Annotated[
        dict[str, StrictStr | StrictFloat | StrictInt], BeforeValidator(flattened)
    ] = {}
    parameters: Annotated[dict[str, StrictStr], BeforeValidator(flattened)] = {}
    capabilities: FmuDeclared = FmuDeclared()


@dataclass(frozen=True)
class Variables:
    """Variables of an FMU, as fmpy describes them, and the names that a map, of a file, gives to them."""

    description: ModelDescription
    map: Map
    file: str

    @cached_property
    def by_name(self) -> dict[str, ModelVariable]:
        return {variable.name: variable for variable in self.description.modelVariables}

    def problems(self) -> Iterator[Problem]:
        """Yield the names in the map that are no variables of the FMU, or no numbers."""
        variables = self.by_name
        named = {
            f"columns.{key}": value
            for key, value in self.map.columns.items()
            if isinstance(value, str)
        }
        named |= {f"parameters.{key}": value for key, value in self.map.parameters.items() if value}
        for key, value in named.items():
            name = value.removeprefix("-") if key.startswith("columns.") else value
            if name not in variables:
                yield Problem(
                    key,
                    shown(value),
                    f"expected a variable of the FMU: {names(variables)}{did_you_mean(name, variables)}",
                )
            elif not _is_number(variables[name]):
                yield Problem(
                    key, f"{shown(value)}, {variables[name].type}", "expected a number alone"
                )

    def sources(self, scene: Scene) -> dict[str, tuple[str, float, float]]:
        """Return, by column of the scene that the FMU has: variable ("": none), factor and offset to SI units."""
        sources: dict[str, tuple[str, float, float]] = {}
        for column in columns_of(scene):
            source = self.map.columns.get(column, column)
            if not isinstance(source, str):
                # a constant of the map: zero times any variable, plus the number
                sources[column] = "", 0.0, float(source)
                continue
            variable = self.by_name.get(source.removeprefix("-"))
            if variable is not None and _is_number(variable):
                sign = -1 if source.startswith("-") else 1
                factor, offset = self._unit(variable)
                sources[column] = variable.name, sign * factor, sign * offset
        return sources

    def refusal(self, scene: Scene) -> str | None:
        """Return why the FMU is not of this scene: another scene stated, another constant, a missing column."""
        variable_of_scenes = self.by_name.get(SCENE)
        stated_in_fmu = variable_of_scenes.start if variable_of_scenes is not None else ""
        stated = (self.map.scene or stated_in_fmu or "").split()
        if stated and not any(fnmatchcase(scene.name, pattern) for pattern in stated):
            return f"made for {' or '.join(stated)}; found {scene.name}"
        columns, sources = columns_of(scene), self.sources(scene)
        if unknown := [column for column in self.map.columns if column not in columns]:
            return (
                f"{self.file}: columns.{unknown[0]}: {scene.name} has no such column"
                f"{did_you_mean(unknown[0], columns)}"
            )
        # A number that the FMU has as a constant has to be that of the scene.
        for key, variable, value in self._numbers(scene):
            if (
                not _can_be_set(variable, value)
                and variable.start is not None
                and (not math.isclose(float(variable.start), value, rel_tol=_SAME))
            ):
                return (
                    f"{key} = {value:g} cannot be set in it: {variable.name} is {variable.start}, "
                    f"{variable.variability}, {variable.type}"
                )
        # The other columns follow from the motion. To report an event, accelerations and modes on both
        # sides of it are needed, which the motion between samples does not give.
        needed = state_columns(scene)
        if self.map.capabilities.locates_events:
            needed += [f"{body}.{label}" for body in scene.bodies for label in BODY_COLUMNS[2]]
            needed += [f"{guide}.mode" for guide in scene.frictional_guides]
        if missing := [column for column in needed if column not in sources]:
            return (
                f"no variable {names(missing)}; expected positions and velocities of all bodies (to locate events, "
                f"accelerations and modes too), by these names or in {self.file}"
            )
        return None

    def settable(self, scene: Scene) -> dict[str, float]:
        """Return values of the scene by the FMU's parameters, in the units of these."""
        return {
            variable.name: value
            for _, variable, value in self._numbers(scene)
            if _can_be_set(variable, value)
        }

    def names(self, scene: Scene) -> list[str]:
        """Return the names of the variables that are columns of the scene."""
        return [name for name, *_ in self.sources(scene).values() if name]

    def undefined_units(self, scene: Scene) -> list[str]:
        """Return the names of units that the FMU uses without a definition; their numbers are taken as SI."""
        read = [self.by_name[name] for name in self.names(scene)]
        written = [variable for _, variable, _ in self._numbers(scene)]
        units = {_unit_name(variable) for variable in read + written} - {""}
        return sorted(units - self._units.keys())

    def columns(self, scene: Scene, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Return columns of the scene in SI units from the rows of fmpy, with the time as ``t``."""
        return {
            "t": rows["time"].astype(float),
            **{
                column: factor * rows[name or "time"].astype(float) + offset
                for column, (name, factor, offset) in self.sources(scene).items()
            },
        }

    def _numbers(self, scene: Scene) -> Iterator[tuple[str, ModelVariable, float]]:
        """Yield name in the scene, variable, and value in its unit of each parameter that the scene has too."""
        # Numbers of the resolved scene by dotted keys, and parameters of the scene by name. Inputs
        # and outputs of the FMU that have such a name are no parameters.
        for key, value in {**flattened(resolved_scene(scene)["scene"]), **scene.parameters}.items():
            variable = self.by_name.get(self.map.parameters.get(key, key))
            if (
                variable is not None
                and _is_number(variable)
                and type(value) in (int, float)
                and (variable.causality == "parameter" or variable.variability == "constant")
            ):
                factor, offset = self._unit(variable)
                yield key, variable, (value - offset) / factor

    @cached_property
    def _units(self) -> dict[str, tuple[float, float]]:
        """Factor and offset to SI units by the name of a unit that the FMU defines."""
        return {
            unit.name: (unit.baseUnit.factor, unit.baseUnit.offset)
            for unit in self.description.unitDefinitions
            if unit.baseUnit is not None
        }

    def _unit(self, variable: ModelVariable) -> tuple[float, float]:
        return self._units.get(_unit_name(variable), (1.0, 0.0))


def _unit_name(variable: ModelVariable) -> str:
    """Return the unit of a variable, its own or that of its type; empty if there is none."""
    of_type = variable.declaredType.unit if variable.declaredType is not None else None
    return variable.unit or of_type or ""


def _is_number(variable: ModelVariable) -> bool:
    """Return True for a variable that is a single number."""
    return variable.type.startswith(_NUMBERS) and not variable.shape


def _can_be_set(variable: ModelVariable, value: float) -> bool:
    """Return True if a variable is a parameter whose type has this value."""
    is_whole = not variable.type.startswith(("Real", "Float"))
    return (
        variable.causality == "parameter"
        and variable.variability != "constant"
        and not (is_whole and value != int(value))
    )
