"""Text formats: normalised text, and its lines of coordinates and of indices."""

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice

import numpy as np

from core.arrays import Floats, Ints
from core.errors import MalformedMeshError

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
# Zeros and Control-Z, the end of a file for CP/M, which some writers add.
_PADDING = b"\0\x1a"
_MINUS_SIGN = "\N{MINUS SIGN}".encode()
# NaN and infinity as Microsoft's C library prints them, and the exponents of Fortran.
_NOT_FINITE = re.compile(rb"nan\([^)\s]*\)|1\.#(?:ind|[qs]nan|inf)\w*")
_EXPONENT = re.compile(rb"(?<=[0-9.])d(?=[-+]?[0-9])")
# One meaning for every byte: white space is a space, a tab or a newline, and what is not ASCII, which only
# names and comments may hold, is a question mark. Other readers break lines at other bytes.
_CLEAN = bytes(
    byte if byte in (9, 10) or 32 <= byte < 127 else (32 if byte < 32 else ord("?")) for byte in range(256)
)
# Faces taken at a time where they pass through Python's objects, which take ten times the memory of NumPy's.
_BLOCK = 65_536


def without_mark(data: bytes) -> bytes:
    """Return a file without its byte order mark, and in UTF-8 if the mark is that of UTF-16."""
    if data.startswith(_UTF_16):
        with suppress(UnicodeDecodeError):
            return data.decode("utf-16").encode()
    return data.removeprefix(_BYTE_ORDER_MARK)


def plain_text(data: bytes) -> bytes:
    r"""Return the text in ASCII with every line ended by \n; raise MalformedMeshError if it is not text."""
    text = without_mark(data).rstrip(_PADDING)
    if b"\0" in text:
        raise MalformedMeshError("the file has zero bytes where text is expected")
    text = text.replace(_MINUS_SIGN, b"-").replace(b"\r\n", b"\n").replace(b"\r", b"\n").translate(_CLEAN)
    return text if text.endswith(b"\n") else text + b"\n"


def rows(text: bytes, comment: bytes = b"") -> Iterator[bytes]:
    """Yield the lines that are not blank, without comments."""
    lines = io.BytesIO(text)
    if comment and comment in text:
        return (row for line in lines if (row := line.partition(comment)[0].rstrip()))
    return (line for line in lines if not line.isspace())


def take(lines: Iterator[bytes], count: int, things: str) -> list[bytes]:
    """Return the next `count` lines; raise MalformedMeshError if there are fewer."""
    taken = list(islice(lines, count))
    if len(taken) < count:
        raise MalformedMeshError(f"the file declares {count} {things} but ends after {len(taken)}")
    return taken


def coordinates(lines: list[bytes], columns: Sequence[int] = (0, 1, 2)) -> Floats:
    """Read coordinates, shape (n, number of columns), from lines of numbers.

    Numbers may be written as Fortran, Microsoft's C library or a language with decimal commas writes them.
    Raise MalformedMeshError if a line has fewer columns or a value is not a number.
    """
    if not lines:
        return np.empty((0, len(columns)))
    table = _columns(lines, columns)
    if table is None:
        table = _columns(_other_notation(lines), columns)
    if table is None:
        raise MalformedMeshError("a vertex has fewer than three coordinates, or one that is not a number")
    return table


def _columns(lines: list[bytes], columns: Sequence[int]) -> Floats | None:
    """Return columns of lines of numbers in the notation of C; None if there is a line without."""
    # NumPy leaves out blank lines, and a warning shows them if all lines are blank.
    if lines[0].strip():
        with suppress(ValueError):
            table = np.loadtxt(lines, dtype=np.float64, comments=None, usecols=columns, ndmin=2)
            if len(table) == len(lines):
                return table
    return None


def _other_notation(lines: list[bytes]) -> list[bytes]:
    """Return lines of numbers in the notation of C; commas are decimal where there are no points."""
    text = _EXPONENT.sub(b"e", _NOT_FINITE.sub(b"nan", b"\n".join(line.strip() for line in lines).lower()))
    text = text.replace(b", ", b" ").replace(b",\t", b" ").replace(b",\n", b"\n")
    return (text if b"." in text else text.replace(b",", b".")).split(b"\n")


def integers(tokens: Sequence[bytes]) -> Ints:
    """Parse decimal integers; raise MalformedMeshError for any other token."""
    try:
        # Python's own int would take 1_000 for a thousand.
        if b"_" not in b"".join(tokens):
            return np.fromiter(map(int, tokens), dtype=np.int64, count=len(tokens))
    except (ValueError, OverflowError):
        pass
    raise MalformedMeshError("a face has an index that is not a whole number")


def _table(lines: list[bytes]) -> Ints | None:
    """Return lines of integers as a table, shape (n, columns); None if the lines differ in length."""
    try:
        return np.loadtxt(lines, dtype=np.int64, comments=None, ndmin=2)
    except ValueError:
        return None


def polygons(lines: list[bytes]) -> tuple[Ints, Ints]:
    """Read lines of the corners of one polygon each: corners, shape (sum(sizes),), and sizes, shape (n,)."""
    table = _table(lines) if lines else None
    if table is not None:
        return table.ravel(), np.full(len(table), table.shape[1], dtype=np.int64)
    return _flatten(line.split() for line in lines)


def counted_polygons(lines: list[bytes], before: Sequence[bool] = ()) -> tuple[Ints, Ints]:
    """Read lines of a number of corners, the corners, and possibly more values, as `polygons` does.

    Before the number are other properties: `before` has True for a list with its length, and False for a
    single value. Raise MalformedMeshError if a line has fewer values than it declares, or not integers.
    """
    table = _table(lines) if lines and not any(before) else None
    if table is not None and len(before) < table.shape[1]:
        start, size = len(before) + 1, int(table[0, len(before)])
        if (table[:, start - 1] == size).all() and 0 <= size <= table.shape[1] - start:
            return table[:, start : start + size].ravel(), np.full(len(table), size, dtype=np.int64)
    return _flatten(_corners(line.split(), before) for line in lines)


def _flatten(rows: Iterator[list[bytes]]) -> tuple[Ints, Ints]:
    """Return the numbers of all rows in sequence, and the number of values in each row."""
    numbers: list[Ints] = [np.zeros(0, dtype=np.int64)]
    sizes: list[int] = []
    while block := list(islice(rows, _BLOCK)):
        sizes += [len(row) for row in block]
        numbers.append(integers([token for row in block for token in row]))
    return np.concatenate(numbers), np.array(sizes, dtype=np.int64)


def _corners(row: list[bytes], before: Sequence[bool]) -> list[bytes]:
    """Return the corners in a row, after their number."""
    position = 0
    for is_list in before:
        position += 1 + (_number(row, position) if is_list else 0)
    end = position + 1 + _number(row, position)
    if len(row) < end:
        raise MalformedMeshError("a face lists fewer corners than it says")
    return row[position + 1 : end]


def without_lists(row: list[bytes], is_list: Sequence[bool]) -> list[bytes]:
    """Return the single values of a row in which others are lists, each with its length."""
    single: list[bytes] = []
    position = 0
    for listed in is_list:
        if listed:
            position += 1 + _number(row, position)
        else:
            single += row[position : position + 1]
            position += 1
    return single + row[position:]


def _number(row: list[bytes], position: int) -> int:
    """Return the length of a list, from `position` in a row."""
    if position >= len(row) or not row[position].isdigit():
        raise MalformedMeshError("a face does not say how many corners it has")
    return int(row[position])


def face_lines(faces: Ints, form: str) -> bytes:
    """Write one line for each face; `form` has a %d for each corner and ends with a newline."""
    blocks = (faces[start : start + _BLOCK] for start in range(0, len(faces), _BLOCK))
    return b"".join((form * len(block) % tuple(block.ravel().tolist())).encode() for block in blocks)


def vertex_lines(vertices: Floats, form: str) -> bytes:
    """Write one line for each vertex; `form` has a %r for each coordinate and ends with a newline.

    trimesh writes a fixed number of decimals, which is too few for small units.
    """
    return (form * len(vertices) % tuple(vertices.ravel().tolist())).encode()
