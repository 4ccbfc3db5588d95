"""Arrays and numbers that a kernel gets as one pointer.

numba passes an array as seven numbers or more, and a tuple of arrays as all numbers of all of them: a mechanism and its
workspace came to some 270, which every call passed on. A bundle is a block of words in memory: of an array its address
and its shape, of a number the number. In a kernel, `bundle.field` makes numba's own array of these words. It is
contiguous and borrowed: the `Bundle` in Python owns the memory, and no reference is counted.

A bundle's words never change. Their loads are marked as invariant, so that LLVM reads them once, before a loop,
whatever the loop stores.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Self, get_args, get_origin, get_type_hints

import numpy as np
from numba import from_dtype, types
from numba.extending import (
    NativeValue,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    unbox,
)

Reals = Annotated[np.ndarray, np.float64, 1]
Table = Annotated[np.ndarray, np.float64, 2]
Cube = Annotated[np.ndarray, np.float64, 3]
Integers = Annotated[np.ndarray, np.int64, 1]
IntegerTable = Annotated[np.ndarray, np.int64, 2]
Flags = Annotated[np.ndarray, np.bool_, 1]
"""Types of fields and of the arguments of kernels, besides numbers: a C-contiguous array, its type of numbers and its
dimensions."""
Bundles = tuple
"""Type of a field that has bundles of one class. In a kernel it is the array of their addresses, of which `at` makes
bundles."""

_NUMBERS = {int: types.int64, float: types.float64, bool: types.boolean, type(None): types.none}


class Record(np.ndarray):
    """Base of classes that name the fields, `int` or `float`, of an array without dimensions.

    A kernel reads and sets them as attributes: `bundle.record.field = ..`. In Python they are `record["field"]`.
    """

    @classmethod
    def structure(cls) -> np.dtype:
        """Type of the array."""
        return np.dtype([(name, np.dtype(kind)) for name, kind in get_type_hints(cls).items()])


def _array(hint: Any) -> tuple[np.dtype, int] | None:
    """Return type and number of dimensions of an array or a record, None for any other field."""
    if isinstance(hint, type) and issubclass(hint, Record):
        return hint.structure(), 0
    return (
        (np.dtype(get_args(hint)[1]), get_args(hint)[2]) if get_origin(hint) is Annotated else None
    )


class BundleType(types.Record):
    """The type of a subclass of `Bundle`: a record of words, whose fields have the numba types that they are read as.

    `fields` has these types, `places` the first word of each field, `words` their number; `arrays` the type and the
    number of dimensions of each array or record.
    """

    fields: dict[str, types.Type]  # type: ignore[assignment]  # those of numba's records have offsets as well

    def __init__(self, name: str, hints: dict[str, Any]):
        self.fields = {field: numba_type(hint) for field, hint in hints.items()}
        self.arrays = {
            field: array for field, hint in hints.items() if (array := _array(hint)) is not None
        }
        self.places: dict[str, int] = {}
        self.words = 0
        for field, kind in self.fields.items():
            self.places[field] = self.words
            self.words += 1 + (kind.ndim if isinstance(kind, types.Array) else 0)
        types.Type.__init__(self, name)

    def typeof(self, key: str) -> types.Type:
        """Return the type of a field: numba looks for attributes of records here."""
        return self.fields[key]

    def __repr__(self) -> str:
        return self.name


class Bundle:
    """Base of classes with fields of `int`, `float`, another bundle, or one of the array types above.

    It is made of values in the order of the fields, or by name; `address` is that of its words, valid as long as it is.

    Raises
    ------
    TypeError
        If a value is missing, unknown, or not what its field says: kernels take its memory for that.
    """

    _numba_type_: ClassVar[BundleType]

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        hints.pop("_numba_type_")
        cls._numba_type_ = BundleType(f"{cls.__module__}.{cls.__qualname__}", hints)

    def __init__(self, *values: Any, **named: Any) -> None:
        fields = self._numba_type_.fields
        named = dict(zip(fields, values), **named)
        if len(values) > len(fields) or named.keys() != fields.keys():
            raise TypeError(
                f"{type(self).__name__}: found {', '.join(named)}; expected {', '.join(fields)}"
            )
        words = np.zeros(self._numba_type_.words, dtype=np.int64)
        tables = [self._write(words, name, value) for name, value in named.items()]
        self.__dict__.update(named, _memory=(words, tables), address=words.ctypes.data)

    @classmethod
    def zeros(cls, **fields: Any) -> Self:
        """A bundle with new arrays, all zero: their shapes are given, numbers and bundles as they are."""
        arrays = cls._numba_type_.arrays
        made = {
            name: np.zeros(fields[name], dtype=dtype)
            for name, (dtype, _) in arrays.items()
            if name in fields
        }
        return cls(**{**fields, **made})

    def _write(self, words: np.ndarray, name: str, value: Any) -> np.ndarray | None:
        """Put a field's value into the words; returns the memory that they refer to and that the value does not own."""
        bundles = self._numba_type_
        place, kind = bundles.places[name], bundles.fields[name]
        if name in bundles.arrays:
            dtype, dimensions = bundles.arrays[name]
            is_array = isinstance(value, np.ndarray) and value.flags.carray
            if not is_array or (value.dtype, value.ndim) != (dtype, dimensions):
                found, shape = (
                    getattr(value, "dtype", type(value).__name__),
                    getattr(value, "shape", None),
                )
                raise TypeError(
                    f"{type(self).__name__}.{name}: found {found}, shape {shape}; expected a "
                    f"contiguous, writeable array of {dtype} with {dimensions} dimensions"
                )
            words[place : place + 1 + dimensions] = value.ctypes.data, *value.shape
        elif isinstance(value, Bundles):
            addresses = np.array([part.address for part in value], dtype=np.int64)
            words[place : place + 2] = addresses.ctypes.data, len(addresses)
            return addresses
        elif isinstance(kind, BundleType):
            if getattr(value, "_numba_type_", None) != kind:
                raise TypeError(
                    f"{type(self).__name__}.{name}: found {type(value).__name__}; "
                    f"expected a bundle {kind.name}"
                )
            words[place] = value.address
        else:
            words.view(np.float64 if kind == types.float64 else np.int64)[place] = value
        return None

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(
            f"{type(self).__name__}.{name}: a bundle is not changed; "
            "expected a new one, or a change of an array's values"
        )

    def __iter__(self) -> Iterator[Any]:
        return (getattr(self, name) for name in self._numba_type_.fields)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(self)

    def replaced(self, **changes: Any) -> Self:
        """A bundle of the same arrays, but for some."""
        return type(self)(**dict(zip(self._numba_type_.fields, self), **changes))


def numba_type(hint: Any) -> types.Type:
    """Return the type of an annotation: a number, a type of arrays, a class of bundles, or a tuple of these."""
    if hint in _NUMBERS:
        return _NUMBERS[hint]
    if hint is Bundles:
        return numba_type(Integers)
    if get_origin(hint) is tuple:
        return types.Tuple([numba_type(part) for part in get_args(hint)])
    if isinstance(hint, type) and issubclass(hint, Bundle):
        return hint._numba_type_
    if (array := _array(hint)) is None:
        raise TypeError(f"found {hint!r}; expected a type of arrays, a bundle or a number")
    dtype, dimensions = array
    item = from_dtype(dtype)
    return types.Array(item, dimensions, "C") if dimensions else item


register_model(BundleType)(models.OpaqueModel)


@unbox(BundleType)
def _unbox(kind, bundle, c):
    address = c.pyapi.object_getattr_string(bundle, "address")
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(pointer)


def _bundle_at(typing_context, address, like):
    def generate(context, builder, signature, values):
        return builder.inttoptr(values[0], context.get_value_type(like))

    return like(types.int64, like), generate


at: Any = intrinsic(_bundle_at)
"""In a kernel: the bundle at an address, of the class of another."""


@lower_getattr_generic(BundleType)
def _lower_field(context: Any, builder: Any, bundle: BundleType, pointer: Any, name: str) -> Any:
    """Load the words of `bundle.name`, and make a borrowed array of them where it is one."""
    kind, place = bundle.fields[name], bundle.places[name]

    def word(i: int, of: types.Type) -> Any:
        words = builder.bitcast(pointer, context.get_value_type(of).as_pointer())
        loaded = builder.load(builder.gep(words, [context.get_constant(types.intp, place + i)]))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if not isinstance(kind, types.Array):
        return word(0, kind)
    size = context.get_constant(
        types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype))
    )
    shape = [word(1 + i, types.intp) for i in range(kind.ndim)]
    strides, count = [size], shape[0]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length, flags=["nsw"]))
        count = builder.mul(count, length, flags=["nsw"])
    array, lengths = context.make_helper(builder, kind), types.UniTuple(types.intp, kind.ndim)
    array.data, array.nitems, array.itemsize = word(0, types.CPointer(kind.dtype)), count, size
    array.shape = context.make_tuple(builder, lengths, shape)
    array.strides = context.make_tuple(builder, lengths, strides)
    return array._getvalue()
