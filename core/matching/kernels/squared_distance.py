"""The squared distance of two short rows, in a SIMD register of four sums, by an LLVM intrinsic.

The compiler cannot tell that two rows do not overlap, and takes their numbers one by one: a search of the
regions of 100 samples then takes three times as long (10 and 3.2 microseconds).
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

SUMS = 4


@intrinsic
def _four_sums(_context: Any, first: Any, at: Any, second: Any, begin: Any, count: Any) -> Any:
    if any(array.layout != "C" or array.dtype != types.float32 for array in (first, second)):
        raise TypingError("rows are those of contiguous arrays of float32")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        vector, number = ir.VectorType(ir.FloatType(), SUMS), ir.IntType(64)
        one, other = (context.make_array(signature.args[i])(context, builder, values[i]).data for i in (0, 2))

        def part(array: Any, start: Any, c: Any) -> Any:
            place = builder.gep(array, [builder.add(start, c)])
            return builder.load(builder.bitcast(place, vector.as_pointer()), align=4)

        before = builder.block
        loop, after = builder.append_basic_block("parts"), builder.append_basic_block("parts.end")
        builder.branch(loop)
        builder.position_at_end(loop)
        c, total = builder.phi(number), builder.phi(vector)
        step = builder.fsub(part(one, values[1], c), part(other, values[3], c))
        sums = builder.fadd(total, builder.fmul(step, step))
        following = builder.add(c, number(SUMS))
        c.add_incoming(number(0), before)
        c.add_incoming(following, loop)
        total.add_incoming(ir.Constant(vector, [0.0] * SUMS), before)
        total.add_incoming(sums, loop)
        builder.cbranch(builder.icmp_signed("<", following, values[4]), loop, after)
        builder.position_at_end(after)
        each = [builder.extract_element(sums, ir.IntType(32)(i)) for i in range(SUMS)]
        return context.make_tuple(builder, signature.return_type, each)

    index, tuples = types.intp, cast("Any", types.UniTuple)
    return tuples(types.float32, SUMS)(first, index, second, index, index), generate


_sums = cast("Callable[[Float32s, int, Float32s, int, int], tuple[np.float32, ...]]", _four_sums)
"""`_sums(first, at, second, begin, count)`: sums of squared differences of `count` numbers, a positive
multiple of four, from the `at`-th of `first` and the `begin`-th of `second` on; each fourth in one sum."""


@kernel
def squared_distance(points: Float32s, row: int, others: Float32s, other: int) -> np.float32:
    """Squared distance of a row of points, shape (n, k), and one of others, shape (m, k), both contiguous.

    In four sums, each of every fourth column: one would wait for itself at each step.
    """
    k = points.shape[1]
    whole = k - k % SUMS
    a = b = c = d = np.float32(0.0)
    if whole > 0:
        a, b, c, d = _sums(points, row * k, others, other * others.shape[1], whole)
    for i in range(whole, k):
        a += (points[row, i] - others[other, i]) ** 2
    return (a + b) + (c + d)
