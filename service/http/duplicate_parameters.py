"""Query parameters that are given more often than the OpenAPI document says."""

from collections.abc import Callable, Coroutine
from typing import Any, get_origin

from fastapi import Request
from fastapi.params import Depends
from pydantic import BaseModel

from service.errors import BadRequestFieldsError, FieldFault


def once(*names: str) -> Depends:
    """A dependency that refuses to have one of these parameters repeated; FastAPI takes the last value."""
    return Depends(_refusing(frozenset(names)))


def once_each(model: type[BaseModel]) -> Depends:
    """The same for a model of query parameters: for every field that is not a list."""
    fields = model.model_fields.items()
    return once(*(name for name, field in fields if get_origin(field.annotation) is not list))


def _refusing(names: frozenset[str]) -> Callable[[Request], Coroutine[Any, Any, None]]:
    async def refuse_duplicates(request: Request) -> None:
        repeated = sorted(name for name in names if len(request.query_params.getlist(name)) > 1)
        if repeated:
            raise BadRequestFieldsError(*(FieldFault(name, "given more than once") for name in repeated))

    return refuse_duplicates
