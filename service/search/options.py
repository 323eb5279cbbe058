"""Queries as clients write them: a file or the id of a stored shape, and how to search."""

from dataclasses import replace

from pydantic import ConfigDict, Field

from service.collection import CollectionNumber
from service.collections.dependencies import NamedInAddress
from service.search.records import Options
from service.search.schemas import QueryOptions
from service.settings import Settings
from service.shapes.schemas import SHAPE
from service.shapes.uploads import MeshUpload


class QueryParameters(NamedInAddress, QueryOptions):
    """Options of a search, as query parameters."""


class FileQuery(QueryOptions, MeshUpload):
    """A query with a mesh file."""


class StoredQuery(QueryOptions):
    """A query with a stored shape."""

    model_config = ConfigDict(json_schema_extra={"example": {"shape_id": SHAPE["id"], "top_k": 3}})

    shape_id: str = Field(description="The id of the shape to search with.", max_length=64)


def merged(body: QueryOptions, address: QueryParameters) -> QueryOptions:
    """The options of a body, and where the body does not give an option, that of the address."""
    given = address.model_fields_set & QueryOptions.model_fields.keys() - body.model_fields_set
    return body.model_copy(update={name: getattr(address, name) for name in given})


def search_options(
    given: QueryOptions, collection: CollectionNumber, settings: Settings, *, exclude_self: bool
) -> Options:
    """Options of the search of a collection.

    Parameters
    ----------
    given : QueryOptions
    collection : CollectionNumber
    settings : Settings
        They have the lengths of the shortlists.
    exclude_self : bool
        Whether to leave out the query itself where the client does not say.

    Raises
    ------
    BadRequestFieldsError
        A filter by metadata is not written key=value.
    """
    shapes = given.filtered(collection)
    return Options(
        top_k=given.top_k,
        rank_by=given.rank_by,
        exhaustive=given.exhaustive,
        filter=replace(shapes, tags=(*given.tag, *given.filter), excluded=tuple(given.exclude)),
        exclude_self=exclude_self if given.exclude_self is None else given.exclude_self,
        min_cc=-1.0 if given.min_cc is None else given.min_cc,
        sizes=1.0 + given.size_tolerance if given.scale == "respect" else None,
        correspondences=given.correspondences,
        embedding=given.embedding,
        shortlist_from=settings.shortlist_from,
        shortlist_length=settings.shortlist_length,
        reranked=settings.reranked,
        finalists=settings.finalists,
    )
