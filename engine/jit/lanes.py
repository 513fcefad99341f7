"""Eight numbers at a time: a vector register of the processor as a value of compiled kernels.

The same formula for eight contacts, or for a row of a 6 x 6 block padded with two zeros, costs hardly more than for one
number. Compilers rarely vectorise such code by themselves, because two arrays may overlap; here the kernel states it.
Every operation rounds as for single numbers, so results do not depend on the width of the processor's registers.

Without compilation (NUMBA_DISABLE_JIT) the eight numbers are a NumPy array with the same operators.
"""

import inspect
import operator
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, models, register_model, type_callable

from engine.arrays import Array
from engine.jit.numba_internals import converted, data_of, declared, nothing

LANES = 8
DOUBLE = ir.DoubleType()
INDEX = ir.IntType(32)


class LanesType(types.Type):
    """The Numba type of eight numbers."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


class ChoiceType(types.Type):
    """The Numba type of eight truth values."""

    def __init__(self) -> None:
        super().__init__(name="Choice")


lanes, choice = LanesType(), ChoiceType()


@register_model(LanesType)
class LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    """Eight doubles in a register."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, LANES))


@register_model(ChoiceType)
class ChoiceModel(models.PrimitiveModel):  # type: ignore[misc]
    """Eight bits in a register."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), LANES))


def read(a: Array, at: int) -> Array:
    """Return the eight numbers of a contiguous array from index ``at`` on."""
    return a[at : at + LANES].copy()


def write(numbers: Array, a: Array, at: int) -> None:
    """Write eight numbers to a contiguous array from index ``at`` on."""
    a[at : at + LANES] = numbers


def spread(x: float) -> Array:
    """Return a number repeated eight times."""
    return np.full(LANES, float(x))


def total(numbers: Array) -> float:
    """Return the sum of eight numbers, by adding the two halves, then the halves of the result, and so on."""
    while numbers.size > 1:
        numbers = numbers[: numbers.size // 2] + numbers[numbers.size // 2 :]
    return float(numbers[0])


def least(numbers: Array) -> float:
    """Return the smallest of eight numbers."""
    while numbers.size > 1:
        low, high = numbers[: numbers.size // 2], numbers[numbers.size // 2 :]
        numbers = np.where(low < high, low, high)
    return float(numbers[0])


def fused(a: Array, b: Array, c: Array) -> Array:
    """Return a b + c; if compiled, rounded once, by the processor or, without such an instruction, by a library."""
    return a * b + c


def root(numbers: Array) -> Array:
    """Return the square roots of eight numbers."""
    return np.sqrt(numbers)


def larger(a: Array, b: Array) -> Array:
    """Return the larger number of each pair; b where either is NaN."""
    return np.where(a > b, a, b)


def choose(condition: Array, a: Array, b: Array) -> Array:
    """Return the numbers of ``a`` where the condition holds and those of ``b`` elsewhere."""
    return np.where(condition, a, b)


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    """Return the address of eight consecutive numbers in an array."""
    data = data_of(context, builder, kind, array)
    return builder.bitcast(builder.gep(data, [at]), ir.VectorType(DOUBLE, LANES).as_pointer())


def _spread(builder: Any, number: Any) -> Any:
    """Return a number repeated in all lanes."""
    one = builder.insert_element(ir.Constant(ir.VectorType(DOUBLE, LANES), ir.Undefined), number, INDEX(0))
    zeros = ir.Constant(ir.VectorType(INDEX, LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(one.type, ir.Undefined), zeros)


def _is_row(kind: Any) -> bool:
    """Return whether a type is a contiguous one-dimensional array."""
    return isinstance(kind, types.Array) and kind.ndim == 1 and kind.layout == "C" and kind.dtype == types.float64


def _call(builder: Any, name: str, operands: Any) -> Any:
    """Call an LLVM intrinsic whose operands and result are vectors."""
    kind = ir.FunctionType(operands[0].type, [x.type for x in operands])
    return builder.call(declared(builder, name, kind), operands)


def _operands(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
    """Return operands as vectors; single numbers are repeated in all lanes."""
    return [
        x if kind in (lanes, choice) else _spread(builder, converted(context, builder, x, kind, types.float64))
        for x, kind in zip(arguments, signature.args, strict=True)
    ]


def _are_numbers(*kinds: Any) -> bool:
    """Return whether each operand is eight numbers or a single one, and at least one is eight numbers."""
    return lanes in kinds and all(kind == lanes or isinstance(kind, types.Number) for kind in kinds)


def _declare(function: Any, result: Any, accepts: Callable[..., bool], kinds: Any, build: Any) -> None:
    """Let kernels call a function with arguments of these kinds, if it accepts them; `build` generates its code."""

    def result_of(*arguments: Any) -> Any:
        return result if accepts(*arguments) else None

    result_of.__signature__ = inspect.signature(function)  # type: ignore[attr-defined]  # by which Numba binds arguments

    @type_callable(function)
    def _type(context: Any) -> Any:
        return result_of

    for each in kinds:
        lower_builtin(function, *each)(build)


def _declare_operation(function: Any, result: Any, build: Any, count: int = 2) -> None:
    """Let kernels apply a function to operands of which each is eight numbers, or a single one, but not all single."""

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return build(builder, *_operands(context, builder, signature, arguments))

    kinds = [each for each in product((LanesType, types.Number), repeat=count) if LanesType in each]
    _declare(function, result, _are_numbers, kinds, lower)


def _declare_fold(function: Any, build: Any) -> None:
    """Let kernels reduce eight numbers: the two halves with each other, then the halves of the result, and so on."""

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        numbers, left = arguments[0], LANES
        while left > 1:
            left //= 2
            places = [ir.Constant(ir.VectorType(INDEX, left), list(range(at, at + left))) for at in (0, left)]
            numbers = build(builder, *(builder.shuffle_vector(numbers, numbers, place) for place in places))
        return builder.extract_element(numbers, INDEX(0))

    _declare(function, types.float64, lambda numbers: numbers == lanes, [(LanesType,)], lower)


def _lower_read(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    at = converted(context, builder, arguments[1], signature.args[1], types.intp)
    numbers = builder.load(_address(context, builder, signature.args[0], arguments[0], at))
    numbers.align = 8
    return numbers


def _lower_write(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    at = converted(context, builder, arguments[2], signature.args[2], types.intp)
    builder.store(arguments[0], _address(context, builder, signature.args[1], arguments[1], at), align=8)
    return nothing(context)


def _lower_spread(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return _operands(context, builder, signature, arguments)[0]


def _lower_choose(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.select(*_operands(context, builder, signature, arguments))


_declare(read, lanes, lambda a, at: _is_row(a), [(types.Array, types.Integer)], _lower_read)
_declare(
    write,
    types.none,
    lambda numbers, a, at: numbers == lanes and _is_row(a),
    [(LanesType, types.Array, types.Integer)],
    _lower_write,
)
_declare(
    spread,
    lanes,
    lambda x: isinstance(x, (types.Float, types.Integer)),
    [(types.Float,), (types.Integer,)],
    _lower_spread,
)
_declare(
    choose,
    lanes,
    lambda condition, a, b: condition == choice and _are_numbers(lanes, a, b),
    [(ChoiceType, *each) for each in product((LanesType, types.Number), repeat=2)],
    _lower_choose,
)
_declare(
    operator.and_,
    choice,
    lambda a, b: a == choice and b == choice,
    [(ChoiceType, ChoiceType)],
    lambda context, builder, signature, arguments: builder.and_(*arguments),
)
_declare_fold(total, lambda builder, a, b: builder.fadd(a, b))
_declare_fold(least, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))
_declare_operation(root, lanes, lambda builder, a: _call(builder, "llvm.sqrt.v8f64", [a]), 1)
_declare_operation(operator.neg, lanes, lambda builder, a: builder.fneg(a), 1)
_declare_operation(fused, lanes, lambda builder, a, b, c: _call(builder, "llvm.fma.v8f64", [a, b, c]), 3)
_declare_operation(operator.add, lanes, lambda builder, a, b: builder.fadd(a, b))
_declare_operation(operator.iadd, lanes, lambda builder, a, b: builder.fadd(a, b))
_declare_operation(operator.sub, lanes, lambda builder, a, b: builder.fsub(a, b))
_declare_operation(operator.isub, lanes, lambda builder, a, b: builder.fsub(a, b))
_declare_operation(operator.mul, lanes, lambda builder, a, b: builder.fmul(a, b))
_declare_operation(operator.imul, lanes, lambda builder, a, b: builder.fmul(a, b))
_declare_operation(operator.truediv, lanes, lambda builder, a, b: builder.fdiv(a, b))
_declare_operation(operator.lt, choice, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_declare_operation(operator.le, choice, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_declare_operation(operator.gt, choice, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_declare_operation(operator.ge, choice, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
_declare_operation(larger, lanes, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))
