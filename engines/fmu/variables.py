"""Variables of an FMU by the columns and parameters of a scene, and the file that renames them.

A variable with the name of a column, such as ``slider.x``, is that column; one with the name of a parameter of the
scene, or of a number in it, such as ``joints.guide.mu``, is set. What is named otherwise, and what the FMU can do,
stands in ``model.map.toml`` next to ``model.fmu``: `Map`; docs/how-to/fmu.md shows one.
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
_SAME = 1e-12  # relative: a number that a model description has as text


def flattened(tables: Any) -> Any:
    """Values of nested tables by dotted keys; anything else as it is."""
    if not isinstance(tables, Mapping):
        return tables
    found: dict[str, Any] = {}
    for key, value in tables.items():
        found |= (
            {f"{key}.{rest}": one for rest, one in flattened(value).items()}
            if isinstance(value, Mapping)
            else {key: value}
        )
    return found


class FmuDeclared(Declared):
    """Capabilities of an FMU. It is made for its scenes, so that it has their friction unless it says otherwise."""

    friction_law: StrictStr = "the FMU's own"
    static_coefficient: StrictBool = True


class Map(Model):
    """Names in an FMU that are not the scene's, and what it can do.

    `scene`: its scenes, as `SCENE` has them. `interface`: of an FMU that has both, else co-simulation. `columns`:
    column -> ``"variable"``, ``"-variable"``, or a number where the FMU has none. `parameters`: name of a parameter or
    number of the scene -> ``"variable"``; ``""`` sets nothing. Of the capabilities `locates_events` says that events of
    model exchange change the variables ``GUIDE.mode``.
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
        """Yield what the map names and the FMU does not have."""
        known = self.by_name
        named = {
            f"columns.{key}": value
            for key, value in self.map.columns.items()
            if isinstance(value, str)
        }
        named |= {f"parameters.{key}": value for key, value in self.map.parameters.items() if value}
        for key, value in named.items():
            name = value.removeprefix("-") if key.startswith("columns.") else value
            if name not in known:
                yield Problem(
                    key,
                    shown(value),
                    f"expected a variable of the FMU: {names(known)}{did_you_mean(name, known)}",
                )
            elif not _is_number(known[name]):
                yield Problem(key, f"{shown(value)}, {known[name].type}", "expected a number alone")

    def sources(self, scene: Scene) -> dict[str, tuple[str, float, float]]:
        """Variable ("": none), factor and offset to SI units by column of the scene, for the columns that there are."""
        found: dict[str, tuple[str, float, float]] = {}
        for column in columns_of(scene):
            source = self.map.columns.get(column, column)
            if not isinstance(source, str):
                found[column] = "", 0.0, float(source)
            elif (
                variable := self.by_name.get(source.removeprefix("-"))
            ) is not None and _is_number(variable):
                sign = -1 if source.startswith("-") else 1
                factor, offset = self._unit(variable)
                found[column] = variable.name, sign * factor, sign * offset
        return found

    def refusal(self, scene: Scene) -> str | None:
        """Why the FMU is not of this scene: another one stated, another constant, a column that it lacks."""
        said, known, found = self.by_name.get(SCENE), columns_of(scene), self.sources(scene)
        stated = (self.map.scene or (said.start if said is not None else "") or "").split()
        if stated and not any(fnmatchcase(scene.name, pattern) for pattern in stated):
            return f"made for {' or '.join(stated)}; found {scene.name}"
        if unknown := [column for column in self.map.columns if column not in known]:
            return (
                f"{self.file}: columns.{unknown[0]}: {scene.name} has no such column"
                f"{did_you_mean(unknown[0], known)}"
            )
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
        needed = state_columns(scene)
        if self.map.capabilities.locates_events:
            needed += [f"{body}.{label}" for body in scene.bodies for label in BODY_COLUMNS[2]]
            needed += [f"{guide}.mode" for guide in scene.frictional_guides]
        if missing := [column for column in needed if column not in found]:
            return (
                f"no variable {names(missing)}; expected positions and velocities of all bodies (to locate events, "
                f"accelerations and modes too), by these names or in {self.file}"
            )
        return None

    def settable(self, scene: Scene) -> dict[str, float]:
        """Values of the scene by the FMU's parameters, in the units of these."""
        return {
            variable.name: value
            for _, variable, value in self._numbers(scene)
            if _can_be_set(variable, value)
        }

    def names(self, scene: Scene) -> list[str]:
        """Names of the variables that are columns of the scene."""
        return [name for name, *_ in self.sources(scene).values() if name]

    def undefined_units(self, scene: Scene) -> list[str]:
        """Names of units that the FMU uses and does not define: its numbers are taken as they are."""
        used = [self.by_name[name] for name in self.names(scene)] + [
            one for _, one, _ in self._numbers(scene)
        ]
        return sorted(
            {unit for variable in used if (unit := _unit_name(variable))} - self._units.keys()
        )

    def columns(self, scene: Scene, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Columns of the scene in SI units, from what fmpy has recorded, with the time as ``t``."""
        return {
            "t": rows["time"].astype(float),
            **{
                column: factor * rows[name or "time"].astype(float) + offset
                for column, (name, factor, offset) in self.sources(scene).items()
            },
        }

    def _numbers(self, scene: Scene) -> Iterator[tuple[str, ModelVariable, float]]:
        """Name in the scene, variable, and value in its unit of each parameter that the scene has too."""
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
    return (
        variable.unit
        or (variable.declaredType.unit if variable.declaredType is not None else None)
        or ""
    )


def _is_number(variable: ModelVariable) -> bool:
    return variable.type.startswith(_NUMBERS) and not variable.shape


def _can_be_set(variable: ModelVariable, value: float) -> bool:
    is_whole = not variable.type.startswith(("Real", "Float"))
    return (
        variable.causality == "parameter"
        and variable.variability != "constant"
        and not (is_whole and value != int(value))
    )
