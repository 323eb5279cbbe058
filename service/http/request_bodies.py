"""Bodies and parameters of requests as dependencies: a form with files, or JSON, in; a pydantic model out."""

from collections.abc import AsyncIterator
from typing import Any, Generic, Literal, TypeVar, get_origin

from fastapi import Request
from fastapi.params import Depends
from pydantic import BaseModel, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema
from python_multipart.multipart import parse_options_header
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData

from service.errors import BadRequestFieldsError, FieldFault, FileTooLargeError, UnsupportedBodyError
from service.http.problem_document import faults_of
from service.settings import Settings
from service.storage.files import disk_errors

FORM, JSON = "multipart/form-data", "application/json"
FILE = "file"
FIELD_BYTES = 64 * 1024
# Fields beside the file: a query may exclude 500 shapes and name 32 tags and 32 values of metadata.
FORM_FIELDS = 640
# Several times the text of the longest query: 500 ids, 32 tags and 32 values of metadata.
TEXT_CHARACTERS = 256 * 1024
# Names of the one character set of forms (RFC 7578, section 5.1.2).
CHARSETS = {b"utf-8", b"utf8"}

Model = TypeVar("Model", bound=BaseModel)


class RequestBody(Generic[Model]):
    """A dependency that reads the body of a request into a model.

    FastAPI's own form parameters do not fit here: FastAPI reads the whole body before it calls the first
    dependency, which would store an upload that the service then refuses, and it takes one media type for an
    operation.

    Parameters
    ----------
    form : type of model
        The form. Its field `file` holds files, unless `either` names others; a list may be repeated.
    json : type of model, optional
        The JSON object that the operation takes as well.
    limit : str
        The setting that has the largest size of a file, in bytes.
    either : tuple of str
        Fields of the form that hold a file or text, in the place of the one file.
    most_files : int
        The most files of the form. The limit is that of all together.
    """

    def __init__(
        self,
        form: type[Model],
        *,
        json: type[Model] | None = None,
        limit: Literal["max_upload_bytes", "max_archive_bytes"] = "max_upload_bytes",
        either: tuple[str, ...] = (),
        most_files: int = 1,
    ) -> None:
        self._form = form
        self._either = either
        self._json = json
        self._limit = limit
        self._most_files = len(either) or most_files

    async def __call__(self, request: Request) -> AsyncIterator[Model]:
        """Yield the model. A large file of the form is on disk, and is closed when the endpoint has ended.

        Raise UnsupportedBodyError if the body has another media type, or a form another character set than
        UTF-8; BadRequestFieldsError if it is not what the model says; FileTooLargeError if the file is larger
        than the setting allows, or the other fields have too much text together; and StorageFullError or
        StorageUnavailableError if the file cannot be written to the temporary folder.
        """
        content_type = request.headers.get("content-type", "")
        media_type = content_type.partition(";")[0].strip().lower()
        if media_type == FORM:
            _check_charset(content_type)
            settings: Settings = request.app.state.settings
            form = await _form_of(request, self._most_files)
            try:
                values = _values(form, self._form, self._either, getattr(settings, self._limit))
                # In a thread: other requests go on meanwhile.
                yield await run_in_threadpool(_validated, self._form, values)
            finally:
                await form.close()
        elif media_type == JSON and self._json is not None:
            yield await run_in_threadpool(_validated, self._json, await _object_of(request))
        else:
            others = "" if self._json is None else ", or JSON"
            fields = " and ".join(repr(name) for name in self._either)
            files = f"a file or text in {fields}" if fields else f"the file in the field {FILE!r}"
            raise UnsupportedBodyError(f"the body must be {FORM} with {files}{others}")

    @property
    def openapi(self) -> dict[str, Any]:
        """The operation's part of the OpenAPI document, as `openapi_extra`."""
        content = {FORM: {"schema": self._form.model_json_schema(schema_generator=_FormSchema)}}
        if self._json is not None:
            content[JSON] = {"schema": _inlined(self._json.model_json_schema())}
        return {"requestBody": {"required": True, "content": content}}


def _inlined(schema: dict[str, Any]) -> Any:  # noqa: ANN401
    """Return a JSON schema with its definitions in the place of references, which lead nowhere elsewhere."""
    definitions = schema.pop("$defs", {})

    def inlined(value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, dict):
            reference = value.get("$ref", "").removeprefix("#/$defs/")
            inner = definitions.get(reference, {}) | {
                name: each for name, each in value.items() if name != "$ref"
            }
            return {name: inlined(each) for name, each in (inner if reference else value).items()}
        return [inlined(each) for each in value] if isinstance(value, list) else value

    return inlined(schema)


class _FormSchema(GenerateJsonSchema):
    """The JSON schema of a form, which has no null: a field is left out instead."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """Return the schema of the values other than null."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Return the schema, without a default of null."""
        described = super().default_schema(schema)
        return {key: value for key, value in described.items() if (key, value) != ("default", None)}


def _check_charset(content_type: str) -> None:
    """Refuse a form that names a character set other than UTF-8.

    Starlette would decode the form by any codec of Python on the event loop; the time of some codecs grows
    with the square of the length.
    """
    # The parser that Starlette uses, so that both find the same parameter.
    _, options = parse_options_header(content_type)
    charset = options.get(b"charset", b"utf-8")
    if charset.lower() not in CHARSETS:
        raise UnsupportedBodyError(f"forms are read as UTF-8, not as {charset.decode('latin-1')[:40]!r}")


async def _form_of(request: Request, max_files: int) -> FormData:
    with disk_errors("the upload cannot be written to the temporary folder"):
        return await request.form(max_files=max_files, max_fields=FORM_FIELDS, max_part_size=FIELD_BYTES)


def _values(
    form: FormData, model: type[BaseModel], either: tuple[str, ...], max_bytes: int
) -> dict[str, Any]:
    """Return the values of a form's fields, of which lists alone may be repeated.

    The fields `either` hold a file or text; if there are none, the field `file` holds the one file.
    """
    files = either or (FILE,)
    characters = 0
    for name, value in form.multi_items():
        if isinstance(value, str):
            characters += len(name) + len(value)
            if characters > TEXT_CHARACTERS:
                raise FileTooLargeError(f"at most {TEXT_CHARACTERS} characters of text are taken in a form")
            continue
        if name not in files:
            fields = " or ".join(repr(each) for each in files)
            raise BadRequestFieldsError(FieldFault(name, f"a file is expected in the field {fields} only"))
        if (value.size or 0) > max_bytes:
            raise FileTooLargeError(f"the file has {value.size} bytes; at most {max_bytes} bytes are taken")
    if not either and isinstance(form.get(FILE, ""), str):
        raise BadRequestFieldsError(FieldFault(FILE, "a file, with its name, is required"))
    lists = _lists(model)
    values = {name: form.getlist(name) for name in form}
    single = model.model_fields.keys() - lists
    repeated = [name for name in values if name in single and len(values[name]) > 1]
    if repeated:
        raise BadRequestFieldsError(*(FieldFault(name, "given more than once") for name in repeated))
    return {name: given if name in lists else given[0] for name, given in values.items()}


async def _object_of(request: Request) -> dict[str, Any]:
    try:
        value = await request.json()
    except (ValueError, RecursionError) as error:
        raise BadRequestFieldsError(FieldFault("body", f"not JSON: {error}")) from error
    if not isinstance(value, dict):
        raise BadRequestFieldsError(FieldFault("body", "must be a JSON object"))
    return value


def _validated(model: type[Model], values: dict[str, Any]) -> Model:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise BadRequestFieldsError(*faults_of(error.errors())) from error


def once(*names: str) -> Depends:
    """Return a dependency that refuses repetitions of a parameter; FastAPI takes the last value."""

    async def refuse_repetitions(request: Request) -> None:
        repeated = sorted(name for name in set(names) if len(request.query_params.getlist(name)) > 1)
        if repeated:
            raise BadRequestFieldsError(*(FieldFault(name, "given more than once") for name in repeated))

    return Depends(refuse_repetitions)


def once_each(model: type[BaseModel]) -> Depends:
    """Return the same for a model of query parameters: for every field that is not a list."""
    return once(*(model.model_fields.keys() - _lists(model)))


def _lists(model: type[BaseModel]) -> set[str]:
    return {name for name, field in model.model_fields.items() if get_origin(field.annotation) is list}
