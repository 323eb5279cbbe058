"""The rows of a binary PLY element, whose lists may differ in length from row to row."""

import struct
from array import array

import numpy as np

from core.arrays import Ints
from core.errors import MalformedMeshError
from core.io.ply_header import Element, Property

_LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}


def end_of_rows(data: bytes, start: int, element: Element) -> int:
    """Return the offset of the end of an element without lists.

    Raises
    ------
    MalformedMeshError
        The element extends beyond the end of the data.
    """
    end = start + element.count * sum(_size(p) for p in element.properties)
    if end > len(data):
        raise _cut_short(element)
    return end


def read_lists(
    data: bytes, start: int, element: Element, order: str, wanted: Property | None
) -> tuple[Ints, Ints, int]:
    """Read one list property of an element with lists, and find the end of the element.

    Parameters
    ----------
    data : bytes
        The file.
    start : int
        Offset of the element.
    element : Element
        An element with lists.
    order : str
        NumPy's character for the byte order.
    wanted : Property or None
        A list of integers; None to skip the element.

    Returns
    -------
    values : int64, shape (sum(sizes),)
    sizes : int64, shape (element.count,), or empty if nothing is wanted
    end : int

    Raises
    ------
    MalformedMeshError
        The element extends beyond the end of the data, or a list has a negative length.
    """
    lists = [p for p in element.properties if p.length]
    if wanted is not None and element.count and lists == [wanted]:
        table = _rows_of_equal_length(data, start, element, order, wanted)
        if table is not None:
            values = table[wanted.name].astype(np.int64)
            sizes = np.full(len(table), values.shape[1], dtype=np.int64)
            return values.ravel(), sizes, start + table.nbytes
    return _walk(data, start, element, order, wanted)


def _rows_of_equal_length(
    data: bytes, start: int, element: Element, order: str, only_list: Property
) -> np.ndarray[tuple[int], np.dtype[np.void]] | None:
    """Return the rows as one table if their lists all have the same length, else None."""
    before = element.properties[: element.properties.index(only_list)]
    at = start + sum(_size(p) for p in before)
    if at + np.dtype(only_list.length).itemsize > len(data):
        raise _cut_short(element)
    length = int(np.frombuffer(data, dtype=order + only_list.length, count=1, offset=at)[0])
    room = (len(data) - start) // element.count
    if not 0 <= length * _size(only_list) <= room:
        return None
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for p in element.properties:
        if p.length:
            fields += [("length of " + p.name, order + p.length), (p.name, order + p.value, (length,))]
        else:
            fields.append((p.name, order + p.value))
    row = np.dtype(fields)
    if row.itemsize > room:
        return None
    table = np.frombuffer(data, dtype=row, count=element.count, offset=start)
    return table if (table["length of " + only_list.name] == length).all() else None


def _walk(
    data: bytes, start: int, element: Element, order: str, wanted: Property | None
) -> tuple[Ints, Ints, int]:
    """Read row by row."""
    steps = [
        (struct.Struct(order + _LETTERS[p.length]) if p.length else None, _size(p), p is wanted)
        for p in element.properties
    ]
    letter = _LETTERS[wanted.value] if wanted else ""
    values, sizes = array("q"), array("q")
    position = start
    try:
        for _ in range(element.count):
            for length, size, is_wanted in steps:
                number = 1
                if length:
                    (number,) = length.unpack_from(data, position)
                    position += length.size
                    if number < 0:
                        raise MalformedMeshError("a list of the PLY has a negative length")
                if is_wanted:
                    values.extend(struct.unpack_from(f"{order}{number}{letter}", data, position))
                    sizes.append(number)
                position += number * size
    except (struct.error, OverflowError):
        raise _cut_short(element) from None
    if position > len(data):
        raise _cut_short(element)
    return np.array(values, dtype=np.int64), np.array(sizes, dtype=np.int64), position


def _size(p: Property) -> int:
    """Return the bytes of one value."""
    return np.dtype(p.value).itemsize


def _cut_short(element: Element) -> MalformedMeshError:
    return MalformedMeshError(
        f"the PLY declares {element.count} rows of {element.name} and ends before the last"
    )
