"""Base of engines that are files of users: their capabilities are declared in a file, their results are tables."""

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
_MAX_COLUMNS_SHOWN = 4
"""Number of missing columns that a message lists at most."""


class Declared(Model):
    """Capabilities that a file declares; docs/how-to/program.md explains each key.

    Attributes
    ----------
    fidelity
        The fidelity of the runs.
    friction_law
        The friction law in words; empty if there is none.
    friction_supplied_by
        What computes the friction. The default is the engine behind the file. A program that drives an engine without
        Coulomb's law, and computes the friction for it, is its adapter.
    static_coefficient
        Whether static coefficients may differ from kinetic ones.
    regularized
        Whether friction is a regularized law, which Coulomb's cone does not bound.
    impulses
        Whether steps are formulated in impulses.
    adaptive
        Whether steps are adapted to a tolerance.
    locates_events
        Whether events are located.
    order
        Order of the method.
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
        """Yield each contradiction: the key, the value found, and what was expected."""
        supplier = self.friction_supplied_by
        if self.friction_law and supplier == Supplier.NOBODY:
            others = ", ".join(repr(str(each)) for each in Supplier if each != Supplier.NOBODY)
            yield (
                FRICTION_SUPPLIED_BY,
                str(supplier),
                f"expected one of {others}: friction_law is {self.friction_law!r}",
            )


class DeclaredEngine(Engine):
    """Base of engines with declared capabilities.

    Attributes
    ----------
    declared : Declared
        The declared capabilities.
    reactions : str
        Source of the reactions, see `Capabilities`.
    """

    declared: Declared
    reactions: ClassVar[str] = "momentum balance"

    @cached_property
    def capabilities(self) -> Capabilities:  # type: ignore[override]
        """Capabilities according to the file; the file does not declare the source of reactions."""
        declared = self.declared
        fidelity = declared.fidelity
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
        # Forces of a table without accelerations follow from differences of velocities, which are
        # wrong by O(1) where a force jumps.
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
        """Turn problems of a table into a `BadTrajectory` of this engine."""
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
        """Return the trajectory of a table.

        Missing accelerations are differences of velocities, which the trajectory's setting ``accelerations`` states.

        Parameters
        ----------
        scene : Scene
            The scene.
        table : ResultTable
            The rows of the engine.
        events : callable
            Returns the events for all columns of the rows.
        settings : Mapping
            Settings of the run, to be stored.
        cost : Cost
            Cost of the run.
        termination : str
            "end", or why the run ended early.
        assembly : Assembly, optional
            Mechanisms of the scene.

        Raises
        ------
        BadTrajectory
            If columns are missing that cannot be computed from the others.
        """
        # imported here because it compiles kernels
        from stiction.reference_impl.multibody.reactions import recover_columns

        self._check_states(scene, table)
        accelerations = self._missing_accelerations(scene, table)
        derived = {"accelerations": DIFFERENCES} if accelerations else {}
        given = {**table.columns, **accelerations}
        q, v, a = (
            stacked(given, scene.bodies, labels)
            for labels in (POSITIONS, VELOCITIES, ACCELERATIONS)
        )
        # Forces and modes of the table are prescribed when the others are computed by the balance of
        # momentum. All columns of the table are kept as they are.
        not_of_bodies = {
            name: values
            for name, values in given.items()
            if name.rpartition(".")[0] not in scene.bodies
        }
        whole = assembly_of(scene, assembly).whole
        columns = recover_columns(scene, table.t, q, v, a, not_of_bodies, whole) | given
        fidelity = self.declared.fidelity
        return Trajectory(
            scene=scene.name,
            engine=self.name,
            version=self.version,
            fidelity=fidelity,
            t=table.t[table.rows_after],
            columns={name: values[table.rows_after] for name, values in columns.items()},
            events=tuple(events(columns)),
            settings={
                **settings,
                **derived,
                "friction_law": self.capabilities.friction_law[fidelity],
            },
            cost=cost,
            termination=termination,
        )

    def _check_states(self, scene: Scene, table: ResultTable) -> None:
        """Raise BadTrajectory if a table lacks positions or velocities."""
        missing = [column for column in state_columns(scene) if column not in table.columns]
        if missing:
            more = ", .." if len(missing) > _MAX_COLUMNS_SHOWN else ""
            raise BadTrajectory(
                f"{self.name} returned no column {', '.join(missing[:_MAX_COLUMNS_SHOWN])}{more};"
                " expected positions and velocities of all bodies"
            )

    def _missing_accelerations(self, scene: Scene, table: ResultTable) -> dict[str, np.ndarray]:
        """Return the accelerations that a table lacks, as differences of velocities."""
        differences: dict[str, np.ndarray] = {}
        for body in scene.bodies:
            for velocity, acceleration in zip(VELOCITIES, ACCELERATIONS):
                column = f"{body}.{acceleration}"
                if column in table.columns:
                    continue
                # Differences need one row for each time, and two times at least.
                if len(table.rows_before) < max(2, len(table.t)):
                    raise BadTrajectory(
                        f"{self.name} returned no column {column}; expected accelerations where a "
                        "time has two rows, or the run a single one"
                    )
                differences[column] = np.gradient(table.columns[f"{body}.{velocity}"], table.t)
        return differences


def read_declaration(file: Path, model: type[Declaration]) -> Declaration:
    """Return the TOML file of a model, validated; raise FileError with all its problems at once."""
    try:
        return model.model_validate(read_toml(file, str(file)))
    except ValidationError as error:
        raise FileError(str(file), problems_of(error, model)) from None


def state_columns(scene: Scene) -> list[str]:
    """Return the columns that a table of an engine must have: positions and velocities of all bodies."""
    return [f"{body}.{label}" for body in scene.bodies for label in POSITIONS + VELOCITIES]
