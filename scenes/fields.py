"""Field types shared by the scene's elements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from stiction.scenes.base_errors import InputError
from stiction.scenes.expressions import evaluate

GROUND = "ground"


class Model(BaseModel):
    """Frozen data; a key that is not declared is an error. The text below a key describes it, in its schema too."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    def inconsistencies(self) -> Iterator[tuple[str, Any, str]]:
        """Yield problems of fields that are right by themselves: key, value found, what was expected."""
        return iter(())

    def __dir__(self) -> Iterable[str]:
        """The names of a scene's data, without those of every pydantic model: what completion offers."""
        return [
            name
            for name in super().__dir__()
            if name.startswith("_") or not hasattr(BaseModel, name)
        ]

    @model_validator(mode="after")
    def _consistent(self) -> Model:
        problems = list(self.inconsistencies())
        if problems:
            raise PydanticCustomError("inconsistent", "inconsistent", {"found": problems})
        return self


def _number(value: Any, info: ValidationInfo) -> float:
    return evaluate(value, info.context or {})


def _direction(vector: tuple[float, float]) -> tuple[float, float]:
    if not 1e-100 < math.hypot(*vector) < 1e100:  # the square of its length must be a float too
        raise InputError("expected a vector with a length")
    return vector


LIGHTEST, HEAVIEST = 1e-60, 1e60
"""Limits of masses and inertias, kg and kg m²: products of mass matrices, and energies, must be floats too."""


def _weighty(value: float) -> float:
    if not LIGHTEST <= value <= HEAVIEST:
        raise InputError(f"expected {LIGHTEST:g} .. {HEAVIEST:g}")
    return value


def _number_in_a_file(**limits: float) -> WithJsonSchema:
    """Schema of a number for editors: within its limits, or arithmetic, which only the program can evaluate."""
    return WithJsonSchema({"anyOf": [{"type": "number", **limits}, {"type": "string"}]})


Number = Annotated[float, BeforeValidator(_number), _number_in_a_file()]
Positive = Annotated[Number, Field(gt=0), _number_in_a_file(exclusiveMinimum=0)]
Inertial = Annotated[
    Positive, AfterValidator(_weighty), _number_in_a_file(minimum=LIGHTEST, maximum=HEAVIEST)
]
NonNegative = Annotated[Number, Field(ge=0), _number_in_a_file(minimum=0)]
Vector = tuple[Number, Number]
Direction = Annotated[Vector, AfterValidator(_direction)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=60)]
