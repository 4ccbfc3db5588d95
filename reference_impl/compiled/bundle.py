"""Bundles: arrays and numbers that are passed to a kernel as one pointer.

numba passes an array as seven numbers or more, and a tuple of arrays as the numbers of all of them. For a mechanism and
its workspace these were about 270 numbers in each call. A bundle is a block of words in memory, which contains the
address and the shape of each array, and the value of each number. In a kernel, `bundle.field` makes a contiguous array
of numba from these words. The array is borrowed: the `Bundle` in Python owns the memory, and references are not
counted.

The words of a bundle never change. Loads of them are marked as invariant, so that LLVM can move them out of loops
regardless of what the loops store.
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
"""Types of fields of bundles, and of arguments of kernels: C-contiguous arrays with a type of elements and a number of
dimensions."""
Bundles = tuple
"""Type of a field that contains several bundles of one class. In a kernel, the field is the array of their addresses,
and `at` converts an address to a bundle."""

_NUMBERS = {int: types.int64, float: types.float64, bool: types.boolean, type(None): types.none}


class Record(np.ndarray):
    """Base class of structured arrays without dimensions; subclasses declare fields of type `int` or `float`.

    A kernel can change the fields: `bundle.record.field = ..`. In Python they are `record["field"]`.
    """

    @classmethod
    def structure(cls) -> np.dtype:
        """Return the structured type of the array."""
        return np.dtype([(name, np.dtype(kind)) for name, kind in get_type_hints(cls).items()])


def _array_of(hint: Any) -> tuple[np.dtype, int] | None:
    """Return the type of the elements and the number of dimensions of an array or a record; None for other types."""
    if isinstance(hint, type) and issubclass(hint, Record):
        return hint.structure(), 0
    if get_origin(hint) is Annotated:
        _, element_type, dimensions = get_args(hint)
        return np.dtype(element_type), dimensions
    return None


class BundleType(types.Record):
    """Numba's type of a subclass of `Bundle`.

    Parameters
    ----------
    name : str
        The full name of the subclass.
    hints : dict
        The annotations of its fields.

    Attributes
    ----------
    fields : dict
        Numba's type of each field.
    arrays : dict
        Type of the elements and number of dimensions of each field that is an array or a record.
    places : dict
        Index of the first word of each field. A number, a record or a bundle has one word, and an array one more for
        each dimension.
    words : int
        Number of words.
    """

    fields: dict[str, types.Type]  # type: ignore[assignment]  # those of numba's records have offsets as well

    def __init__(self, name: str, hints: dict[str, Any]):
        self.fields = {}
        self.arrays: dict[str, tuple[np.dtype, int]] = {}
        self.places: dict[str, int] = {}
        self.words = 0
        for field, hint in hints.items():
            kind = numba_type(hint)
            self.fields[field] = kind
            array = _array_of(hint)
            if array is not None:
                self.arrays[field] = array
            self.places[field] = self.words
            self.words += 1 + (kind.ndim if isinstance(kind, types.Array) else 0)
        # The constructor of numba's records expects fields with offsets; that of all types suffices.
        types.Type.__init__(self, name)

    def typeof(self, key: str) -> types.Type:
        """Return the type of a field, by which numba compiles access to attributes of records."""
        return self.fields[key]

    def __repr__(self) -> str:
        return self.name


class Bundle:
    """Base class of bundles. Subclasses declare fields of type `int`, `float`, another bundle, or an array type above.

    Parameters
    ----------
    *values, **named
        Values of all fields, in their order or by name.

    Attributes
    ----------
    address : int
        Address of the words, valid as long as this object exists.

    Raises
    ------
    TypeError
        If a value is missing, or does not have the type of its field. Kernels do not check it: they would misread the
        memory.
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
        address_tables = [self._write(words, name, value) for name, value in named.items()]
        # Attributes cannot be set, see __setattr__. `_memory` keeps the memory of the words alive.
        self.__dict__.update(named, _memory=(words, address_tables), address=words.ctypes.data)

    @classmethod
    def zeros(cls, **fields: Any) -> Self:
        """Return a bundle with new arrays of zeros.

        Parameters
        ----------
        **fields
            The shape of each field that is an array; the value of any other field.
        """
        arrays = {
            name: np.zeros(fields[name], dtype=dtype)
            for name, (dtype, _) in cls._numba_type_.arrays.items()
            if name in fields
        }
        return cls(**{**fields, **arrays})

    def _write(self, words: np.ndarray, name: str, value: Any) -> np.ndarray | None:
        """Write the value of a field to the words.

        Returns
        -------
        ndarray or None
            The table of addresses of a field that contains several bundles. The words refer to it, and nothing else
            owns it.
        """
        bundle_type = self._numba_type_
        place, kind = bundle_type.places[name], bundle_type.fields[name]
        if name in bundle_type.arrays:
            dtype, dimensions = bundle_type.arrays[name]
            is_array = isinstance(value, np.ndarray) and value.flags.carray
            if not is_array or (value.dtype, value.ndim) != (dtype, dimensions):
                found = getattr(value, "dtype", type(value).__name__)
                shape = getattr(value, "shape", None)
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
        elif kind == types.float64:
            # The bits of the number are stored in the word.
            words.view(np.float64)[place] = value
        else:
            words[place] = value
        return None

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(
            f"{type(self).__name__}.{name}: a bundle is not changed; "
            "expected a new one, or a change of an array's values"
        )

    def __iter__(self) -> Iterator[Any]:
        """Yield the values in the order of the fields."""
        return (getattr(self, name) for name in self._numba_type_.fields)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the values; addresses are valid in one process only."""
        return type(self), tuple(self)

    def replaced(self, **changes: Any) -> Self:
        """Return a bundle with other values of some fields; arrays of all other fields are shared."""
        return type(self)(**dict(zip(self._numba_type_.fields, self), **changes))


def numba_type(hint: Any) -> types.Type:
    """Return numba's type for an annotation: a number, an array type, a class of bundles, or a tuple of these."""
    if hint in _NUMBERS:
        return _NUMBERS[hint]
    if hint is Bundles:
        return numba_type(Integers)
    if get_origin(hint) is tuple:
        return types.Tuple([numba_type(part) for part in get_args(hint)])
    if isinstance(hint, type) and issubclass(hint, Bundle):
        return hint._numba_type_
    array = _array_of(hint)
    if array is None:
        raise TypeError(f"found {hint!r}; expected a type of arrays, a bundle or a number")
    dtype, dimensions = array
    element_type = from_dtype(dtype)
    return types.Array(element_type, dimensions, "C") if dimensions else element_type


register_model(BundleType)(models.OpaqueModel)


@unbox(BundleType)
def _unbox(kind, bundle, c):
    """Generate the code by which a call from Python converts a bundle to the pointer to its words."""
    address = c.pyapi.object_getattr_string(bundle, "address")
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(pointer)


def _bundle_at(typing_context, address, like):
    """Return the signature of `at`, and the function that generates its code."""

    def generate(context, builder, signature, values):
        return builder.inttoptr(values[0], context.get_value_type(like))

    return like(types.int64, like), generate


at: Any = intrinsic(_bundle_at)
"""In a kernel, ``at(address, like)`` returns the bundle at an address, whose class is that of the bundle `like`."""


@lower_getattr_generic(BundleType)
def _lower_field(context: Any, builder: Any, bundle: BundleType, pointer: Any, name: str) -> Any:
    """Generate the code of `bundle.name`: load the words of the field, and make an array of them if it is one."""
    kind, place = bundle.fields[name], bundle.places[name]

    def load_word(i: int, word_type: types.Type) -> Any:
        words = builder.bitcast(pointer, context.get_value_type(word_type).as_pointer())
        index = context.get_constant(types.intp, place + i)
        word = builder.load(builder.gep(words, [index]))
        word.set_metadata("invariant.load", builder.module.add_metadata([]))
        return word

    if not isinstance(kind, types.Array):
        return load_word(0, kind)
    # Strides, in bytes, and the number of elements follow from the shape, since arrays are contiguous.
    size_bytes = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    size = context.get_constant(types.intp, size_bytes)
    shape = [load_word(1 + i, types.intp) for i in range(kind.ndim)]
    strides = [size]
    count = shape[0]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length, flags=["nsw"]))
        count = builder.mul(count, length, flags=["nsw"])
    lengths = types.UniTuple(types.intp, kind.ndim)
    array = context.make_helper(builder, kind)
    array.data = load_word(0, types.CPointer(kind.dtype))
    array.nitems = count
    array.itemsize = size
    array.shape = context.make_tuple(builder, lengths, shape)
    array.strides = context.make_tuple(builder, lengths, strides)
    return array._getvalue()
