"""Variables of an FMU that are columns or parameters of a scene, and the file with their other names.

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
"""Text variable in which an FMU states the scenes that it is made for: names or patterns such as ``slider-bar-*``."""
CO_SIMULATION = "co-simulation"
"""Interface of an FMU with a solver of its own."""
MODEL_EXCHANGE = "model exchange"
"""Interface of an FMU whose equations are integrated from outside."""
_NUMBERS = ("Real", "Integer", "Boolean", "Enumeration", "Float", "Int", "UInt")
"""Beginnings of the numeric types of FMI 2 and 3."""
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
    """Capabilities of an FMU, which is made for its scenes and has their friction unless the file states otherwise."""

    friction_law: StrictStr = "the FMU's own"
    static_coefficient: StrictBool = True


class Map(Model):
    """Names in an FMU that differ from those of the scene, and its capabilities.

    Attributes
    ----------
    scene
        Scenes of the FMU, in the format of `SCENE`.
    interface
        Interface to use if the FMU has both; the default is co-simulation.
    columns
        For a column, ``"variable"``, ``"-variable"``, or a number if the FMU has no variable for it.
    parameters
        For a parameter or number of the scene, ``"variable"``; ``""`` sets nothing.
    capabilities
        What the FMU can represent. With `locates_events`, events of model exchange change the variables
        ``GUIDE.mode``.
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
    """Variables of an FMU by the names of a scene.

    Attributes
    ----------
    description : ModelDescription
        The model description, as fmpy reads it.
    map : Map
        Names of the variables.
    file : str
        File of the map, for messages.
    """

    description: ModelDescription
    map: Map
    file: str

    @cached_property
    def by_name(self) -> dict[str, ModelVariable]:
        """All variables by name."""
        return {variable.name: variable for variable in self.description.modelVariables}

    def problems(self) -> Iterator[Problem]:
        """Yield the names in the map that are no variables of the FMU, or no numbers."""
        for key, value in self.map.columns.items():
            if isinstance(value, str):
                yield from self._check_name(f"columns.{key}", value, value.removeprefix("-"))
        for key, value in self.map.parameters.items():
            if value:
                yield from self._check_name(f"parameters.{key}", value, value)

    def _check_name(self, key: str, value: str, name: str) -> Iterator[Problem]:
        """Yield a problem if the variable `name`, by the value of a key of the map, is not a number of the FMU."""
        variables = self.by_name
        if name not in variables:
            yield Problem(
                key,
                shown(value),
                f"expected a variable of the FMU: {names(variables)}{did_you_mean(name, variables)}",
            )
        elif not _is_number(variables[name]):
            yield Problem(key, f"{shown(value)}, {variables[name].type}", "expected a number alone")

    def sources(self, scene: Scene) -> dict[str, tuple[str, float, float]]:
        """Return the source of each column of the scene that the FMU has.

        It is a variable, or "" for a constant, and the factor and the offset that yield SI units.
        """
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
        """Return why the FMU cannot represent a scene: another scene or constant, a missing column; None if it can."""
        scene_variable = self.by_name.get(SCENE)
        stated_in_fmu = scene_variable.start if scene_variable is not None else ""
        patterns = (self.map.scene or stated_in_fmu or "").split()
        if patterns and not any(fnmatchcase(scene.name, pattern) for pattern in patterns):
            return f"made for {' or '.join(patterns)}; found {scene.name}"
        columns = columns_of(scene)
        for column in self.map.columns:
            if column not in columns:
                return (
                    f"{self.file}: columns.{column}: {scene.name} has no such column"
                    f"{did_you_mean(column, columns)}"
                )
        # A constant of the FMU has to be the number of the scene.
        for key, variable, value in self._numbers(scene):
            if _can_be_set(variable, value) or variable.start is None:
                continue
            if not math.isclose(float(variable.start), value, rel_tol=_SAME):
                return (
                    f"{key} = {value:g} cannot be set in it: {variable.name} is {variable.start}, "
                    f"{variable.variability}, {variable.type}"
                )
        # All other columns can be computed from the motion. To report an event, accelerations and modes on
        # both sides of it are needed, which do not follow from the motion between samples.
        needed = state_columns(scene)
        if self.map.capabilities.locates_events:
            needed += [f"{body}.{label}" for body in scene.bodies for label in BODY_COLUMNS[2]]
            needed += [f"{guide}.mode" for guide in scene.frictional_guides]
        sources = self.sources(scene)
        missing = [column for column in needed if column not in sources]
        if missing:
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
        columns = {"t": rows["time"].astype(float)}
        for column, (name, factor, offset) in self.sources(scene).items():
            # a constant has the factor 0, so that it may be computed from any variable
            columns[column] = factor * rows[name or "time"].astype(float) + offset
        return columns

    def _numbers(self, scene: Scene) -> Iterator[tuple[str, ModelVariable, float]]:
        """Yield name in the scene, variable, and value in its unit of each parameter that the scene has too."""
        # Numbers of the resolved scene have dotted keys, parameters of the scene have names. Inputs and
        # outputs of the FMU with such a name are no parameters.
        numbers = {**flattened(resolved_scene(scene)["scene"]), **scene.parameters}
        for key, value in numbers.items():
            variable = self.by_name.get(self.map.parameters.get(key, key))
            if variable is None or not _is_number(variable) or type(value) not in (int, float):
                continue
            if variable.causality == "parameter" or variable.variability == "constant":
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
        """Return factor and offset from the unit of a variable to SI units."""
        return self._units.get(_unit_name(variable), (1.0, 0.0))


def _unit_name(variable: ModelVariable) -> str:
    """Return the unit of a variable, its own or that of its type; empty if there is none."""
    if variable.unit:
        return variable.unit
    if variable.declaredType is not None and variable.declaredType.unit:
        return variable.declaredType.unit
    return ""


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
