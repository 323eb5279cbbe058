"""Rows of small matrix products in SIMD registers, by an LLVM intrinsic.

The compiler cannot tell that rows of one array, or of two, do not overlap, and guards every short loop over
them. Here the product is written out, for the short rows of `orthogonal_procrustes`. With `np.dot` in its
place an exhaustive query over 10,000 shapes takes 1.40 times as long (3.95 and 2.79 s, one thread).
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from core.arrays import Float32s

SIMD_WIDTH = 16
"""Numbers in a vector; rows are padded with zeros to a multiple."""


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
        vector = ir.VectorType(ir.FloatType(), SIMD_WIDTH)
        number = ir.IntType(64)
        kind = ir.FunctionType(vector, [vector] * 3)
        fused = builder.module.declare_intrinsic(f"llvm.fma.v{SIMD_WIDTH}f32", (), kind)
        at, own, share, first, step, count, begin, width = (values[i] for i in (1, 2, 4, 6, 7, 8, 10, 11))

        def data(which: int) -> Any:
            return context.make_array(signature.args[which])(context, builder, value=values[which]).data

        def place(array: Any, offset: Any) -> Any:
            return builder.bitcast(builder.gep(array, [offset]), vector.as_pointer())

        def broadcast(scalar: Any) -> Any:
            index = ir.IntType(32)
            one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, index(0))
            zeros = ir.Constant(ir.VectorType(index, SIMD_WIDTH), [0] * SIMD_WIDTH)
            return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)

        target, source, factors, rows = data(0), data(3), data(5), data(9)
        before = builder.block
        loop, after = builder.append_basic_block("rows"), builder.append_basic_block("rows.end")
        builder.branch(loop)
        builder.position_at_end(loop)
        c, total = builder.phi(number), builder.phi(vector)
        factor = builder.load(builder.gep(factors, [builder.add(first, builder.mul(c, step))]))
        row = builder.load(place(rows, builder.add(begin, builder.mul(c, width))), align=4)
        sum_so_far = builder.call(fused, [row, broadcast(factor), total])
        following = builder.add(c, number(1))
        c.add_incoming(number(0), before)
        c.add_incoming(following, loop)
        total.add_incoming(ir.Constant(vector, [0.0] * SIMD_WIDTH), before)
        total.add_incoming(sum_so_far, loop)
        builder.cbranch(builder.icmp_signed("<", following, count), loop, after)
        builder.position_at_end(after)
        mine = builder.fmul(builder.load(place(source, at), align=4), broadcast(own))
        builder.store(builder.call(fused, [sum_so_far, broadcast(share), mine]), place(target, at), align=4)
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
