"""Reading a form with one file."""

import errno
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import BinaryIO

from fastapi import Request
from starlette.datastructures import FormData, UploadFile

from service.errors import (
    BadRequestFieldsError,
    FieldFault,
    FileTooLargeError,
    StorageFullError,
    UnsupportedBodyError,
)

FIELD_BYTES = 64 * 1024


@dataclass(frozen=True)
class Form:
    """A form of one file and text fields.

    Attributes
    ----------
    filename : str
        As the client gave it: never a path to open.
    fields : dict
        The values of each text field, in order.
    """

    filename: str
    fields: dict[str, list[str]]
    _file: UploadFile

    @property
    def size(self) -> int:
        """How many bytes the file has."""
        return self._file.size or 0

    @property
    def spooled(self) -> BinaryIO:
        """The file, on disk if it is large: for threads, and until the end of the block."""
        return self._file.file

    async def bytes(self) -> bytes:
        """The bytes of the file."""
        return await self._file.read()


@asynccontextmanager
async def uploaded(request: Request, *, max_bytes: int, max_fields: int) -> AsyncIterator[Form]:
    """The form in a request, whose large file lies on disk until the end of the block.

    Raises
    ------
    UnsupportedBodyError
        The body is not multipart/form-data.
    BadRequestFieldsError
        There is no file in the field `file`, or a file in another.
    FileTooLargeError
        The file has more than `max_bytes`.
    StorageFullError
        There is no room on disk for the file.
    """
    if not is_form(request):
        raise UnsupportedBodyError("the body must be multipart/form-data with the file in the field 'file'")
    form = await _parsed(request, max_fields=max_fields)
    try:
        file: UploadFile | None = None
        fields: dict[str, list[str]] = {}
        for name, value in form.multi_items():
            if isinstance(value, str):
                fields.setdefault(name, []).append(value)
            elif name == "file":
                file = value
            else:
                raise BadRequestFieldsError(FieldFault(name, "a file is expected in the field 'file' only"))
        if file is None:
            raise BadRequestFieldsError(FieldFault("file", "a file, with its name, is required"))
        if (file.size or 0) > max_bytes:
            raise FileTooLargeError(f"the file has {file.size} bytes; at most {max_bytes} bytes are taken")
        yield Form(file.filename or "", fields, file)
    finally:
        await form.close()


async def _parsed(request: Request, *, max_fields: int) -> FormData:
    try:
        return await request.form(max_files=1, max_fields=max_fields, max_part_size=FIELD_BYTES)
    except OSError as error:
        if error.errno in {errno.ENOSPC, errno.EDQUOT}:
            raise StorageFullError("there is no room for the upload in the temporary folder") from error
        raise


def is_form(request: Request) -> bool:
    """Whether the body says that it is multipart/form-data."""
    return _media_type(request) == "multipart/form-data"


def is_json(request: Request) -> bool:
    """Whether the body says that it is JSON."""
    return _media_type(request) == "application/json"


def _media_type(request: Request) -> str:
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


def single(fields: dict[str, list[str]], name: str) -> str | None:
    """The value of a field that may be given once, or None.

    Raises
    ------
    BadRequestFieldsError
        It was given more than once.
    """
    values = fields.get(name, [])
    if len(values) > 1:
        raise BadRequestFieldsError(FieldFault(name, "given more than once"))
    return values[0] if values else None
