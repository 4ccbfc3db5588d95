"""Engines that are files of others, with capabilities that a file declares and results that come back as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import StrictBool, StrictStr, ValidationError

from stiction.engines.examined import ACCELERATIONS, POSITIONS, VELOCITIES
from stiction.engines.protocol import BadTrajectory, Capabilities, Engine
from stiction.scenes import FileError, Scene, SceneError
from stiction.scenes.errors import problems_in_tables
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
    """Capabilities that a file declares; see `stiction.engines.Capabilities`."""

    fidelity: Literal["joint", "contact"] = "joint"
    """`"joint"` or `"contact"`"""
    friction_law: StrictStr = ""
    """In words; empty where it has no friction"""
    static_coefficient: StrictBool = False
    """Whether it has mus > mu"""
    regularized: StrictBool = False
    """Whether friction may leave Coulomb's cone"""
    impulses: StrictBool = False
    """Whether steps exchange impulses between velocities"""
    adaptive: StrictBool = False
    """Whether it takes a tolerance instead of a step"""
    locates_events: StrictBool = False
    """Whether it reports the events of its runs"""
    order: StrictStr = "unknown"
    """Order of convergence that it promises"""


class DeclaredEngine(Engine):
    """Base of engines with declared capabilities.

    Attributes
    ----------
    declared : Declared
    """

    declared: Declared

    def declare(self, declared: Declared) -> None:
        """Take over what a file declares."""
        self.declared, fidelity = declared, declared.fidelity
        self.capabilities = Capabilities(
            fidelities=(fidelity,), static_coefficient={fidelity: declared.static_coefficient},
            friction_law={fidelity: declared.friction_law or "none"}, reactions="momentum balance",
            order=declared.order, adaptive=declared.adaptive)

    def locates_events(self, fidelity: str, settings: Mapping[str, Any]) -> bool:
        return self.declared.locates_events

    def keeps_cone(self, fidelity: str, settings: Mapping[str, Any]) -> bool:
        return (super().keeps_cone(fidelity, settings) and not self.declared.regularized
                and "accelerations" not in settings)

    def steps_by_impulses(self, fidelity: str, settings: Mapping[str, Any]) -> bool:
        return self.declared.impulses

    def refusal(self, scene: Scene, fidelity: str) -> str | None:
        """See `Engine.refusal`: friction that the file does not declare."""
        for name, guide in scene.frictional_guides.items():
            if not self.declared.friction_law and guide.static_coefficient > 0:
                return f"joints.{name}: {self.name} declares no friction law"
            if not self.declared.static_coefficient and guide.static_coefficient != guide.mu:
                return (f"joints.{name}: {self.name} declares no static coefficient; mus = "
                        f"{guide.static_coefficient:g} is not mu = {guide.mu:g}")
        return None


def read_declaration(file: Path, model: type[Declaration], error: type[FileError],
                     capabilities: type[Declared]) -> Declaration:
    """Read a TOML file of a model whose table ``capabilities`` is of another.

    Raises
    ------
    FileError
        Of the class `error`, with all problems of the file at once.
    """
    try:
        return model.model_validate(read_toml(file, str(file)))
    except SceneError as found:  # of the file itself
        raise error(str(file), found.problems) from None
    except ValidationError as found:
        raise error(str(file), problems_in_tables(found, model, {"capabilities": capabilities})) from None


@contextmanager
def results_of(name: str) -> Iterator[None]:
    """Make what is wrong with a table a `BadTrajectory` of the engine of this name."""
    try:
        yield
    except FileError as error:
        raise BadTrajectory(f"{name} returned a result that cannot be used: "
                            + "; ".join(map(str, error.problems))) from None


def state_columns(scene: Scene) -> list[str]:
    """Names of the columns that a table of an engine must have: positions and velocities of all bodies."""
    return [f"{body}.{label}" for body in scene.bodies for label in POSITIONS + VELOCITIES]


def all_columns(scene: Scene, table: ResultTable, name: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """All columns at all rows of a table, and a setting that says so where accelerations are differences.

    Raises
    ------
    BadTrajectory
        Of the engine of this name, if columns are missing that nothing else gives.
    """
    from stiction.reference_impl.multibody.reactions import recover_columns  # compiles

    if missing := [column for column in state_columns(scene) if column not in table]:
        raise BadTrajectory(f"{name} returned no column {', '.join(missing[:4])}{', ..' * (len(missing) > 4)}; "
                            "expected positions and velocities of all bodies")
    found, made = dict(table.columns), {}
    for body in scene.bodies:
        for velocity, acceleration in zip(VELOCITIES, ACCELERATIONS):
            if (column := f"{body}.{acceleration}") not in found:
                if len(table.first) < max(2, len(table.t)):
                    raise BadTrajectory(f"{name} returned no column {column}; expected accelerations where a time has "
                                        "two rows, or the run a single one")
                found[column], made = np.gradient(found[f"{body}.{velocity}"], table.t), {"accelerations": DIFFERENCES}
    q, v, a = (stacked(found, scene.bodies, labels) for labels in (POSITIONS, VELOCITIES, ACCELERATIONS))
    states = {f"{body}.{label}" for body in scene.bodies for label in POSITIONS + VELOCITIES + ACCELERATIONS}
    reported = {column: values for column, values in found.items() if column not in states}
    return recover_columns(scene, table.t, q, v, a, reported) | found, made
