"""The addresses under /collections, and the collection of a request: by its header, parameter and key."""

from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Path, Query, Request, Response
from pydantic import BaseModel, Field

from service.auth.keys import Grant
from service.collection import DEFAULT_COLLECTION, NAME, Collection, CollectionRecord, Collections
from service.collections import repository
from service.container import Service
from service.errors import BadRequestFieldsError, FieldFault, ForbiddenError
from service.http.middleware import COLLECTION_IN_SCOPE, GRANT_IN_SCOPE
from service.http.problems import documented
from service.http.request_bodies import once
from service.storage.database import ReadSession

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
    name = allowed(limits_of(request), names.pop() if names else None)

    collection = DEFAULT_COLLECTION
    if name != DEFAULT_COLLECTION.name:
        collection = await container.database.reading(repository.get, name)
    request.scope[COLLECTION_IN_SCOPE] = collection.name
    grant: Grant | None = request.scope.get(GRANT_IN_SCOPE)
    return replace(collection, shows_paths=grant is not None and grant.shows_paths)


def limits_of(request: Request) -> frozenset[str] | None:
    """Return the names of the collections that the key of a request may use; None allows all."""
    grant: Grant | None = request.scope.get(GRANT_IN_SCOPE)
    return None if grant is None else grant.collections


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


def named_too(session: ReadSession, request: Request, name: str) -> CollectionRecord:
    """Return a collection that a request names beside its own.

    Raise CollectionNotFoundError or ForbiddenError if there is none of the name, or the key may not use it.
    """
    return repository.get(session, allowed(limits_of(request), name))


def address(path: str, collection: CollectionRecord) -> str:
    """Return the address of a resource in a collection, valid for every key that may use it."""
    return path if collection == DEFAULT_COLLECTION else f"{path}?{PARAMETER}={collection.name}"


InCollection = Annotated[CollectionRecord, Depends(_chosen)]
"""The parameter type of endpoints that work in a collection."""


router = APIRouter(tags=["collections"])

Name = Annotated[
    str,
    Path(
        description="1 to 64 of a-z, 0-9, _ and -, of which the first is a letter or a digit.",
        json_schema_extra={"pattern": f"^{NAME}$"},
    ),
]


@router.get("/collections", summary="List collections", responses=documented("storage-unavailable"))
def list_collections(request: Request, container: Service) -> Collections:
    """Return the collections that the key may use, by name, each with the number of its shapes."""
    with container.database.read() as session:
        collections = repository.counted(session, limits_of(request))
    return Collections(collections=[Collection.model_validate(each) for each in collections])


@router.put(
    "/collections/{name}",
    summary="Make a collection",
    response_model=Collection,
    response_description="It is there already.",
    responses={
        201: {"model": Collection, "description": "Made, and empty."},
        **documented("bad-request-fields", "storage-unavailable", "storage-full"),
    },
)
def create_collection(name: Name, container: Service, response: Response) -> Collection:
    """Have a collection of this name, so that calls can name it; shapes come into it by calls that do."""
    with container.database.write() as session:
        if repository.create(session, name):
            response.status_code = 201
        (collection,) = repository.counted(session, {name})
    return Collection.model_validate(collection)


@router.delete(
    "/collections/{name}",
    status_code=204,
    summary="Delete a collection",
    responses=documented(
        "bad-request-fields",
        "collection-not-found",
        "collection-not-empty",
        "storage-unavailable",
        "storage-full",
    ),
)
def delete_collection(name: Name, container: Service) -> None:
    """Delete a collection that has no shapes. `default` is always there."""
    with container.database.write(deleting=True) as session:
        repository.remove(session, name, container.settings.undo_time)
