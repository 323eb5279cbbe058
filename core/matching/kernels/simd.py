"""Parts of small matrix products in SIMD registers, by LLVM intrinsics.

The compiler cannot tell that rows of one array, or of two, do not overlap, and guards every short loop over
them. Here the products are written out: a row for `orthogonal_procrustes`, a tile for `matrix_product`. With
`np.dot` in place of the row an exhaustive query over 10,000 shapes takes 1.40 times as long (3.95 and 2.79 s,
one thread), and with `np.dot` in place of the tile a match takes a quarter longer (0.20 and 0.16 ms).
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

from core.arrays import Float32s

SIMD_WIDTH = 16
"""Numbers in a vector; rows of `product_row` are padded with zeros to a multiple."""

TILE_ROWS = 4
"""Rows of a tile, each of SIMD_WIDTH columns: its sums stay in registers."""

_VECTOR, _NUMBER = ir.VectorType(ir.FloatType(), SIMD_WIDTH), ir.IntType(64)
_ZEROS = ir.Constant(_VECTOR, [0.0] * SIMD_WIDTH)


def _fused(builder: Any) -> Any:
    """The function that multiplies two vectors and adds a third."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
    return builder.module.declare_intrinsic(f"llvm.fma.v{SIMD_WIDTH}f32", (), kind)


def _place(builder: Any, array: Any, offset: Any) -> Any:
    """The vector that begins at a number of an array."""
    return builder.bitcast(builder.gep(array, [offset]), _VECTOR.as_pointer())


def _broadcast(builder: Any, scalar: Any) -> Any:
    index, undefined = ir.IntType(32), ir.Constant(_VECTOR, ir.Undefined)
    one = builder.insert_element(undefined, scalar, index(0))
    return builder.shuffle_vector(
        one, undefined, ir.Constant(ir.VectorType(index, SIMD_WIDTH), [0] * SIMD_WIDTH)
    )


@intrinsic
def _product_row(
    _context: Any,
    target: Any,
    at: Any,
    own: Any,
    source: Any,
    share: Any,
    factors: Any,
    first: Any,
    step: Any,
    count: Any,
    rows: Any,
    begin: Any,
    width: Any,
) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        fused = _fused(builder)
        at, own, share, first, step, count, begin, width = (values[i] for i in (1, 2, 4, 6, 7, 8, 10, 11))

        def data(which: int) -> Any:
            return context.make_array(signature.args[which])(context, builder, value=values[which]).data

        target, source, factors, rows = data(0), data(3), data(5), data(9)
        before = builder.block
        loop, after = builder.append_basic_block("rows"), builder.append_basic_block("rows.end")
        builder.branch(loop)
        builder.position_at_end(loop)
        c, total = builder.phi(_NUMBER), builder.phi(_VECTOR)
        factor = builder.load(builder.gep(factors, [builder.add(first, builder.mul(c, step))]))
        row = builder.load(_place(builder, rows, builder.add(begin, builder.mul(c, width))), align=4)
        sum_so_far = builder.call(fused, [row, _broadcast(builder, factor), total])
        following = builder.add(c, _NUMBER(1))
        c.add_incoming(_NUMBER(0), before)
        c.add_incoming(following, loop)
        total.add_incoming(_ZEROS, before)
        total.add_incoming(sum_so_far, loop)
        builder.cbranch(builder.icmp_signed("<", following, count), loop, after)
        builder.position_at_end(after)
        mine = builder.fmul(builder.load(_place(builder, source, at), align=4), _broadcast(builder, own))
        ends = builder.call(fused, [sum_so_far, _broadcast(builder, share), mine])
        builder.store(ends, _place(builder, target, at), align=4)
        return context.get_dummy_value()

    one, index = types.float32, types.intp
    arguments = (target, index, one, source, one, factors, index, index, index, rows, index, index)
    return types.void(*arguments), generate


product_row = cast(
    "Callable[[Float32s, int, float, Float32s, float, Float32s, int, int, int, Float32s, int, int], None]",
    _product_row,
)
"""`product_row(target, at, own, source, share, factors, first, step, count, rows, begin, width)`, float32.

SIMD_WIDTH numbers of `target`, from the `at`-th of all on, become own * source[at:] plus share times the sum
over c < count of factors[first + c step] * rows[begin + c width:]; count >= 1."""


@intrinsic
def _product_tile(
    _context: Any,
    out: Any,
    at: Any,
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
    if any(array.layout != "C" or array.dtype != types.float32 for array in (out, left, right)):
        raise TypingError("the matrices are contiguous arrays of float32")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        fused = _fused(builder)
        at, width, first, down, across, begin, step, count = (values[i] for i in (1, 2, 4, 5, 6, 8, 9, 10))
        out, left, right = (
            context.make_array(signature.args[i])(context, builder, value=values[i]).data for i in (0, 3, 7)
        )
        rows = [builder.add(first, builder.mul(_NUMBER(row), down)) for row in range(TILE_ROWS)]
        before = builder.block
        loop, after = builder.append_basic_block("sums"), builder.append_basic_block("sums.end")
        builder.branch(loop)
        builder.position_at_end(loop)
        c, totals = builder.phi(_NUMBER), [builder.phi(_VECTOR) for _ in rows]
        factors = builder.load(_place(builder, right, builder.add(begin, builder.mul(c, step))), align=4)
        along = builder.mul(c, across)
        sums = []
        for row, total in zip(rows, totals, strict=True):
            own = builder.load(builder.gep(left, [builder.add(row, along)]))
            sums.append(builder.call(fused, [_broadcast(builder, own), factors, total]))
        following = builder.add(c, _NUMBER(1))
        c.add_incoming(_NUMBER(0), before)
        c.add_incoming(following, loop)
        for total, found in zip(totals, sums, strict=True):
            total.add_incoming(_ZEROS, before)
            total.add_incoming(found, loop)
        builder.cbranch(builder.icmp_signed("<", following, count), loop, after)
        builder.position_at_end(after)
        for number, found in enumerate(sums):
            target = builder.add(at, builder.mul(_NUMBER(number), width))
            builder.store(found, _place(builder, out, target), align=4)
        return context.get_dummy_value()

    index = types.intp
    arguments = (out, index, index, left, index, index, index, right, index, index, index)
    return types.void(*arguments), generate


product_tile = cast(
    "Callable[[Float32s, int, int, Float32s, int, int, int, Float32s, int, int, int], None]", _product_tile
)
"""`product_tile(out, at, width, left, first, down, across, right, begin, step, count)`, float32.

TILE_ROWS x SIMD_WIDTH numbers of `out`, whose rows of `width` numbers begin at its `at`-th, become the sums
over c < count of left[first + row down + c across] * right[begin + c step + column]; count >= 1."""
