"""Arrays and numbers that a kernel gets as one pointer.

numba passes an array as seven numbers or more, and a tuple of arrays as all numbers of all of them: a mechanism and its workspace came to
some 270, which every call passed on. A bundle is a block of words in memory: of an array its address and its shape, of a number
the number. In a kernel, `bundle.field` makes numba's own array of these words. It is contiguous and borrowed: the `Bundle` in Python owns
the memory, and no reference is counted.

A bundle's words never change. Their loads are marked as invariant, so that LLVM reads them once, before a loop, whatever the loop stores.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from ctypes import addressof, c_char
from functools import lru_cache
from math import prod
from struct import pack, unpack
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, intrinsic, lower_getattr_generic, models, register_model, unbox
from numba.np.arrayobj import make_array, populate_array

Reals = Annotated[np.ndarray, np.float64, 1]
Table = Annotated[np.ndarray, np.float64, 2]
Cube = Annotated[np.ndarray, np.float64, 3]
Integers = Annotated[np.ndarray, np.int64, 1]
IntegerTable = Annotated[np.ndarray, np.int64, 2]
Flags = Annotated[np.ndarray, np.bool_, 1]
"""Types of fields and of the arguments of kernels, beside numbers: a C-contiguous array, its type of numbers and how many dimensions it has.
A field of a structured type and no dimensions is one record, whose own fields a kernel may set: `bundle.record.field = ..`."""
Bundles = tuple
"""Type of a field that has bundles of one class. In a kernel it is the array of their addresses, of which `at` makes bundles."""

WORD = 8


class BundleType(types.Type):
    """The type of a subclass of `Bundle`: a name, and the numba type of each field.

    Attributes
    ----------
    places : dict of str to int
        Of the first word of each field.
    words : int
        In all.
    arrays : dict of str to (numpy.dtype, int)
        Of each array or record, what is in it and how many dimensions it has.
    """

    def __init__(self, name: str, hints: dict[str, Any]):
        self.fields = {field: numba_type(hint) for field, hint in hints.items()}
        self.arrays = {field: (np.dtype(get_args(hint)[1]), get_args(hint)[2]) for field, hint in hints.items() if get_origin(hint) is Annotated}
        self.places, self.words = {}, 0
        for field, kind in self.fields.items():
            self.places[field] = self.words
            self.words += 1 + (kind.ndim if isinstance(kind, types.Array) else 0)
        super().__init__(name)


class Bundle:
    """Base of classes whose annotations are `int`, `float`, another class of bundles, or one of the types of arrays above.

    Parameters
    ----------
    Values in the order of the fields, or by name.

    Attributes
    ----------
    address : int
        Of its words, for `pointer_to`: valid as long as the bundle is.

    Raises
    ------
    TypeError
        If a value is missing, unknown, or not what its field says: kernels take its memory for that.
    """

    _numba_type_: ClassVar[BundleType]

    def __init_subclass__(cls) -> None:
        hints = {name: hint for name, hint in get_type_hints(cls, include_extras=True).items() if not name.startswith("_")}
        cls._numba_type_ = BundleType(f"{cls.__module__}.{cls.__qualname__}", hints)

    def __init__(self, *values: Any, **named: Any) -> None:
        fields = self._numba_type_.fields
        named = dict(zip(fields, values), **named)
        if len(values) > len(fields) or named.keys() != fields.keys():
            raise TypeError(f"{type(self).__name__}: found {', '.join(named)}; expected {', '.join(fields)}")
        self._hold(named, {}, [0] * self._numba_type_.words)

    @classmethod
    def zeros(cls, **fields: Any) -> Self:
        """A bundle with new arrays that lie beside each other, all zero: to look for the memory of each takes longer than to make it.

        Python makes an array of its part of the memory when it is first asked for: most are for kernels alone.

        Parameters
        ----------
        Numbers and bundles as they are, of arrays and records their shapes, by name.
        """
        bundles = cls._numba_type_
        if fields.keys() != bundles.fields.keys():
            raise TypeError(f"{cls.__name__}: found {', '.join(fields)}; expected {', '.join(bundles.fields)}")
        layout = _layout(bundles, tuple([fields.pop(name) for name in bundles.arrays]))
        memory, words = np.zeros(layout.size, dtype=np.int64), layout.words.copy()
        start = _address(memory)
        for place in layout.addresses:
            words[place] += start
        made = object.__new__(cls)
        made._hold(fields, {"_memory": memory, "_layout": layout}, words)
        return made

    def __getattr__(self, name: str) -> np.ndarray:
        """An array of `zeros` that has not been asked for."""
        layout = self.__dict__.get("_layout")
        if layout is None or name not in layout.parts:
            raise AttributeError(f"{type(self).__name__} has no {name}")
        shape, dtype, offset = layout.parts[name]
        array = self.__dict__[name] = np.ndarray(shape, dtype, self._memory, offset)
        return array

    def _hold(self, values: Mapping[str, Any], own: dict[str, Any], words: list[int]) -> None:
        """Have these values of fields beside what it has, and has words of, already."""
        bundles = self._numba_type_
        for name, value in values.items():
            place, kind = bundles.places[name], bundles.fields[name]
            if name in bundles.arrays:
                dtype, dimensions = bundles.arrays[name]
                if not isinstance(value, np.ndarray) or (value.dtype is not dtype and value.dtype != dtype) or value.ndim != dimensions or not value.flags.carray:
                    raise TypeError(f"{type(self).__name__}.{name}: found {getattr(value, 'dtype', type(value).__name__)}, shape "
                                    f"{getattr(value, 'shape', None)}; expected a contiguous, writeable array of {dtype} with {dimensions} dimensions")
                words[place] = _address(value)
                if dimensions:
                    words[place + 1:place + 1 + dimensions] = value.shape
            elif isinstance(value, Bundles):
                parts = own[f"_{name}"] = np.array([part.address for part in value], dtype=np.int64)  # kept, as kernels use its memory
                words[place:place + 2] = _address(parts), len(parts)
            elif isinstance(kind, BundleType):
                if getattr(value, "_numba_type_", None) != kind:
                    raise TypeError(f"{type(self).__name__}.{name}: found {type(value).__name__}; expected a bundle {kind.name}")
                words[place] = value.address
            else:
                words[place] = _float_as_word(value) if kind == types.float64 else int(value)
        block = np.array(words, dtype=np.int64)
        self.__dict__.update(own, **values, _block=block, address=_address(block))

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__}.{name}: a bundle is not changed; expected a new one, or a change of an array's values")

    def __iter__(self) -> Iterator[Any]:
        return (getattr(self, name) for name in self._numba_type_.fields)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(self)

    def replaced(self, **changes: Any) -> Self:
        """A bundle of the same arrays, but for some."""
        if unknown := changes.keys() - self._numba_type_.fields.keys():
            raise TypeError(f"{type(self).__name__}: found {', '.join(unknown)}; expected {', '.join(self._numba_type_.fields)}")
        made = object.__new__(type(self))
        made._hold(changes, dict(self.__dict__), self._block.tolist())
        return made


def _address(array: np.ndarray) -> int:
    """Of an array's memory, if it has any; numpy's own `ctypes.data` takes three times as long."""
    return addressof(c_char.from_buffer(array)) if array.nbytes else 0


_NUMBERS = {int: types.int64, float: types.float64, bool: types.boolean, type(None): types.none}


def numba_type(hint: Any) -> types.Type:
    """Of an annotation: a number, a type of arrays, a class of bundles, or a tuple of these."""
    if hint in _NUMBERS:
        return _NUMBERS[hint]
    if hint is Bundles:
        return numba_type(Integers)
    if get_origin(hint) is tuple:
        return types.Tuple([numba_type(part) for part in get_args(hint)])
    if isinstance(hint, type) and issubclass(hint, Bundle):
        return hint._numba_type_
    _, dtype, dimensions = get_args(hint)
    item = from_dtype(np.dtype(dtype))
    return types.Array(item, dimensions, "C") if dimensions else item


def _float_as_word(value: float) -> int:
    return unpack("=q", pack("=d", value))[0]


class _Layout(NamedTuple):
    """Arrays that lie beside each other: words of memory; shape, type, offset of each by name; the bundle's words, addresses counted from the memory's, and their places."""

    size: int
    parts: dict[str, tuple[tuple[int, ...], np.dtype, int]]
    words: list[int]
    addresses: list[int]


@lru_cache(maxsize=64)
def _layout(bundles: BundleType, given: tuple[int | tuple[int, ...], ...]) -> _Layout:
    """Of all arrays of a bundle in these shapes; runs of the same mechanism ask for the same again and again."""
    parts, words, size = {}, [0] * bundles.words, 0
    for (name, (dtype, dimensions)), shape in zip(bundles.arrays.items(), given):
        shape, place = (shape,) if isinstance(shape, int) else shape, bundles.places[name]
        parts[name] = shape, dtype, WORD * size
        words[place] = WORD * size
        words[place + 1:place + 1 + dimensions] = shape
        size += -(-dtype.itemsize * prod(shape) // WORD)
    return _Layout(size, parts, words, [bundles.places[name] for name in bundles.arrays])


@register_model(BundleType)
class _Pointer(models.OpaqueModel):
    pass


@unbox(BundleType)
def _unbox(kind, bundle, c):
    address = c.pyapi.object_getattr_string(bundle, "address")
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(pointer)


@infer_getattr
class _Fields(AttributeTemplate):
    key = BundleType

    def generic_resolve(self, bundle: BundleType, name: str) -> types.Type | None:
        return bundle.fields.get(name)


@intrinsic
def at(typing_context, address, like):
    """The bundle at an address, of the class of another."""

    def generate(context, builder, signature, values):
        return builder.inttoptr(values[0], context.get_value_type(like))

    return like(types.int64, like), generate


def pointer_to(bundles: type[Bundle]) -> Any:
    """A function for kernels that makes a bundle of its address, an integer.

    numba takes half a microsecond to find out the type of a bundle that Python gives to a kernel, and a tenth of that for an integer: this
    is for kernels that are called at each step of something fast.
    """
    kind = bundles._numba_type_

    @intrinsic
    def bundle_at(typing_context, address):
        return kind(types.int64), lambda context, builder, signature, values: builder.inttoptr(values[0], context.get_value_type(kind))

    return bundle_at


@lower_getattr_generic(BundleType)
def field_of(context, builder, bundle, pointer, name):
    """Lower `bundle.name`."""
    kind, place = bundle.fields[name], bundle.places[name]

    def word(i: int, of: types.Type) -> ir.Value:
        value = context.get_value_type(of)
        loaded = builder.load(cgutils.gep(builder, builder.bitcast(pointer, value.as_pointer()), place + i))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if not isinstance(kind, types.Array):
        return word(0, kind)
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    shape = [word(1 + i, types.intp) for i in range(kind.ndim)]
    strides = [context.get_constant(types.intp, item)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length, flags=["nsw"]))
    array = make_array(kind)(context, builder)
    populate_array(array, data=word(0, types.CPointer(kind.dtype)), shape=shape, strides=strides, itemsize=item, meminfo=None)
    return array._getvalue()
