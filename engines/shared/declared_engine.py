"""Engines that are files of others, with capabilities that a file declares and results that come back as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from pydantic import StrictBool, StrictStr, ValidationError

from stiction.engines.assembly import Assembly, assembly_of
from stiction.engines.examined import ACCELERATIONS, POSITIONS, VELOCITIES
from stiction.engines.protocol import (
    FRICTION_SUPPLIED_BY,
    BadTrajectory,
    Capabilities,
    Engine,
    Supplier,
)
from stiction.scenes import Cost, Event, FileError, Scene, Trajectory
from stiction.scenes.errors import problems_of
from stiction.scenes.fidelity import Fidelity
from stiction.scenes.fields import Model
from stiction.scenes.loading import read_toml
from stiction.scenes.result_table import ResultTable
from stiction.scenes.trajectory import stacked

Declaration = TypeVar("Declaration", bound=Model)
DEFAULT_RTOL = 1e-6
"""Relative tolerance where none is given."""
DIFFERENCES = "differences of velocities (adapter)"
"""Setting ``accelerations`` of a trajectory whose engine gave none."""


class Declared(Model):
    """Capabilities, as docs/how-to/program.md shows them.

    `friction_supplied_by` is the engine behind the file, unless the file says otherwise: a program that drives an
    engine without Coulomb's law, and computes the friction for it, is its adapter.
    """

    fidelity: Fidelity = Fidelity.JOINT
    friction_law: StrictStr = ""
    friction_supplied_by: Supplier = Supplier.ENGINE
    static_coefficient: StrictBool = False
    regularized: StrictBool = False
    impulses: StrictBool = False
    adaptive: StrictBool = False
    locates_events: StrictBool = False
    order: StrictStr = "unknown"

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        by = self.friction_supplied_by
        if self.friction_law and by == Supplier.NOBODY:
            others = ", ".join(repr(str(one)) for one in Supplier if one != Supplier.NOBODY)
            yield (
                FRICTION_SUPPLIED_BY,
                str(by),
                f"expected one of {others}: friction_law is {self.friction_law!r}",
            )


class DeclaredEngine(Engine):
    """Base of engines with declared capabilities."""

    declared: Declared
    reactions: ClassVar[str] = "momentum balance"

    @cached_property
    def capabilities(self) -> Capabilities:  # type: ignore[override]
        """Capabilities as the file declares them; it does not say where reactions come from."""
        declared, fidelity = self.declared, self.declared.fidelity
        return Capabilities(
            fidelities=(fidelity,),
            static_coefficient={fidelity: declared.static_coefficient},
            friction_law={fidelity: declared.friction_law or "none"},
            reactions=self.reactions,
            order=declared.order,
            adaptive=declared.adaptive,
            friction_by={fidelity: declared.friction_supplied_by},
        )

    def locates_events(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return self.declared.locates_events

    def keeps_cone(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return (
            super().keeps_cone(fidelity, settings)
            and not self.declared.regularized
            and "accelerations" not in settings
        )

    def steps_by_impulses(self, fidelity: Fidelity, settings: Mapping[str, Any]) -> bool:
        return self.declared.impulses

    def refusal(self, scene: Scene, fidelity: Fidelity) -> str | None:
        for name, guide in scene.frictional_guides.items():
            if not self.declared.friction_law and guide.static_coefficient > 0:
                return f"joints.{name}: {self.name} declares no friction law"
            if not self.declared.static_coefficient and guide.static_coefficient != guide.mu:
                return (
                    f"joints.{name}: {self.name} declares no static coefficient; mus = "
                    f"{guide.static_coefficient:g} is not mu = {guide.mu:g}"
                )
        return None

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Make what is wrong with a table a `BadTrajectory` of this engine."""
        try:
            yield
        except FileError as error:
            raise BadTrajectory(
                f"{self.name} returned a result that cannot be used: "
                + "; ".join(map(str, error.problems))
            ) from None

    def trajectory(
        self,
        scene: Scene,
        table: ResultTable,
        events: Callable[[Mapping[str, np.ndarray]], Iterable[Event]],
        settings: Mapping[str, Any],
        cost: Cost,
        termination: str,
        assembly: Assembly | None = None,
    ) -> Trajectory:
        """Return the trajectory of a table, `events` taken from all its columns.

        Accelerations that it does not have are differences of its velocities, which a setting says.

        Raises
        ------
        BadTrajectory
            If columns are missing that nothing else gives.
        """
        from stiction.reference_impl.multibody.reactions import recover_columns  # compiles

        if missing := [column for column in state_columns(scene) if column not in table.columns]:
            raise BadTrajectory(
                f"{self.name} returned no column {', '.join(missing[:4])}{', ..' * (len(missing) > 4)};"
                " expected positions and velocities of all bodies"
            )
        found, made = dict(table.columns), {}
        for body in scene.bodies:
            for velocity, acceleration in zip(VELOCITIES, ACCELERATIONS):
                if (column := f"{body}.{acceleration}") not in found:
                    if len(table.first) < max(2, len(table.t)):
                        raise BadTrajectory(
                            f"{self.name} returned no column {column}; expected accelerations where a "
                            "time has two rows, or the run a single one"
                        )
                    found[column] = np.gradient(found[f"{body}.{velocity}"], table.t)
                    made = {"accelerations": DIFFERENCES}
        q, v, a = (
            stacked(found, scene.bodies, labels)
            for labels in (POSITIONS, VELOCITIES, ACCELERATIONS)
        )
        columns = (
            recover_columns(
                scene,
                table.t,
                q,
                v,
                a,
                {
                    name: values
                    for name, values in found.items()
                    if name.rpartition(".")[0] not in scene.bodies
                },
                assembly_of(scene, assembly).whole,
            )
            | found
        )
        fidelity = self.declared.fidelity
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=table.t[table.last],
            columns={name: values[table.last] for name, values in columns.items()},
            events=tuple(events(columns)),
            settings={**settings, **made, "friction_law": self.capabilities.friction_law[fidelity]},
            cost=cost,
            termination=termination,
        )


def read_declaration(file: Path, model: type[Declaration]) -> Declaration:
    """Read a TOML file of a model; a FileError has all its problems at once."""
    try:
        return model.model_validate(read_toml(file, str(file)))
    except ValidationError as found:
        raise FileError(str(file), problems_of(found, model)) from None


def state_columns(scene: Scene) -> list[str]:
    """Names of the columns that a table of an engine must have: positions and velocities of all bodies."""
    return [f"{body}.{label}" for body in scene.bodies for label in POSITIONS + VELOCITIES]
