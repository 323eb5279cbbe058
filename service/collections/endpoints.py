"""The addresses under /collections."""

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response

from service.auth.keys import Grant
from service.collection import NAME
from service.collections import repository
from service.collections.schemas import Collection, Collections
from service.dependencies import Service
from service.http.middleware import GRANT_IN_SCOPE
from service.http.problems import documented

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
    grant: Grant | None = request.scope.get(GRANT_IN_SCOPE)
    limits = None if grant is None else grant.collections
    with container.database.read() as session:
        collections = repository.counted(session, limits)
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
