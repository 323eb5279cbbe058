"""The collection of a request, chosen by its header or parameter and by its key."""

from typing import Annotated

from fastapi import Depends, Header, Query, Request
from pydantic import BaseModel, Field

from service.auth.keys import Grant
from service.collection import DEFAULT_COLLECTION, NAME, CollectionRecord
from service.collections import repository
from service.dependencies import Service
from service.errors import BadRequestFieldsError, FieldFault, ForbiddenError
from service.http.middleware import COLLECTION_IN_SCOPE, GRANT_IN_SCOPE
from service.http.request_bodies import once

HEADER, PARAMETER = "Isoshape-Collection", "collection"

PROBLEMS = ("bad-request-fields", "collection-not-found", "forbidden")
"""The problems of every endpoint that works in a collection."""

_ABOUT = "The collection of the request; by default `default`."
_PATTERN = f"^{NAME}$"

Named = Annotated[
    str | None, Query(alias=PARAMETER, description=_ABOUT, json_schema_extra={"pattern": _PATTERN})
]
NamedByHeader = Annotated[
    str | None,
    Header(
        alias=HEADER,
        description="The collection of the request; if the parameter is given too, both must be equal.",
        json_schema_extra={"pattern": _PATTERN},
    ),
]


class NamedInAddress(BaseModel):
    """The parameter `collection`, for models that list all query parameters of an address."""

    collection: str | None = Field(default=None, description=_ABOUT, json_schema_extra={"pattern": _PATTERN})


async def _chosen(
    request: Request,
    container: Service,
    _once: Annotated[None, once(PARAMETER)],
    _named: Named = None,
    _by_header: NamedByHeader = None,
) -> CollectionRecord:
    # FastAPI treats an empty value as missing; here it is a name that no collection has.
    names = {*request.headers.getlist(HEADER), *request.query_params.getlist(PARAMETER)}
    if len(names) > 1:
        raise BadRequestFieldsError(
            FieldFault(
                PARAMETER,
                f"{HEADER} and the parameter name different collections: {', '.join(sorted(names))}",
            )
        )
    grant: Grant | None = request.scope.get(GRANT_IN_SCOPE)
    name = allowed(None if grant is None else grant.collections, names.pop() if names else None)

    collection = DEFAULT_COLLECTION
    if name != DEFAULT_COLLECTION.name:
        collection = await container.database.reading(repository.get, name)
    request.scope[COLLECTION_IN_SCOPE] = collection.name
    return collection


def allowed(limits: frozenset[str] | None, named: str | None) -> str:
    """Return the name of a request's collection.

    Parameters
    ----------
    limits : frozenset of str or None
        Names of the collections that the key may use; None allows all.
    named : str or None
        The collection that the request names.

    Raises
    ------
    ForbiddenError
        The key may not use the collection.
    BadRequestFieldsError
        The request names none, and the key allows several, but not the default one.
    """
    if limits is None or named in limits:
        return DEFAULT_COLLECTION.name if named is None else named
    if named is not None:
        raise ForbiddenError(f"the key may not use the collection {named!r}")
    if DEFAULT_COLLECTION.name in limits:
        return DEFAULT_COLLECTION.name
    if len(limits) > 1:
        raise BadRequestFieldsError(
            FieldFault(PARAMETER, f"name one that the key may use: {', '.join(sorted(limits))}")
        )
    (only,) = limits
    return only


def address(path: str, collection: CollectionRecord) -> str:
    """Return the address of a resource in a collection, valid for every key that may use it."""
    return path if collection == DEFAULT_COLLECTION else f"{path}?{PARAMETER}={collection.name}"


InCollection = Annotated[CollectionRecord, Depends(_chosen)]
"""The parameter type of endpoints that work in a collection."""
