"""Solutions with the sparse factors L D L^T for several right-hand sides at a time, in SIMD registers.

Numba leaves sums over a fixed number of neighbouring numbers in scalar registers. With scalars in place of
the two LLVM intrinsics here a solution with four right-hand sides takes 1.8 times as long. The intrinsics
share a file with the loop that calls them: Numba's cache notices changes of a function's own file only.
"""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from core.arrays import Floats, Ints
from core.numerics.compilation import compiled

SIMD_WIDTH = 4
"""Right-hand sides at a time, the numbers in a row."""

Indices = NDArray[np.uint32]
"""Of half the size of signed ones, for less memory that a solution reads."""

_VECTOR = ir.VectorType(ir.DoubleType(), SIMD_WIDTH)
_NUMBER = ir.IntType(64)


class _Rows:
    """Builds instructions on entries e, first <= e < last: factors values[e] and rows rows[e] of x."""

    def __init__(self, context: Any, builder: Any, signature: Any, values: Any) -> None:
        self.builder = builder
        self.fused = builder.module.declare_intrinsic(
            f"llvm.fma.v{SIMD_WIDTH}f64", (), ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        )
        arrays = [context.make_array(signature.args[i])(context, builder, value=values[i]) for i in range(3)]
        self.x, self.rows, self.values = (array.data for array in arrays)
        self.first, self.last = values[4], values[5]
        self.own = self.place(values[3])

    def place(self, row: Any) -> Any:
        """Return a pointer to a row."""
        offset = self.builder.mul(row, _NUMBER(SIMD_WIDTH))
        return self.builder.bitcast(self.builder.gep(self.x, [offset]), _VECTOR.as_pointer())

    def load(self, place: Any) -> Any:
        """Return the numbers of a row."""
        return self.builder.load(place, align=8)

    def entry(self, e: Any) -> tuple[Any, Any]:
        """Return the negative factor of an entry, in every element of a vector, and a pointer to its row."""
        factor = self.builder.fneg(self.builder.load(self.builder.gep(self.values, [e])))
        row = self.builder.zext(self.builder.load(self.builder.gep(self.rows, [e])), _NUMBER)
        return self.broadcast(factor), self.place(row)

    def broadcast(self, scalar: Any) -> Any:
        """Return a vector of one number."""
        index, undefined = ir.IntType(32), ir.Constant(_VECTOR, ir.Undefined)
        one = self.builder.insert_element(undefined, scalar, index(0))
        zeros = ir.Constant(ir.VectorType(index, SIMD_WIDTH), [0] * SIMD_WIDTH)
        return self.builder.shuffle_vector(one, undefined, zeros)

    def loop(self, first: Any, last: Any, step: int, sums: list[Any], body: Callable[..., list[Any]]) -> Any:
        """Run `body(e, sums)` for e = first, first + step, ... below last; return e and the sums after it."""
        builder = self.builder
        before = builder.block
        head, inside, after = (builder.append_basic_block(name) for name in ("head", "inside", "after"))
        builder.branch(head)
        builder.position_at_end(head)
        e, totals = builder.phi(_NUMBER), [builder.phi(_VECTOR) for _ in sums]
        builder.cbranch(builder.icmp_signed("<", e, last), inside, after)
        builder.position_at_end(inside)
        found = body(e, totals)
        following = builder.add(e, _NUMBER(step))
        for phi, start, new in zip([e, *totals], [first, *sums], [following, *found], strict=True):
            phi.add_incoming(start, before)
            phi.add_incoming(new, builder.block)
        builder.branch(head)
        builder.position_at_end(after)
        return e, totals


@intrinsic
def _scatter_intrinsic(_context: Any, x: Any, rows: Any, values: Any, own: Any, first: Any, last: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        entries = _Rows(context, builder, signature, arguments)
        known = entries.load(entries.own)

        def body(e: Any, _: Any) -> list[Any]:
            factor, place = entries.entry(e)
            changed = builder.call(entries.fused, [factor, known, entries.load(place)])
            builder.store(changed, place, align=8)
            return []

        entries.loop(entries.first, entries.last, 1, [], body)
        return context.get_dummy_value()

    return types.void(x, rows, values, types.int64, types.int64, types.int64), generate


@intrinsic
def _gather_intrinsic(
    _context: Any, x: Any, rows: Any, values: Any, own: Any, first: Any, last: Any, scale: Any
) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        entries = _Rows(context, builder, signature, arguments)

        def body(e: Any, sums: list[Any]) -> list[Any]:
            found = []
            for i, total in enumerate(sums):
                factor, place = entries.entry(builder.add(e, _NUMBER(i)))
                found.append(builder.call(entries.fused, [factor, entries.load(place), total]))
            return found

        start = builder.fmul(entries.load(entries.own), entries.broadcast(arguments[6]))
        zeros = ir.Constant(_VECTOR, [0.0] * SIMD_WIDTH)
        # Two sums, so that an addition need not wait for the last.
        pairs_end = builder.sub(entries.last, _NUMBER(1))
        e, (one, other) = entries.loop(entries.first, pairs_end, 2, [start, zeros], body)
        _, (total,) = entries.loop(e, entries.last, 1, [builder.fadd(one, other)], body)
        builder.store(total, entries.own, align=8)
        return context.get_dummy_value()

    return types.void(x, rows, values, types.int64, types.int64, types.int64, types.float64), generate


_subtract_from_rows = cast(
    "Callable[[Floats, NDArray[Any], Floats, int, int, int], None]", _scatter_intrinsic
)
"""`_subtract_from_rows(x, rows, values, own, first, last)`: row rows[e] of x loses values[e] times row `own`.

It does so for first <= e < last. x is float64, with its rows of SIMD_WIDTH numbers one after another, and no
rows[e] is `own`."""

_subtract_rows = cast(
    "Callable[[Floats, NDArray[Any], Floats, int, int, int, float], None]", _gather_intrinsic
)
"""`_subtract_rows(x, rows, values, own, first, last, scale)`: row `own` of x becomes `scale` times itself.

It then loses values[e] times row rows[e] for first <= e < last. x is as in `_subtract_from_rows`."""


@compiled
def solve(
    starts: Ints,
    rows: Indices,
    values: Floats,
    inverse: Floats,
    place: Ints,
    right: Floats,
    solution: Floats,
) -> None:
    """Fill the solutions of A x = b.

    Parameters
    ----------
    starts : int64, shape (n + 1,)
        Where the entries of each column of L begin.
    rows : uint32, shape (e,)
        Rows of the entries below the unit diagonal.
    values : float64, shape (e,)
        The entries.
    inverse : float64, shape (n,)
        1 / D.
    place : int64, shape (n,)
        The row of the factors that each row of A became.
    right : float64, shape (c, n)
        b, one after another.
    solution : float64, shape (n, c)
        Written.
    """
    count, columns = len(inverse), len(right)
    x = np.empty(SIMD_WIDTH * count)
    for first in range(0, columns, SIMD_WIDTH):
        width = min(SIMD_WIDTH, columns - first)
        for c in range(SIMD_WIDTH):
            column = right[first + min(c, width - 1)]
            for i in range(count):
                x[SIMD_WIDTH * place[i] + c] = column[i]
        for j in range(count):
            _subtract_from_rows(x, rows, values, j, starts[j], starts[j + 1])
        for j in range(count - 1, -1, -1):
            _subtract_rows(x, rows, values, j, starts[j], starts[j + 1], inverse[j])
        for i in range(count):
            for c in range(width):
                solution[i, first + c] = x[SIMD_WIDTH * place[i] + c]
