"""Base class and field types of the elements of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from stiction.scenes.base_errors import InputError
from stiction.scenes.expressions import evaluate

GROUND = "ground"
"""Name of the fixed body."""
TAGS = ("type", "method")
"""Keys that name the class of a table: those of elements and laws, and that of the stabilization."""

SHORTEST_DIRECTION = 1e-100
"""Lower limit of the length of a direction: its square must not underflow to 0."""
LONGEST_DIRECTION = 1e100
"""Upper limit of the length of a direction: its square must not overflow."""

LIGHTEST = 1e-60
"""Smallest mass and inertia, kg and kg m²: products in mass matrices must not underflow to 0."""
HEAVIEST = 1e60
"""Largest mass and inertia, kg and kg m²: products in mass matrices, and energies, must be finite."""


class Model(BaseModel):
    """Base class of the tables of a scene file.

    Instances are immutable, and a key that is not declared is an error. The docstring below a field describes its key,
    also in the JSON schema.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield problems of keys that are valid by themselves, but not together.

        Yields
        ------
        tuple
            The key, relative to this table, the value found, and a text that says what was expected.
        """
        return iter(())

    def __dir__(self) -> Iterable[str]:
        """Return the names that completion offers: those of the scene's data, not those of pydantic."""
        return [
            name
            for name in super().__dir__()
            if name.startswith("_") or not hasattr(BaseModel, name)
        ]

    @model_validator(mode="after")
    def _check_consistency(self) -> Model:
        """Report all `inconsistencies` as one error, from which `errors.problems_of` makes problems."""
        problems = list(self.inconsistencies())
        if problems:
            raise PydanticCustomError("inconsistent", "inconsistent", {"found": problems})
        return self


class Part(Model):
    """Base class of the tables of a scene that can also be created in Python.

    ``Body(mass=2, inertia=0.1)`` accepts the keys of the table as keyword arguments, with the checks of a file. A
    number may be an arithmetic expression, but without the parameters of a scene. The first key of some tables,
    ``type`` or ``method``, names their class: it is required in a file, and can be omitted in Python.

    Raises
    ------
    SceneError
        If a value cannot be used. The message lists all problems.
    """

    if not TYPE_CHECKING:  # type checkers know the keys and types of the arguments from the fields

        def __init__(self, **values: Any) -> None:
            try:
                super().__init__(**values)
            except ValidationError as error:
                # `errors` describes the classes of a scene, which are derived from this one
                from stiction.scenes.errors import SceneError, problems_of

                kind = type(self)
                raise SceneError(kind.__name__, problems_of(error, kind)) from None

        # pydantic would call any other constructor for the tables within a table as well. It would then
        # report the first invalid one of them only, without its place in the file.
        __init__.__pydantic_base_init__ = True

    def declared(self) -> dict[str, Any]:
        """Return the values that were given, by key, and with them the key that names the class.

        Tables within the table remain objects.
        """
        return {
            key: getattr(self, key)
            for key in type(self).model_fields
            if key in self.model_fields_set or key in TAGS
        }


def _evaluate_number(value: Any, info: ValidationInfo) -> float:
    """Return a number of a file; the context of validation holds the parameters of the scene."""
    return evaluate(value, info.context or {})


def _check_direction(vector: tuple[float, float]) -> tuple[float, float]:
    """Refuse a vector whose length is zero, or has a square that is not a float."""
    if not SHORTEST_DIRECTION < math.hypot(*vector) < LONGEST_DIRECTION:
        raise InputError("expected a vector with a length")
    return vector


def _check_inertial(value: float) -> float:
    """Refuse a mass or an inertia outside of the limits."""
    if not LIGHTEST <= value <= HEAVIEST:
        raise InputError(f"expected {LIGHTEST:g} .. {HEAVIEST:g}")
    return value


def _number_schema(**limits: float) -> WithJsonSchema:
    """Return the schema of a number in a file, for editors.

    It is a number within its limits, or an arithmetic expression, which only the program can evaluate.
    """
    return WithJsonSchema({"anyOf": [{"type": "number", **limits}, {"type": "string"}]})


Number = Annotated[float, BeforeValidator(_evaluate_number), _number_schema()]
Positive = Annotated[Number, Field(gt=0), _number_schema(exclusiveMinimum=0)]
Inertial = Annotated[
    Positive, AfterValidator(_check_inertial), _number_schema(minimum=LIGHTEST, maximum=HEAVIEST)
]
NonNegative = Annotated[Number, Field(ge=0), _number_schema(minimum=0)]
Shape = Annotated[Number, Field(ge=1), _number_schema(minimum=1)]
Restitution = Annotated[Number, Field(ge=0, le=1), _number_schema(minimum=0, maximum=1)]
Vector = tuple[Number, Number]
Direction = Annotated[Vector, AfterValidator(_check_direction)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=60)]
