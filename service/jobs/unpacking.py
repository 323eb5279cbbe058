"""Decompression of streams, piece by piece, with limits on the bytes that come out; headers are not trusted.

The file classes of the standard library are not used: they do not limit the memory of xz, and they read the
header of a gzip stream byte by byte, however long it is.
"""

import bz2
import lzma
import zlib
from collections.abc import Callable
from typing import Protocol

from service.jobs.errors import ArchiveTooLargeError, MalformedArchiveError, MemberTooLargeError
from service.jobs.members import PIECE, ArchiveFile, ArchiveLimits

XZ_MEMORY_BYTES = 128 * 1024**2
"""The memory limit of xz, twice the need of files by `xz -9`."""

MOST_STREAMS = 100_000
"""The most streams in one file, enough for the largest archive in streams of 64 KiB."""

# The tar reader seeks back by one header at most.
KEPT = 1024


class Unpacker(Protocol):
    """A decompressor of one stream."""

    @property
    def eof(self) -> bool:
        """Whether the stream has ended."""

    @property
    def unused_data(self) -> bytes:
        """The bytes after the end of the stream."""

    @property
    def hungry(self) -> bool:
        """Whether the decompressor needs input."""

    def unpack(self, data: bytes) -> tuple[bytes, bytes]:
        """At most `PIECE` unpacked bytes, and the unused input."""


class _Gzip:
    def __init__(self) -> None:
        self._stream = zlib.decompressobj(wbits=31)

    @property
    def eof(self) -> bool:
        return self._stream.eof

    @property
    def unused_data(self) -> bytes:
        return self._stream.unused_data

    @property
    def hungry(self) -> bool:
        return True

    def unpack(self, data: bytes) -> tuple[bytes, bytes]:
        return self._stream.decompress(data, PIECE), self._stream.unconsumed_tail


class _Buffering:
    """A decompressor of bz2 or lzma, which buffers unused input itself."""

    def __init__(self, stream: bz2.BZ2Decompressor | lzma.LZMADecompressor) -> None:
        self._stream = stream

    @property
    def eof(self) -> bool:
        return self._stream.eof

    @property
    def unused_data(self) -> bytes:
        return self._stream.unused_data

    @property
    def hungry(self) -> bool:
        return self._stream.needs_input

    def unpack(self, data: bytes) -> tuple[bytes, bytes]:
        return self._stream.decompress(data, PIECE), b""


UNPACKERS: dict[str, Callable[[], Unpacker]] = {
    "tar.gz": _Gzip,
    "tar.bz2": lambda: _Buffering(bz2.BZ2Decompressor()),
    "tar.xz": lambda: _Buffering(lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=XZ_MEMORY_BYTES)),
}


class UnpackedStream:
    """A compressed file as a file of its content, read forwards.

    Parameters
    ----------
    packed : ArchiveFile
        The compressed file, at its beginning.
    make : callable or None
        Creates an `Unpacker` for each of the concatenated streams; None if the file is not compressed.
    limits : ArchiveLimits
        Limits of the total size and of the compression ratio.

    `allowance` is the number of bytes that may be read before it is set again; seeking does not reduce it.
    Reading and seeking raise `MalformedArchiveError` or `ArchiveTooLargeError`.
    """

    def __init__(
        self, packed: ArchiveFile, make: Callable[[], Unpacker] | None, limits: ArchiveLimits
    ) -> None:
        self._packed = packed
        self._make = make
        self._limits = limits
        self._unpacker = None if make is None else make()
        self._streams = 1
        self._left = b""
        self._taken = self._made = 0
        # The last piece behind the end of the previous one, and the position where they begin.
        self._piece, self._start = b"", 0
        self._position = 0
        self.allowance = 0

    def tell(self) -> int:
        """The position in the unpacked content."""
        return self._position

    def seek(self, position: int, whence: int = 0) -> int:
        """Go to a later position, or to a slightly earlier one."""
        if whence != 0 or position < self._start:
            raise MalformedArchiveError("a member of the archive overlaps another one")
        while position > self._start + len(self._piece) and self._advance():
            pass
        self._position = position
        return position

    def read(self, size: int) -> bytes:
        """Read `size` bytes, or fewer at the end."""
        if not 0 <= size <= self.allowance:
            raise MalformedArchiveError("a header in the archive is too long")
        self.allowance -= size
        got = bytearray()
        while len(got) < size:
            offset = self._position - self._start
            part = self._piece[offset : offset + size - len(got)]
            if part:
                got += part
                self._position += len(part)
            elif offset > len(self._piece) or not self._advance():
                break
        return bytes(got)

    def _advance(self) -> bool:
        """Unpack the next piece; False at the end."""
        try:
            new = self._next_piece()
        except (zlib.error, lzma.LZMAError, OSError, EOFError, ValueError) as error:
            raise MalformedArchiveError(f"the archive cannot be unpacked: {error}") from error
        self._made += len(new)
        if self._made > self._limits.total_bytes:
            raise ArchiveTooLargeError(f"it unpacks to more than {self._limits.total_bytes} bytes")
        if self._make is not None:
            try:
                self._limits.check_ratio(self._made, self._taken)
            except MemberTooLargeError as error:
                raise ArchiveTooLargeError(str(error)) from error
        kept = self._piece[-KEPT:]
        self._start += len(self._piece) - len(kept)
        self._piece = kept + new
        return bool(new)

    def _next_piece(self) -> bytes:
        if self._make is None or self._unpacker is None:
            return self._take()
        while True:
            if self._unpacker.eof:
                # Streams may be concatenated and padded.
                self._left = (self._unpacker.unused_data or self._left).lstrip(b"\0")
                while not self._left:
                    taken = self._take()
                    if not taken:
                        return b""
                    self._left = taken.lstrip(b"\0")
                self._unpacker = self._make()
                self._streams += 1
                if self._streams > MOST_STREAMS:
                    raise ValueError(f"it has more than {MOST_STREAMS} streams")
            hungry = self._unpacker.hungry
            data = self._left or (self._take() if hungry else b"")
            piece, self._left = self._unpacker.unpack(data)
            if piece:
                return piece
            if hungry and not data and not self._unpacker.eof:
                raise EOFError("it ends in the middle")

    def _take(self) -> bytes:
        taken = self._packed.read(PIECE)
        self._taken += len(taken)
        return taken
