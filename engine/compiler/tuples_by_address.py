"""Named tuples of arrays that kernels pass on by address.

Numba passes a tuple of arrays by value: at least seven numbers per array, which are unpacked and packed again at each
call. The 150 arrays of a run made up most of the code of all kernels in this way. A tuple declared here is a single
address: that of a table of array descriptions, which is filled once, when Python calls the kernel.

In kernels only the fields of such a tuple can be accessed: it is neither created nor unpacked there. Without
compilation (NUMBA_DISABLE_JIT) it is the plain Python tuple.
"""

import hashlib
from typing import Any, TypeVar

import engine.jit  # noqa: F401  # isort: skip  # imports Numba in the required way
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

T = TypeVar("T", bound=type)

WORD = 8  # bytes
BYTE, ADDRESS = ir.IntType(8), ir.IntType(8).as_pointer()
INDEX = ir.IntType(64)
# Numba's description of an array: two words for its owner, the number of items, the size of an item in bytes, their
# address; shape and strides have one word per axis
ITEMS, ITEM_SIZE, DATA, SHAPE, STRIDES = 2, 3, 4, 5, 6


class TupleByAddress(types.Type):
    """The Numba type of a declared tuple."""

    def __init__(self, name: str, fields: dict[str, Any]) -> None:
        digest = hashlib.sha256(repr(list(fields.items())).encode()).hexdigest()[:16]
        super().__init__(name=f"{name}_{digest}")  # part of the name of each kernel that takes such a tuple
        self.fields = fields
        self.first: dict[str, int] = {}  # the first word of each field in the table
        self.words = 0
        for field, kind in fields.items():
            self.first[field] = self.words
            self.words += _words(kind)


def _words(kind: Any) -> int:
    """Return the number of words of the table that a field takes."""
    if isinstance(kind, TupleByAddress):
        return kind.words
    return SHAPE + 2 * kind.ndim if isinstance(kind, types.Array) else 1


def by_address(named_tuple: T) -> T:
    """Make kernels pass on tuples of this class by address; a class decorator.

    The fields may be arrays, floats, integers, truth values and other tuples declared in this way.
    """

    @typeof_impl.register(named_tuple)
    def _typeof(value: Any, context: Any) -> TupleByAddress:
        kinds = (typeof_impl(field, context) for field in value)
        return TupleByAddress(named_tuple.__name__, dict(zip(value._fields, kinds, strict=True)))

    return named_tuple


@register_model(TupleByAddress)
class TupleByAddressModel(models.PrimitiveModel):  # type: ignore[misc]
    """The address of the table."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ADDRESS)  # type: ignore[no-untyped-call]


@infer_getattr
class TupleByAddressFields(AttributeTemplate):  # type: ignore[misc]
    """The types of the fields."""

    key = TupleByAddress

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        """Return the type of a field; None if there is no field of that name."""
        return kind.fields.get(name)


@lower_getattr_generic(TupleByAddress)  # type: ignore[no-untyped-call]
def _lower_field(context: Any, builder: Any, kind: Any, address: Any, name: str) -> Any:
    field, first = kind.fields[name], kind.first[name]
    if isinstance(field, TupleByAddress):
        return _at(builder, address, first)
    if isinstance(field, types.Array):
        return _read_array(context, builder, field, address, first)
    number = _read(builder, address, first, context.get_data_type(field))
    return context.data_model_manager[field].from_data(builder, number)


def _at(builder: Any, address: Any, word: int) -> Any:
    """Return the address of a word of the table."""
    return builder.gep(address, [INDEX(WORD * word)], source_etype=BYTE) if word else address


def _read(builder: Any, address: Any, word: int, kind: Any) -> Any:
    """Return a word of the table as a value of an LLVM type."""
    # not marked as invariant, because LLVM would read the table before it is filled where a kernel is inlined
    return builder.load(builder.bitcast(_at(builder, address, word), kind.as_pointer()), align=WORD)


def _read_array(context: Any, builder: Any, kind: Any, address: Any, first: int) -> Any:
    """Return Numba's description of an array; values known from its type are not read."""
    array = context.get_value_type(kind)
    item_size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    known = [ir.Constant(element, item_size if place == ITEM_SIZE else None) for place, element in enumerate(array)]
    value = ir.Constant(array, known)
    value = builder.insert_value(value, _read(builder, address, first + ITEMS, INDEX), ITEMS)
    value = builder.insert_value(value, _read(builder, address, first + DATA, array.elements[DATA]), DATA)
    for axis in range(kind.ndim):
        length, stride = first + SHAPE + axis, first + SHAPE + kind.ndim + axis
        value = builder.insert_value(value, _read(builder, address, length, INDEX), [SHAPE, axis])
        packed = kind.layout == "C" and axis == kind.ndim - 1
        distance = INDEX(item_size) if packed else _read(builder, address, stride, INDEX)
        value = builder.insert_value(value, distance, [STRIDES, axis])
    return value


@unbox(TupleByAddress)  # type: ignore[no-untyped-call]
def _unbox(kind: Any, given: Any, c: Any) -> NativeValue:
    """Fill the table of a tuple that Python passes to a kernel."""
    room = cgutils.alloca_once(c.builder, INDEX, size=kind.words)  # type: ignore[no-untyped-call]
    table = c.builder.bitcast(room, ADDRESS)
    failed = _fill(kind, given, table, c)
    return NativeValue(table, is_error=failed)  # type: ignore[no-untyped-call]


def _fill(kind: Any, given: Any, table: Any, c: Any) -> Any:
    """Write the words of a tuple; return the generated flag for failure, in which case a Python exception is set."""
    failed = cgutils.false_bit
    for number, (name, field) in enumerate(kind.fields.items()):
        item, place = c.pyapi.tuple_getitem(given, number), _at(c.builder, table, kind.first[name])
        if isinstance(field, TupleByAddress):
            failed = c.builder.or_(failed, _fill(field, item, place, c))
        elif isinstance(field, types.Array):
            c.pyapi.numba_array_adaptor(item, place)  # cannot fail: the type was taken from this very array
        else:
            native = c.unbox(field, item)
            data = c.context.data_model_manager[field].as_data(c.builder, native.value)
            c.builder.store(data, c.builder.bitcast(place, data.type.as_pointer()))
            failed = c.builder.or_(failed, native.is_error)
    return failed
