"""Vectors of numbers in SIMD registers, and products of small matrices by them.

The compiler cannot tell that rows of one array, or of two, do not overlap, and guards every short loop over
them; BLAS takes longer to call than to multiply. So the kernels say what a register holds: `load` reads a
`Vector` from an array, operators work lane by lane, and `store` writes it.
"""

import operator
from collections.abc import Callable
from typing import Any, Protocol, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.errors import TypingError
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

from core.arrays import Float32s
from core.numerics.compilation import inlined, kernel

SIMD_WIDTH = 16
"""Lanes of a vector along a row, and columns of a tile."""

TILE_ROWS = 4
"""Rows of a tile, whose sums stay in registers."""

SUMS = 4
"""Sums of a squared distance, each of every fourth column: one sum would wait for itself at each step."""


class Vector(Protocol):
    """So many float32 or int32 numbers in a register."""

    def __add__(self, other: "Vector") -> "Vector": ...
    def __sub__(self, other: "Vector") -> "Vector": ...
    def __mul__(self, other: "Vector") -> "Vector": ...
    def __and__(self, other: "Vector") -> "Vector": ...
    def __or__(self, other: "Vector") -> "Vector": ...


class VectorType(types.Type):
    """The compiler's type of a vector."""

    def __init__(self, element: Any, lanes: int) -> None:
        self.element, self.lanes = element, lanes
        number = ir.FloatType() if element == types.float32 else ir.IntType(32)
        self.code = ir.VectorType(number, lanes)
        super().__init__(name=f"vector({element}, {lanes})")


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.code)  # type: ignore[no-untyped-call]


_register, _lowering, _signature = (cast("Any", each) for each in (infer_global, lower_builtin, signature))


def _define(function: Any, of_floats: str, of_integers: str) -> None:
    """Let an operator of two vectors be the instruction of this name."""

    class _Operator(AbstractTemplate):
        def generic(self, args: Any, _kws: Any) -> Any:
            vectors = isinstance(args[0], VectorType) and args[0] == args[-1]
            return _signature(args[0], *args) if vectors else None

    def lower(_context: Any, builder: Any, signed: Any, values: Any) -> Any:
        name = of_floats if signed.return_type.element == types.float32 else of_integers
        return getattr(builder, name)(*values)

    _register(function)(_Operator)
    _lowering(function, VectorType, VectorType)(lower)


_define(operator.add, "fadd", "add")
_define(operator.sub, "fsub", "sub")
_define(operator.mul, "fmul", "mul")
_define(operator.and_, "", "and_")
_define(operator.or_, "", "or_")


def _pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    """Return the pointer to a number of an array."""
    return builder.gep(context.make_array(kind)(context, builder, value=array).data, [place])


def _filled(builder: Any, kind: Any, number: Any) -> Any:
    """Return a vector of one number."""
    index, undefined = ir.IntType(32), ir.Constant(kind.code, ir.Undefined)
    zeros = ir.Constant(ir.VectorType(index, kind.lanes), [0] * kind.lanes)
    return builder.shuffle_vector(builder.insert_element(undefined, number, index(0)), undefined, zeros)


def _vector_of(array: Any, lanes: Any) -> Any:
    if array.layout != "C" or array.dtype not in (types.float32, types.int32):
        raise TypingError("the arrays are contiguous arrays of float32 or int32")
    return VectorType(array.dtype, lanes.literal_value)


@intrinsic(prefer_literal=True)
def _load(_context: Any, array: Any, place: Any, lanes: Any) -> Any:
    kind = _vector_of(array, lanes)

    def generate(context: Any, builder: Any, signed: Any, values: Any) -> Any:
        start = _pointer(context, builder, signed.args[0], values[0], values[1])
        return builder.load(builder.bitcast(start, kind.code.as_pointer()), align=4)

    return kind(array, types.intp, lanes), generate


@intrinsic(prefer_literal=True)
def _load_whole(_context: Any, array: Any, place: Any, lanes: Any) -> Any:
    if array.layout != "C" or array.dtype not in (types.int8, types.int16):
        raise TypingError("the array is a contiguous array of int8 or int16")
    kind = VectorType(types.float32, lanes.literal_value)
    whole = ir.VectorType(ir.IntType(array.dtype.bitwidth), kind.lanes)

    def generate(context: Any, builder: Any, signed: Any, values: Any) -> Any:
        start = _pointer(context, builder, signed.args[0], values[0], values[1])
        return builder.sitofp(builder.load(builder.bitcast(start, whole.as_pointer()), align=1), kind.code)

    return kind(array, types.intp, lanes), generate


@intrinsic(prefer_literal=True)
def _entry(_context: Any, array: Any, place: Any, lanes: Any) -> Any:
    kind = _vector_of(array, lanes)

    def generate(context: Any, builder: Any, signed: Any, values: Any) -> Any:
        return _filled(
            builder, kind, builder.load(_pointer(context, builder, signed.args[0], values[0], values[1]))
        )

    return kind(array, types.intp, lanes), generate


@intrinsic
def _store(_context: Any, vector: Any, array: Any, place: Any) -> Any:
    if array.layout != "C" or array.dtype != vector.element:
        raise TypingError("the array is contiguous and has the numbers of the vector")

    def generate(context: Any, builder: Any, signed: Any, values: Any) -> Any:
        start = _pointer(context, builder, signed.args[1], values[1], values[2])
        builder.store(values[0], builder.bitcast(start, vector.code.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(vector, array, types.intp), generate


@intrinsic(prefer_literal=True)
def _repeat(_context: Any, number: Any, lanes: Any) -> Any:
    element = types.float32 if isinstance(number, types.Float) else types.int32
    kind = VectorType(element, lanes.literal_value)

    def generate(_context: Any, builder: Any, _signed: Any, values: Any) -> Any:
        return _filled(builder, kind, values[0])

    return kind(element, lanes), generate


@intrinsic
def _fused(_context: Any, first: Any, second: Any, addend: Any) -> Any:
    def generate(_context: Any, builder: Any, _signed: Any, values: Any) -> Any:
        kind = ir.FunctionType(first.code, [first.code] * 3)
        return builder.call(builder.module.declare_intrinsic(f"llvm.fma.v{first.lanes}f32", (), kind), values)

    return first(first, second, addend), generate


@intrinsic
def _least(_context: Any, first: Any, second: Any) -> Any:
    def generate(_context: Any, builder: Any, _signed: Any, values: Any) -> Any:
        return builder.select(builder.icmp_signed("<", *values), *values)

    return first(first, second), generate


@intrinsic
def _greatest(_context: Any, first: Any, second: Any) -> Any:
    def generate(_context: Any, builder: Any, _signed: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *values), *values)

    return first(first, second), generate


@intrinsic
def _bits(_context: Any, vector: Any) -> Any:
    kind = VectorType(types.int32, vector.lanes)

    def generate(_context: Any, builder: Any, _signed: Any, values: Any) -> Any:
        return builder.bitcast(values[0], kind.code)

    return kind(vector), generate


@intrinsic
def _lane(_context: Any, vector: Any, index: Any) -> Any:
    def generate(_context: Any, builder: Any, _signed: Any, values: Any) -> Any:
        return builder.extract_element(*values)

    return vector.element(vector, types.intp), generate


load = cast("Callable[[NDArray[np.generic], int, int], Vector]", _load)
"""`load(array, place, lanes)`: the vector that begins at a number of a contiguous array."""

load_whole = cast("Callable[[NDArray[np.generic], int, int], Vector]", _load_whole)
"""`load_whole(array, place, lanes)`: `load` of int8 or int16 numbers, as floats."""

entry = cast("Callable[[NDArray[np.generic], int, int], Vector]", _entry)
"""`entry(array, place, lanes)`: a vector of one number of a contiguous array."""

store = cast("Callable[[Vector, NDArray[np.generic], int], None]", _store)
"""`store(vector, array, place)`: write the vector from a number of a contiguous array on."""

repeat = cast("Callable[[np.float32 | np.int32, int], Vector]", _repeat)
"""`repeat(number, lanes)`: a vector of one number."""

fused = cast("Callable[[Vector, Vector, Vector], Vector]", _fused)
"""`fused(first, second, addend)`: first * second + addend, rounded once."""

least = cast("Callable[[Vector, Vector], Vector]", _least)
"""`least(first, second)`: the lesser integers."""

greatest = cast("Callable[[Vector, Vector], Vector]", _greatest)
"""`greatest(first, second)`: the greater floats."""

bits = cast("Callable[[Vector], Vector]", _bits)
"""`bits(vector)`: the bits of floats as integers."""

lane = cast("Callable[[Vector, int], Any]", _lane)
"""`lane(vector, index)`: one number of a vector."""


@inlined
def tile(
    left: Float32s,
    rows: tuple[int, int, int, int],
    across: int,
    right: Float32s,
    begin: int,
    step: int,
    count: int,
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return TILE_ROWS x SIMD_WIDTH entries of a product of matrices, a vector for each row.

    Row r is the sum over c < count of left[rows[r] + c across] * right[begin + c step + column], by numbers
    of contiguous arrays of float32.
    """
    nought = repeat(np.float32(0.0), SIMD_WIDTH)
    first, second, third, fourth = nought, nought, nought, nought
    for c in range(count):
        factors = load(right, begin + c * step, SIMD_WIDTH)
        along = c * across
        first = fused(entry(left, rows[0] + along, SIMD_WIDTH), factors, first)
        second = fused(entry(left, rows[1] + along, SIMD_WIDTH), factors, second)
        third = fused(entry(left, rows[2] + along, SIMD_WIDTH), factors, third)
        fourth = fused(entry(left, rows[3] + along, SIMD_WIDTH), factors, fourth)
    return first, second, third, fourth


@inlined
def tile_rows(row: int, count: int, stride: int) -> tuple[int, int, int, int]:
    """Return where TILE_ROWS rows from `row` on begin, the last of `count` in the place of rows beyond it."""
    last = count - 1
    return (
        min(row, last) * stride,
        min(row + 1, last) * stride,
        min(row + 2, last) * stride,
        min(row + 3, last) * stride,
    )


@inlined
def whole_vectors(count: int) -> int:
    """Return the least multiple of SIMD_WIDTH that is not below a number."""
    return (count + SIMD_WIDTH - 1) // SIMD_WIDTH * SIMD_WIDTH


@kernel
def product(left: Float32s, right: Float32s, out: Float32s) -> None:
    """Write the product of two matrices, left @ right.

    Parameters
    ----------
    left : float32, shape (m, at least k), contiguous
        Later columns than the first k are not read.
    right : float32, shape (k, n), contiguous
        n is a multiple of SIMD_WIDTH.
    out : float32, shape (m, n), contiguous
        Written.
    """
    m, n = out.shape
    for i in range(0, m, TILE_ROWS):
        rows = tile_rows(i, m, left.shape[1])
        places = tile_rows(i, m, n)
        for j in range(0, n, SIMD_WIDTH):
            first, second, third, fourth = tile(left, rows, 1, right, j, n, len(right))
            store(first, out, places[0] + j)
            store(second, out, places[1] + j)
            store(third, out, places[2] + j)
            store(fourth, out, places[3] + j)


@kernel
def symmetric_product(lower: Float32s, right: Float32s, low: int, out: Float32s) -> None:
    """Write the product of a symmetric matrix and some columns of another, (lower + lower.T) @ right.

    Parameters
    ----------
    lower : float32, shape (m, m), contiguous
        Zeros above the diagonal.
    right : float32, shape (m, at least low + n), contiguous
    low : int
        The first of n columns.
    out : float32, shape (m, n), contiguous
        Written; n is a multiple of SIMD_WIDTH.
    """
    m, n = out.shape
    width = right.shape[1]
    for i in range(0, m, TILE_ROWS):
        rows = tile_rows(i, m, m)
        columns = tile_rows(i, m, 1)
        places = tile_rows(i, m, n)
        below = i * m
        turned = (below + columns[0], below + columns[1], below + columns[2], below + columns[3])
        for j in range(0, n, SIMD_WIDTH):
            # The rows read the columns up to the last of them; turned, the rows from the first of them on.
            first, second, third, fourth = tile(lower, rows, 1, right, low + j, width, columns[3] + 1)
            a, b, c, d = tile(lower, turned, m, right, i * width + low + j, width, m - i)
            store(first + a, out, places[0] + j)
            store(second + b, out, places[1] + j)
            store(third + c, out, places[2] + j)
            store(fourth + d, out, places[3] + j)


@inlined
def squared_distance(points: Float32s, row: int, others: Float32s, other: int) -> np.float32:
    """Return the squared distance of a row of points, shape (n, k), and one of others, shape (m, at least k).

    Both arrays are contiguous.
    """
    k = points.shape[1]
    start, begin = row * k, other * others.shape[1]
    whole = k - k % SUMS
    sums = repeat(np.float32(0.0), SUMS)
    for c in range(0, whole, SUMS):
        difference = load(points, start + c, SUMS) - load(others, begin + c, SUMS)
        sums = sums + difference * difference
    first, second, third, fourth = lane(sums, 0), lane(sums, 1), lane(sums, 2), lane(sums, 3)
    for c in range(whole, k):
        first += (points[row, c] - others[other, c]) ** 2
    return np.float32((first + second) + (third + fourth))
