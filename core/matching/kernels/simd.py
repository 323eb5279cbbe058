"""Products of small matrices and distances of short rows in SIMD registers, by LLVM intrinsics.

The compiler cannot tell that rows of one array, or of two, do not overlap, and guards every short loop over
them; BLAS takes longer to call than to multiply. With `np.dot` and scalar distances in place of the three
intrinsics a match takes 1.8 times as long (0.66 and 0.37 ms, one thread), with plain loops twice.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

from core.arrays import Float32s
from core.numerics.compilation import kernel

SIMD_WIDTH = 16
"""Numbers in a vector, and columns of a tile."""

TILE_ROWS = 4
"""Rows of a tile, whose sums stay in registers."""

SUMS = 4
"""Sums of a squared distance, each of every fourth column: one sum would wait for itself at each step."""

_NUMBER = ir.IntType(64)
_ROW = ir.VectorType(ir.FloatType(), SIMD_WIDTH)
_FOUR = ir.VectorType(ir.FloatType(), SUMS)


def _require_rows(*arrays: Any) -> None:
    if any(array.layout != "C" or array.dtype != types.float32 for array in arrays):
        raise TypingError("the arrays are contiguous arrays of float32")


def _data(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return the pointer to the numbers of an array."""
    return context.make_array(kind)(context, builder, value=value).data


def _vector_at(builder: Any, kind: Any, array: Any, offset: Any) -> Any:
    """Return the pointer to the vector that begins at a number of an array."""
    return builder.bitcast(builder.gep(array, [offset]), kind.as_pointer())


def _broadcast(builder: Any, scalar: Any) -> Any:
    """Return a vector of one number."""
    index, undefined = ir.IntType(32), ir.Constant(_ROW, ir.Undefined)
    first = builder.insert_element(undefined, scalar, index(0))
    zeros = ir.Constant(ir.VectorType(index, SIMD_WIDTH), [0] * SIMD_WIDTH)
    return builder.shuffle_vector(first, undefined, zeros)


def _fused(builder: Any) -> Any:
    """Return the function that multiplies two rows and adds a third."""
    kind = ir.FunctionType(_ROW, [_ROW] * 3)
    return builder.module.declare_intrinsic(f"llvm.fma.v{SIMD_WIDTH}f32", (), kind)


def _summed(builder: Any, kind: Any, sums: int, count: Any, step: int, body: Callable[..., list[Any]]) -> Any:
    """Return vectors after `body(c, totals)` has run for c = 0, step, ... below count; count >= 1."""
    before = builder.block
    loop, after = builder.append_basic_block("loop"), builder.append_basic_block("loop.end")
    builder.branch(loop)
    builder.position_at_end(loop)
    c, totals = builder.phi(_NUMBER), [builder.phi(kind) for _ in range(sums)]
    results = body(c, totals)
    following = builder.add(c, _NUMBER(step))
    c.add_incoming(_NUMBER(0), before)
    c.add_incoming(following, loop)
    for total, result in zip(totals, results, strict=True):
        total.add_incoming(ir.Constant(kind, [0.0] * kind.count), before)
        total.add_incoming(result, loop)
    builder.cbranch(builder.icmp_signed("<", following, count), loop, after)
    builder.position_at_end(after)
    return results


@intrinsic
def _row_intrinsic(
    _context: Any,
    out: Any,
    place: Any,
    weight: Any,
    addend: Any,
    share: Any,
    factors: Any,
    first: Any,
    step: Any,
    count: Any,
    rows: Any,
    begin: Any,
    width: Any,
) -> Any:
    _require_rows(out, addend, factors, rows)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place, weight, share, first, step, count, begin, width = (
            values[i] for i in (1, 2, 4, 6, 7, 8, 10, 11)
        )
        out, addend, factors, rows = (
            _data(context, builder, signature.args[i], values[i]) for i in (0, 3, 5, 9)
        )
        fused = _fused(builder)

        def body(c: Any, totals: list[Any]) -> list[Any]:
            factor = builder.load(builder.gep(factors, [builder.add(first, builder.mul(c, step))]))
            start = _vector_at(builder, _ROW, rows, builder.add(begin, builder.mul(c, width)))
            return [builder.call(fused, [builder.load(start, align=4), _broadcast(builder, factor), *totals])]

        (sums,) = _summed(builder, _ROW, 1, count, 1, body)
        added = builder.load(_vector_at(builder, _ROW, addend, place), align=4)
        added = builder.fmul(added, _broadcast(builder, weight))
        sums = builder.call(fused, [sums, _broadcast(builder, share), added])
        builder.store(sums, _vector_at(builder, _ROW, out, place), align=4)
        return context.get_dummy_value()

    number, index = types.float32, types.intp
    arguments = (out, index, number, addend, number, factors, index, index, index, rows, index, index)
    return types.void(*arguments), generate


product_row = cast(
    "Callable[[Float32s, int, float, Float32s, float, Float32s, int, int, int, Float32s, int, int], None]",
    _row_intrinsic,
)
"""`product_row(out, place, weight, addend, share, factors, first, step, count, rows, begin, width)`, float32.

SIMD_WIDTH numbers of `out`, from its number `place` on, become weight * addend[place:] plus share times the
sum over c < count of factors[first + c step] * rows[begin + c width:]; count >= 1."""


@intrinsic
def _tile_intrinsic(
    _context: Any,
    out: Any,
    corner: Any,
    width: Any,
    left: Any,
    first: Any,
    down: Any,
    across: Any,
    right: Any,
    begin: Any,
    step: Any,
    count: Any,
) -> Any:
    _require_rows(out, left, right)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        corner, width, first, down, across, begin, step, count = (
            values[i] for i in (1, 2, 4, 5, 6, 8, 9, 10)
        )
        out, left, right = (_data(context, builder, signature.args[i], values[i]) for i in (0, 3, 7))
        fused = _fused(builder)
        rows = [builder.add(first, builder.mul(_NUMBER(row), down)) for row in range(TILE_ROWS)]

        def body(c: Any, totals: list[Any]) -> list[Any]:
            place = _vector_at(builder, _ROW, right, builder.add(begin, builder.mul(c, step)))
            factors, along = builder.load(place, align=4), builder.mul(c, across)
            sums = []
            for row, total in zip(rows, totals, strict=True):
                entry = builder.load(builder.gep(left, [builder.add(row, along)]))
                sums.append(builder.call(fused, [_broadcast(builder, entry), factors, total]))
            return sums

        for row, sums in enumerate(_summed(builder, _ROW, TILE_ROWS, count, 1, body)):
            target = builder.add(corner, builder.mul(_NUMBER(row), width))
            builder.store(sums, _vector_at(builder, _ROW, out, target), align=4)
        return context.get_dummy_value()

    index = types.intp
    arguments = (out, index, index, left, index, index, index, right, index, index, index)
    return types.void(*arguments), generate


_tile = cast("Callable[..., None]", _tile_intrinsic)
"""`_tile(out, corner, width, left, first, down, across, right, begin, step, count)`, float32.

TILE_ROWS x SIMD_WIDTH numbers of `out`, whose rows of `width` numbers begin at its number `corner`, become
the sums over c < count of left[first + row down + c across] * right[begin + c step + column]; count >= 1."""


@intrinsic
def _squares_intrinsic(_context: Any, first: Any, start: Any, second: Any, begin: Any, count: Any) -> Any:
    _require_rows(first, second)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        first, second = (_data(context, builder, signature.args[i], values[i]) for i in (0, 2))

        def body(c: Any, totals: list[Any]) -> list[Any]:
            left, right = (
                builder.load(_vector_at(builder, _FOUR, array, builder.add(offset, c)), align=4)
                for array, offset in ((first, values[1]), (second, values[3]))
            )
            difference = builder.fsub(left, right)
            return [builder.fadd(totals[0], builder.fmul(difference, difference))]

        (sums,) = _summed(builder, _FOUR, 1, values[4], SUMS, body)
        parts = [builder.extract_element(sums, ir.IntType(32)(i)) for i in range(SUMS)]
        return context.make_tuple(builder, signature.return_type, parts)

    index, tuples = types.intp, cast("Any", types.UniTuple)
    return tuples(types.float32, SUMS)(first, index, second, index, index), generate


_squares = cast("Callable[[Float32s, int, Float32s, int, int], tuple[np.float32, ...]]", _squares_intrinsic)
"""`_squares(first, start, second, begin, count)`: `SUMS` sums of squared differences of `count` numbers.

They begin at number `start` of `first` and at number `begin` of `second`; count is a positive multiple of
`SUMS`, and each sum has every fourth number."""


@kernel
def product(left: Float32s, right: Float32s, out: Float32s) -> None:
    """Write the product of two matrices, left @ right.

    Parameters
    ----------
    left : float32, shape (m, at least k), contiguous
        Later columns than the first k are not read; k >= 1.
    right : float32, shape (k, n), contiguous
    out : float32, shape (m, n), contiguous
        Written.
    """
    # A literal 1 would be compiled apart.
    _product(left, left.shape[1], np.int64(1), right, out)


@kernel
def cross_product(left: Float32s, right: Float32s, out: Float32s) -> None:
    """Write the product of a transposed matrix and another, left.T @ right.

    Parameters
    ----------
    left : float32, shape (k, at least m), contiguous
        Later columns than the first m are not read; k >= 1.
    right : float32, shape (k, n), contiguous
    out : float32, shape (m, n), contiguous
        Written.
    """
    _product(left, np.int64(1), left.shape[1], right, out)


@kernel
def _product(
    left: Float32s, down: int | np.int64, across: int | np.int64, right: Float32s, out: Float32s
) -> None:
    """Write the product whose left matrix has its entry (i, c) at number i down + c across of `left`."""
    m, n = out.shape
    k = len(right)
    # Matrices smaller than a tile: plain loops.
    if m < TILE_ROWS or n < SIMD_WIDTH:
        entries = left.reshape(left.size)
        out[:] = np.float32(0.0)
        for i in range(m):
            for c in range(k):
                for j in range(n):
                    out[i, j] += entries[i * down + c * across] * right[c, j]
        return
    # Tiles. The last tile of rows, and that of columns, overlaps the one before.
    for i in range(0, m, TILE_ROWS):
        row = min(i, m - TILE_ROWS)
        for j in range(0, n, SIMD_WIDTH):
            column = min(j, n - SIMD_WIDTH)
            _tile(out, row * n + column, n, left, row * down, down, across, right, column, n, k)


@kernel
def symmetric_product(lower: Float32s, right: Float32s, out: Float32s) -> None:
    """Write the product of a symmetric matrix and another, (lower + lower.T) @ right.

    Parameters
    ----------
    lower : float32, shape (m, m), contiguous
        Zeros above the diagonal.
    right : float32, shape (m, n), contiguous
        n is a multiple of SIMD_WIDTH.
    out : float32, shape (m, n), contiguous
        Written.
    """
    m, n = out.shape
    turned = np.empty((m, n), dtype=np.float32)
    if m < TILE_ROWS:
        product(lower, right, out)
        cross_product(lower, right, turned)
    else:
        # A tile of rows reads the columns up to its last row; turned, the rows from its first row on.
        for i in range(0, m, TILE_ROWS):
            row = min(i, m - TILE_ROWS)
            for column in range(0, n, SIMD_WIDTH):
                corner = row * n + column
                _tile(out, corner, n, lower, row * m, m, 1, right, column, n, row + TILE_ROWS)
                _tile(turned, corner, n, lower, row * m + row, 1, m, right, corner, n, m - row)
    for i in range(m):
        for j in range(n):
            out[i, j] += turned[i, j]


@kernel
def squared_distance(points: Float32s, row: int, others: Float32s, other: int) -> np.float32:
    """Return the squared distance of a row of points, shape (n, k), and one of others, shape (m, k).

    Both arrays are contiguous. With scalar sums a search of the regions of 100 samples takes three times as
    long (10 and 3.2 microseconds).
    """
    k = points.shape[1]
    whole = k - k % SUMS
    a = b = c = d = np.float32(0.0)
    if whole > 0:
        a, b, c, d = _squares(points, row * k, others, other * others.shape[1], whole)
    for i in range(whole, k):
        a += (points[row, i] - others[other, i]) ** 2
    return (a + b) + (c + d)
