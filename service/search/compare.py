"""The address /compare: two shapes, stored or sent, point by point or vertex by vertex."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Depends, Query, Request, Response, UploadFile
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from core.arrays import Floats
from core.dense.functional_maps import FINE, FUNCTIONS
from core.dense.transfer import OffSurfaceError
from core.descriptors.registry import descriptors_of
from core.embedding import Embedding, Match, Scores
from core.io import format_of
from core.mesh.mesh import Mesh
from core.parameters import Parameters
from core.ranking.class_probability import combined_scores
from core.ranking.shortlist import spectral_distances
from core.registration.similarity import Similarity, similarity_of
from service.collection import CollectionNumber
from service.collections.endpoints import InCollection, NamedInAddress
from service.compute import tasks
from service.container import Container, Service
from service.errors import BadRequestFieldsError, FieldFault
from service.http.middleware import while_connected
from service.http.problems import FILE_PROBLEMS, documented
from service.http.request_bodies import RequestBody, once_each
from service.index.cache import CollectionSample
from service.observability.metrics import Timings
from service.pipelines.active import ActivePipeline
from service.rendering import tasks as rendering
from service.rendering.colours import Paint
from service.rendering.tasks import FACES, MEDIA_TYPE, ShownMesh
from service.search.answer import with_active_pipeline
from service.search.caches import collection_sample
from service.search.compare_schemas import DENSE, CompareAnswer, CompareRequest, dense_fields, map_fields
from service.search.endpoints import WORK_PROBLEMS
from service.search.likeness import relation_of, stored_mesh
from service.search.records import ReadMesh, Surface, once
from service.search.schemas import pairs
from service.search.transfer_schemas import TRANSFER, FormLandmarks, FormTransfer, Transfer
from service.search.transfers import answer_of, landmarks_of, wanted_of
from service.shapes import file_repository
from service.shapes import service as shapes_service
from service.shapes.endpoints import ENDINGS_IN_WORDS
from service.shapes.fields import Id, base_name
from service.storage.database import ReadSession
from service.web.endpoints import viewing_page

router = APIRouter(tags=["search"])

ZIP, PNG = "application/zip", "image/png"

PICTURE_SIZE = 512
"""Height of the picture of a comparison, in pixels."""

IdOrFile = Annotated[
    UploadFile | Id, Field(description=f"A mesh file, or the id of a stored shape. {ENDINGS_IN_WORDS}")
]


class CompareForm(BaseModel):
    """Two shapes to compare, each a file or the id of a stored shape."""

    model_config = ConfigDict(extra="forbid")

    first: IdOrFile
    second: IdOrFile
    dense: bool | None = Field(default=None, description=DENSE)
    landmarks: FormLandmarks | None = None
    transfer: FormTransfer | None = Field(default=None, description=TRANSFER)


class CompareParameters(NamedInAddress):
    """Options of a comparison, as query parameters."""

    format: Literal["json", "glb", "html", "npz", "png"] = Field(
        default="json",
        description="glb: both meshes side by side, with corresponding points in equal colours. html: a "
        "page with the two shapes, for a browser that may read them from this service. npz, with dense: a "
        "NumPy archive of the arrays vertices, confidence, stretch, partnered and, where there is one, "
        "displacement, and of the number of maps. png, with dense: a picture of both shapes.",
    )
    dense: bool = Field(default=False, description=DENSE)
    paint: Paint = Field(
        default="correspondence",
        description="With dense, the colours of the GLB and of the picture. correspondence: by position on "
        "the first shape; places of the second without a partner are grey. difference: from grey over orange "
        "to brown; of rigid shapes, in the frame of the first, by the distance from the other surface, grey "
        "where the errors of the meshes explain it. The extras of each node of a GLB have the quantity "
        "distance, the largest distance and the maximum of the scale, in units of the first and at its size, "
        "the size of the second over that of the first, and whether the two are registered as copies or "
        "variants. Of bodies that bend, by the quantity stretch; places "
        "without a partner are blue.",
    )


BODY = RequestBody[CompareForm | CompareRequest](CompareForm, json=CompareRequest, either=("first", "second"))


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedShape(Surface):
    """One of two shapes that are compared, with its name and the format of its file."""

    name: str
    format: str
    mesh: ReadMesh


@router.post(
    "/compare",
    summary="Compare two shapes",
    response_model=CompareAnswer,
    dependencies=[once_each(CompareParameters)],
    responses={
        200: {
            "description": "The scores and the corresponding points, with `dense` of all vertices; or a GLB, "
            "a page or a picture with both shapes, or a NumPy archive.",
            "content": {
                MEDIA_TYPE: {"schema": {"type": "string", "contentMediaType": MEDIA_TYPE}},
                "text/html": {"schema": {"type": "string"}},
                PNG: {"schema": {"type": "string", "contentMediaType": PNG}},
                ZIP: {"schema": {"type": "string", "contentMediaType": ZIP}},
            },
        },
        **documented(*FILE_PROBLEMS, *WORK_PROBLEMS, "storage-full"),
    },
    openapi_extra=BODY.openapi,
)
async def compare(
    request: Request,
    container: Service,
    collection: InCollection,
    options: Annotated[CompareParameters, Query()],
    body: Annotated[CompareForm | CompareRequest, Depends(BODY, scope="function")],
) -> Response | BaseModel:
    """Compare two shapes, stored or sent: their scores and their corresponding points.

    With `dense`, also the vertex of the second shape that corresponds to each vertex of the first, and where
    the two shapes differ. `landmarks` steer the correspondence, and `transfer` has points, curves and values
    that it carries from the first shape to the second. A shape is given by its id, or, in a form, by a file
    in the place of the id.
    """
    dense = _dense_option(body, options)
    if options.format == "html" and not (isinstance(body.first, str) and isinstance(body.second, str)):
        raise BadRequestFieldsError(FieldFault("format", "html shows stored shapes, given by their ids"))
    timings = Timings()
    work = partial(_compare, container, collection.number, body, options, timings, dense=dense)
    async with container.queue.admitted(request):
        answer = await while_connected(request, with_active_pipeline(container, work))
    container.metrics.stages("compare", timings.milliseconds)
    if options.format == "html" and isinstance(body.first, str) and isinstance(body.second, str):
        return viewing_page(first=body.first, second=body.second, collection=collection.name)
    return answer


async def _compare(
    container: Container,
    collection: CollectionNumber,
    body: CompareForm | CompareRequest,
    options: CompareParameters,
    timings: Timings,
    active_pipeline: ActivePipeline,
    *,
    dense: bool,
) -> Response | BaseModel:
    """Compare two shapes and write the answer in the form that the options name.

    Stages: read or embed both shapes; match them; tell their likeness; with `dense`, find the partner of each
    vertex; draw.
    """
    first, second = [
        await _compared_shape(container, collection, given, active_pipeline, timings)
        for given in (body.first, body.second)
    ]
    pipeline = active_pipeline.pipeline
    parameters = pipeline.parameters
    with timings.stage("read"):
        reading = container.database.reading
        sample = await reading(collection_sample, container, active_pipeline, collection)
    with timings.stage("compare"):
        records = first.record, second.record
        match = await container.queue.compare(tasks.match_embeddings, *records, parameters)
        combined = await run_in_threadpool(_combined, first.embedding, second.embedding, match, sample)
    with timings.stage("likeness"):
        signatures = first.embedding.signature, second.embedding.signature[None]
        relation = await relation_of(
            container,
            first,
            second,
            parameters,
            spectral=float(spectral_distances(*signatures)[0]),
            cc=match.cc,
            probability=combined,
        )

    landmarks = landmarks_of(body.landmarks)

    def in_json(**dense_fields: Any) -> CompareAnswer:  # noqa: ANN401
        return CompareAnswer(
            cc=match.cc,
            ssd=match.ssd,
            sim=match.sim,
            combined=combined,
            **relation,
            correspondence=pairs(match, first.embedding, second.embedding),
            pipeline=pipeline.fingerprint,
            milliseconds=timings.so_far(),
            **dense_fields,
        )

    wants = body.transfer is not None or body.landmarks is not None
    mapped = dense or wants
    if not mapped and options.format != "glb":
        return in_json()
    with timings.stage("dense" if mapped else "draw"):
        meshes = await asyncio.gather(first.mesh(), second.mesh())
    pair = [
        ShownMesh(shape.name, shape.format, mesh) for shape, mesh in zip((first, second), meshes, strict=True)
    ]
    do = container.queue.do
    if not mapped:
        with timings.stage("draw"):
            points = match.points(first.embedding, second.embedding)
            return Response(await do(rendering.coloured, pair, points, FACES), media_type=MEDIA_TYPE)
    matrix = relation["transform"]
    placing = None if matrix is None else similarity_of(np.array(matrix))
    if options.format in {"glb", "png"}:
        drawn = await _painted(container, pair, records, parameters, placing, landmarks, options, timings)
        return Response(drawn, media_type=PNG if options.format == "png" else MEDIA_TYPE)
    wanted = wanted_of(body.transfer or Transfer(), meshes[0]) if wants else None
    with timings.stage("dense"), _points_at_fault():
        given = *meshes, *records, parameters, placing, FINE, landmarks, wanted
        ways, found = await do(tasks.dense_correspondence, *given)
    if options.format == "npz":
        return Response(await do(tasks.correspondence_archive, ways[0]), media_type=ZIP)
    # The answer of a large mesh takes longer to write than the event loop may wait.
    transferred = None if found is None else answer_of(found)
    fields = dense_fields(ways) if dense else map_fields(ways[0])
    text = await run_in_threadpool(lambda: in_json(transferred=transferred, **fields).model_dump_json())
    return Response(text, media_type="application/json")


async def _painted(
    container: Container,
    pair: list[ShownMesh],
    records: tuple[bytes, bytes],
    parameters: Parameters,
    placing: Similarity | None,
    landmarks: tuple[Floats, Floats] | None,
    options: CompareParameters,
    timings: Timings,
) -> bytes:
    """Return a GLB or a picture of both meshes; `placing` is that of a copy or a variant.

    Differences of other rigid parts are shown after the best alignment, and those of bodies that bend by the
    dense correspondence.
    """
    do = container.queue.do
    meshes = pair[0].mesh, pair[1].mesh
    size = PICTURE_SIZE if options.format == "png" else None
    if options.paint == "difference":
        registered = placing is not None
        if placing is None:
            with timings.stage("align"):
                placing = await do(tasks.aligned, *meshes, *records, parameters)
        if placing is not None:
            with timings.stage("draw"):
                return await do(rendering.painted_distances, pair, placing, registered, FACES, size)
    with timings.stage("dense"), _points_at_fault():
        given = *meshes, *records, parameters, placing, FUNCTIONS, landmarks
        ways, _ = await do(tasks.dense_correspondence, *given)
    with timings.stage("draw"):
        return await do(rendering.painted, pair, ways, options.paint, FACES, size)


def _dense_option(body: CompareForm | CompareRequest, options: CompareParameters) -> bool:
    """Return whether the dense correspondence is asked for, by the body or else by the query parameters.

    Raises
    ------
    BadRequestFieldsError
        A format or a painting needs it, and it is not asked for; or a page, which has none.
    """
    dense = options.dense if body.dense is None else body.dense
    if options.format in {"npz", "png"} and not dense:
        raise BadRequestFieldsError(FieldFault("format", f"{options.format} needs dense=true"))
    if options.paint != "correspondence" and not dense:
        raise BadRequestFieldsError(FieldFault("paint", f"{options.paint} needs dense=true"))
    if options.format == "html" and dense:
        raise BadRequestFieldsError(FieldFault("format", "html has no dense correspondence"))
    if body.transfer is not None and options.format != "json":
        raise BadRequestFieldsError(FieldFault("transfer", "needs format=json"))
    if body.landmarks is not None and options.format != "json" and not dense:
        raise BadRequestFieldsError(FieldFault("landmarks", f"{options.format} needs dense=true with them"))
    return dense


@contextmanager
def _points_at_fault() -> Iterator[None]:
    """Answer for a point that is far from its surface by the name of its field."""
    try:
        yield
    except OffSurfaceError as error:
        field = "landmarks" if error.what == "landmark" else "transfer"
        raise BadRequestFieldsError(FieldFault(field, str(error))) from error


async def _compared_shape(
    container: Container,
    collection: CollectionNumber,
    given: str | UploadFile,
    active_pipeline: ActivePipeline,
    timings: Timings,
) -> ComparedShape:
    """Return the shape of a collection with an id, or the shape of a file.

    Raises
    ------
    ShapeNotFoundError, NotEmbeddedError
        The collection has no such shape, or no embedding of it.
    MeshError
        The file cannot be used; the subclass says why.
    """
    if isinstance(given, str):

        def read(session: ReadSession) -> ComparedShape:
            fingerprint = active_pipeline.fingerprint
            record = file_repository.embedding_of(session, fingerprint, collection, given).record
            shape = shapes_service.get(session, collection, given)
            mesh = once(partial(stored_mesh, container, collection, given))
            return ComparedShape(record, name=shape.name, format=shape.format, mesh=mesh)

        with timings.stage("read"):
            return await container.database.reading(read)

    name = given.filename or ""
    mesh_format = format_of(name)
    await given.seek(0)
    data = await given.read()
    with timings.stage("embed"):
        mesh = await container.queue.read(data, mesh_format)
        embedded = await container.queue.do(tasks.embed_mesh, mesh, active_pipeline.pipeline.parameters, 0.0)

    async def kept() -> Mesh:
        return mesh

    return ComparedShape(embedded.record, name=base_name(name), format=mesh_format, mesh=kept)


def _combined(first: Embedding, second: Embedding, match: Match, sample: CollectionSample | None) -> float:
    """Return the class probability of two shapes; local densities are those in a collection's sample."""
    scores = Scores(*(np.array([score]) for score in (match.cc, match.ssd, match.sim)))
    density = densities = None
    if sample is not None:
        density, densities = (sample.of_query(descriptors_of(each)) for each in (first, second))
    return float(combined_scores(first, [second], scores, density, densities)[0])
