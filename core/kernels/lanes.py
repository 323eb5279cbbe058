"""One row plus a multiple of another, as one vector operation.

The compiler does not see that rows of one array, or of two, lie apart, and guards every short loop over them.
Here the operation is written out, for the short rows that `core.kernels.rotation` works on.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from core.embedding import Float32s

LANES = 16
"""Numbers in a vector; rows are padded with zeros to a multiple."""


@intrinsic
def _add_scaled(_context: Any, rows: Any, at: Any, row: Any, start: Any, factor: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        vector = ir.VectorType(ir.FloatType(), LANES)
        index = ir.IntType(32)

        def place(which: int, offset: Any) -> Any:
            array = context.make_array(signature.args[which])(context, builder, value=values[which])
            return builder.bitcast(builder.gep(array.data, [offset]), vector.as_pointer())

        target = place(0, values[1])
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), values[4], index(0))
        all_lanes = ir.Constant(ir.VectorType(index, LANES), [0] * LANES)
        scale = builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), all_lanes)
        kind = ir.FunctionType(vector, [vector] * 3)
        fused = builder.module.declare_intrinsic(f"llvm.fma.v{LANES}f32", (), kind)
        total = builder.call(
            fused, [builder.load(place(2, values[3]), align=4), scale, builder.load(target, align=4)]
        )
        builder.store(total, target, align=4)
        return context.get_dummy_value()

    return types.void(rows, types.intp, row, types.intp, types.float32), generate


add_scaled = cast("Callable[[Float32s, int, Float32s, int, float], None]", _add_scaled)
"""`add_scaled(rows, at, row, start, factor)`, float32: LANES numbers of `rows`, from the `at`-th of all on,
grow by factor times those of `row` from `start` on."""
