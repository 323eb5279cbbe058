"""The calls of the clients: on stored shapes, searches, bulk jobs, collections and the service itself."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypedDict, TypeVar, Unpack

import httpx
from pydantic import JsonValue

from service.client.requests import (
    Call,
    ClientError,
    Conditions,
    File,
    Step,
    conditions,
    content,
    given,
    nothing,
    pages,
    parsed,
    segment,
)
from service.collection import Collection, Collections
from service.duplicates.decision_schemas import (
    Acts,
    Decided,
    DecidedPair,
    DecisionPage,
    MergedGroup,
    MergedShape,
    MergePage,
    Rule,
    Undone,
)
from service.duplicates.records import Decision
from service.duplicates.schemas import DuplicatesAnswer
from service.jobs.schemas import Job, JobFile, JobFilePage, JobPage
from service.search.compare_schemas import CompareAnswer
from service.search.schemas import BatchAnswer, FamiliesAnswer, MapAnswer, QueryAnswer, SearchOptions
from service.search.suggestion_schemas import Suggestions
from service.shapes.bulk_schemas import BulkChange, BulkChanged, MetadataRules, RulesApplied
from service.shapes.facets import Facets
from service.shapes.records import Sort
from service.shapes.schemas import (
    Assembly,
    DeletedShape,
    DeletedShapePage,
    EmbeddingArrays,
    Shape,
    ShapePage,
    UploadedShape,
)
from service.sources.schemas import (
    FileGroup,
    FileGroupPage,
    FileState,
    Source,
    SourceFile,
    SourceFilePage,
    Sources,
)
from service.system.schemas import Version

P = ParamSpec("P")
T = TypeVar("T")

Compared = str | Path | tuple[str, bytes]
"""A shape to compare: the id of a stored shape, or a file as its path or as its name and bytes."""

Position = Sequence[float]
"""Three coordinates, in the frame of the file."""


class Filters(TypedDict, total=False):
    """The filters of shapes: words, all of these tags, a text in the name, metadata, a format, ranges.

    `metadata` holds keys with values, or conditions of the form key=value; `area`, `volume` and `length` are
    ranges of the form min..max.
    """

    q: str | None
    tag: Sequence[str]
    name: str | None
    metadata: Conditions
    file_format: str | None
    area: str | None
    volume: str | None
    length: str | None


@dataclass(frozen=True)
class Upload:
    """A stored shape, whether this upload created it, and the fields of a stored one that it added to.

    `parts` has the distinct parts of an assembly that is uploaded with split="parts".
    """

    shape: Shape
    created: bool
    changed: tuple[Literal["tags", "metadata"], ...] = ()
    parts: tuple["Upload", ...] = ()


def upload(
    file: File,
    *,
    name: str | None = None,
    tags: Sequence[str] = (),
    metadata: Mapping[str, JsonValue] | None = None,
    split: Literal["parts"] | None = None,
) -> Call[Upload]:
    """Store a mesh. If its bytes are stored under the same name, the shape gets the new tags and metadata.

    With split="parts", each distinct part of a STEP or 3MF is stored as a shape too.
    """

    def read(answer: httpx.Response) -> Upload:
        stored = parsed(UploadedShape)(answer)
        shape = Shape.model_validate(stored.model_dump(include=set(Shape.model_fields)))
        return Upload(shape, stored.created, tuple(stored.changed))

    def read_assembly(answer: httpx.Response) -> Upload:
        assembly = parsed(Assembly)(answer)
        parts = tuple(Upload(part, part.created, tuple(part.changed)) for part in assembly.parts)
        return Upload(assembly, assembly.created, tuple(assembly.changed), parts)

    data = _described(name, tags, metadata) | given(split=split)
    return Call(
        "POST", "/shapes", read if split is None else read_assembly, data=data, files=[("file", file)]
    )


def page(
    *,
    sort: Sort = "relevance",
    limit: int = 50,
    cursor: str | None = None,
    sha256: str | None = None,
    **filters: Unpack[Filters],
) -> Call[ShapePage]:
    """Get one page of the stored shapes that pass the filters and, if asked, whose file has a SHA-256."""
    params = _filtered(filters) | given(sort=sort, limit=limit, cursor=cursor, sha256=sha256)
    return Call("GET", "/shapes", parsed(ShapePage), params=params)


def shapes(
    *, sort: Sort = "relevance", sha256: str | None = None, **filters: Unpack[Filters]
) -> Call[Step[Shape]]:
    """Get all stored shapes that pass the filters, page by page; with `sha256`, those of the same bytes."""
    params = _filtered(filters) | given(sort=sort, sha256=sha256)
    return pages("/shapes", ShapePage, lambda answer: answer.shapes, **params)


def facets(*, tag_text: str = "", limit: int = 100, **filters: Unpack[Filters]) -> Call[Facets]:
    """Count the shapes that pass the filters, by tag, format, length and collection."""
    params = _filtered(filters) | given(tag_text=tag_text or None, limit=limit)
    return Call("GET", "/facets", parsed(Facets), params=params)


def shape(shape_id: str) -> Call[Shape]:
    """Get the record of a shape."""
    return Call("GET", _shape(shape_id), parsed(Shape))


def file(shape_id: str, *, format: str | None = None) -> Call[bytes]:
    """Get the uploaded file, or the mesh in another format."""
    return Call("GET", f"{_shape(shape_id)}/file", content, params=given(format=format))


def embedding(shape_id: str) -> Call[EmbeddingArrays]:
    """Get the embedding of a shape."""
    return Call("GET", f"{_shape(shape_id)}/embedding", parsed(EmbeddingArrays))


def thumbnail(shape_id: str, *, size: Literal[64, 128, 256, 512] = 256) -> Call[bytes]:
    """Get a PNG of `size` by `size` pixels with a transparent background."""
    return Call("GET", f"{_shape(shape_id)}/thumbnail.png", content, params={"size": size})


def preview(shape_id: str) -> Call[bytes]:
    """Get the mesh for a viewer: a GLB with y up and coordinates in [-1, 1]; a large mesh is simplified."""
    return Call("GET", f"{_shape(shape_id)}/preview.glb", content)


def preview_file(file: File) -> Call[bytes]:
    """Get the preview of a file that is not stored."""
    return Call("POST", "/preview", content, files=[("file", file)])


def replace_file(shape_id: str, file: File, *, if_sha256: str | None = None) -> Call[Shape]:
    """Replace the file of a shape; with `if_sha256`, only if the present file has that SHA-256."""
    headers = {} if if_sha256 is None else {"If-Match": f'"{if_sha256}"'}
    return Call("PUT", f"{_shape(shape_id)}/file", parsed(Shape), headers=headers, files=[("file", file)])


def update(
    shape_id: str,
    *,
    name: str | None = None,
    tags: Sequence[str] | None = None,
    metadata: Mapping[str, JsonValue] | None = None,
    collection: str | None = None,
) -> Call[Shape]:
    """Replace the given fields of a shape, or move it to another collection; the others stay."""
    changes: dict[str, Any] = given(
        name=name,
        tags=None if tags is None else list(tags),
        metadata=None if metadata is None else dict(metadata),
        collection=collection,
    )
    return Call("PATCH", _shape(shape_id), parsed(Shape), json=changes)


def update_all(change: BulkChange) -> Call[BulkChanged]:
    """Change all shapes that pass a filter; a dry run, the default, counts them."""
    return Call(
        "PATCH", "/shapes", parsed(BulkChanged), json=change.model_dump(mode="json", exclude_none=True)
    )


def delete(shape_id: str, *, permanent: bool = False) -> Call[None]:
    """Delete a shape; with `permanent`, for good at once."""
    return Call("DELETE", _shape(shape_id), nothing, params=given(permanent=permanent or None))


def deleted() -> Call[Step[DeletedShape]]:
    """List the deleted shapes that can be restored, the first deleted first."""
    return pages("/deleted", DeletedShapePage, lambda answer: answer.shapes)


def restore(shape_id: str) -> Call[Shape]:
    """Restore a deleted shape."""
    return Call("POST", f"{_shape(shape_id)}/restore", parsed(Shape))


def purge(shape_id: str) -> Call[None]:
    """Delete a deleted shape permanently."""
    return Call("DELETE", f"/deleted/{segment(shape_id)}", nothing)


def _with_search_options(make: Callable[P, Call[QueryAnswer]]) -> Callable[P, Call[QueryAnswer]]:
    """Give a call the signature with the options of `SearchOptions`, which it passes on as they are given."""
    *parameters, _ = signature(make).parameters.values()
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, annotation=field.annotation, default=field.get_default())
        for name, field in SearchOptions.model_fields.items()
    ]
    make.__dict__["__signature__"] = Signature([*parameters, *options], return_annotation=Call[QueryAnswer])
    return make


@_with_search_options
def query_file(file: File, **options: Any) -> Call[QueryAnswer]:  # noqa: ANN401
    """Find the stored shapes most similar to a file.

    The options are those of `service.search.schemas.SearchOptions`; metadata may be a mapping.
    """
    return Call("POST", "/query", parsed(QueryAnswer), data=_checked(options), files=[("file", file)])


@_with_search_options
def similar(shape_id: str, **options: Any) -> Call[QueryAnswer]:  # noqa: ANN401
    """Find the stored shapes most similar to a stored shape; the options are part of the address."""
    path = f"/shapes/{segment(shape_id)}/similar"
    return Call("GET", path, parsed(QueryAnswer), params=_checked(options))


@_with_search_options
def query_shape(shape_id: str, **options: Any) -> Call[QueryAnswer]:  # noqa: ANN401
    """Return the answer of `similar`; the options are in the body, so a long list of ids fits."""
    return Call("POST", "/query", parsed(QueryAnswer), json={"shape_id": shape_id, **_checked(options)})


def query_batch(shapes: Sequence[Compared], **options: Any) -> Call[BatchAnswer]:  # noqa: ANN401
    """Find the stored shapes most similar to each of up to 100 stored ones, by their ids, or of 100 files.

    The options are those of `similar`.
    """
    asked, path = _checked(options), "/query/batch"
    ids = [shape for shape in shapes if isinstance(shape, str)]
    files = [("file", shape) for shape in shapes if not isinstance(shape, str)]
    if not files:
        return Call("POST", path, parsed(BatchAnswer), json={"shape_ids": ids, **asked})
    if ids:
        raise ClientError("a batch has either ids or files")
    return Call("POST", path, parsed(BatchAnswer), data=asked, files=files)


def compare(
    first: Compared,
    second: Compared,
    *,
    dense: bool = False,
    landmarks: Sequence[tuple[Position, Position]] = (),
    points: Sequence[Position] = (),
    curves: Sequence[Sequence[Position]] = (),
    values: Sequence[float] | None = None,
) -> Call[CompareAnswer]:
    """Compare two shapes point by point, with `dense` vertex by vertex.

    A text is the id of a stored shape; a `Path`, or a name with bytes, is a file. Points, curves and values
    at the vertices are transferred from the first shape to the second. Landmarks are points of both that
    must correspond.
    """
    options: dict[str, Any] = {"dense": True} if dense else {}
    if landmarks:
        options["landmarks"] = [{"first": list(ours), "second": list(theirs)} for ours, theirs in landmarks]
    if points or curves or values is not None:
        wanted: dict[str, Any] = {
            "points": [list(point) for point in points],
            "curves": [[list(point) for point in curve] for curve in curves],
        }
        options["transfer"] = wanted | given(values=values)
    return _compared(first, second, parsed(CompareAnswer), options, {})


def dense_file(
    first: Compared,
    second: Compared,
    format: Literal["npz", "glb", "png"],
    paint: Literal["correspondence", "difference"] = "correspondence",
) -> Call[bytes]:
    """Return the dense correspondence of two shapes as a NumPy archive, a GLB or a picture."""
    params: dict[str, str] = {"format": format, "paint": paint}
    return _compared(first, second, content, {"dense": True}, params)


def _compared(
    first: Compared,
    second: Compared,
    read: Callable[[httpx.Response], T],
    options: dict[str, Any],
    params: dict[str, str],
) -> Call[T]:
    """Send JSON with two ids, or a form if one of the shapes is a file."""
    shapes = {"first": first, "second": second}
    files = {name: shape for name, shape in shapes.items() if not isinstance(shape, str)}
    ids = {name: shape for name, shape in shapes.items() if isinstance(shape, str)}
    if not files:
        return Call("POST", "/compare", read, params=params, json={**ids, **options})
    written = {name: json.dumps(option) for name, option in options.items()}
    return Call("POST", "/compare", read, params=params, data={**ids, **written}, files=[*files.items()])


def duplicates(
    *,
    max_residual: float | None = None,
    scaled: bool | None = None,
    mirrored: bool | None = None,
    variants: bool | None = None,
    decided: bool | None = None,
    judging_seconds: float | None = None,
    limit: int | None = None,
    **filters: Unpack[Filters],
) -> Call[DuplicatesAnswer]:
    """Find groups of near-identical shapes among the shapes that pass the filters.

    With `scaled`, copies of other sizes join groups too; with `variants`, rigid copies but for a local
    difference; with `decided`, shapes that are decided; without `mirrored`, mirror images do not.
    """
    options = given(
        max_residual=max_residual,
        scaled=scaled,
        mirrored=mirrored,
        variants=variants,
        decided=decided,
        judging_seconds=judging_seconds,
        limit=limit,
    )
    params = _filtered(filters) | options
    return Call("GET", "/duplicates", parsed(DuplicatesAnswer), params=params)


def decide(
    shapes: Sequence[str], decision: Decision, *, decided_by: str | None = None, reason: str = ""
) -> Call[Decided]:
    """Decide every pair of some shapes, which `duplicates` does not show again."""
    body = {"shapes": list(shapes), "decision": decision, "reason": reason} | given(decided_by=decided_by)
    return Call("POST", "/duplicates/decisions", parsed(Decided), json=body)


def decisions() -> Call[Step[DecidedPair]]:
    """List the decided pairs, the oldest decision first."""
    return pages("/duplicates/decisions", DecisionPage, lambda answer: answer.decisions)


def delete_decision(decision_id: str) -> Call[None]:
    """Undo a decision."""
    return Call("DELETE", f"/duplicates/decisions/{segment(decision_id)}", nothing)


def merge(shapes: Sequence[str], *, keep: str = "oldest") -> Call[MergedShape]:
    """Merge shapes into the oldest, the newest, the largest or the one with an id; the others are deleted."""
    body = {"shapes": list(shapes), "keep": keep}
    return Call("POST", "/duplicates/merge", parsed(MergedShape), json=body)


def merges() -> Call[Step[MergedGroup]]:
    """List the merged groups that can be undone, the oldest merge first."""
    return pages("/duplicates/merges", MergePage, lambda answer: answer.merges)


def acts(*, limit: int = 50) -> Call[Acts]:
    """List the latest decisions and merges that can be undone, the latest first."""
    return Call("GET", "/duplicates/acts", parsed(Acts), params={"limit": limit})


def undo_merge(merge_id: str) -> Call[Undone]:
    """Restore all shapes that a merge deleted, and the tags and metadata of those that stayed.

    The id is that of the answer to `merge`, or to `apply_rule` on all groups that meet a rule.
    """
    return Call("POST", f"/duplicates/merges/{segment(merge_id)}/undo", parsed(Undone))


def apply_rule(rule: Rule) -> Call[Decided]:
    """Decide or merge all groups of duplicates that meet a rule; a dry run, the default, counts them."""
    body = rule.model_dump(mode="json", exclude_none=True)
    return Call("POST", "/duplicates/rule", parsed(Decided), json=body)


def suggestions(shape_id: str, *, least_share: float | None = None) -> Call[Suggestions]:
    """Get tags and metadata that the neighbours of a shape suggest for it, with these shapes."""
    params = given(least_share=least_share)
    return Call("GET", f"{_shape(shape_id)}/suggestions", parsed(Suggestions), params=params)


def families(*, least_probability: float | None = None, **filters: Unpack[Filters]) -> Call[FamiliesAnswer]:
    """Get groups of shapes that are probably of one class, among the shapes that pass the filters."""
    params = _filtered(filters) | given(least_probability=least_probability)
    return Call("GET", "/families", parsed(FamiliesAnswer), params=params)


def similarity_map(**filters: Unpack[Filters]) -> Call[MapAnswer]:
    """Get positions of the shapes that pass the filters on a plane, similar shapes near each other."""
    return Call("GET", "/map", parsed(MapAnswer), params=_filtered(filters))


def send_archive(
    archive: File, *, tags: Sequence[str] = (), metadata: Mapping[str, JsonValue] | None = None
) -> Call[Job]:
    """Start a job that stores every mesh of an archive, with tags and metadata."""
    data = _described(None, tags, metadata)
    return Call("POST", "/jobs", parsed(Job), data=data, files=[("file", archive)], streamed=True)


def job(job_id: str) -> Call[Job]:
    """Get the progress of a job."""
    return Call("GET", _job(job_id), parsed(Job))


def follow_job(job_id: str, *, seconds: float = 1.0) -> Call[Step[Job]]:
    """Get the progress of a job every `seconds` seconds; the last item is the ended job."""

    def step(now: Job) -> Step[Job]:
        return Step([now], None if now.has_ended else follow_job(job_id, seconds=seconds), seconds)

    return job(job_id).then(step)


def jobs() -> Call[Step[Job]]:
    """List the jobs that run or ended in the last days, the latest first."""
    return pages("/jobs", JobPage, lambda answer: answer.jobs)


def job_files(
    job_id: str, *, outcome: Literal["stored", "present", "refused"] | None = None
) -> Call[Step[JobFile]]:
    """List the files of a job's archive with their outcomes, in the order of the archive."""
    return pages(f"{_job(job_id)}/files", JobFilePage, lambda answer: answer.files, outcome=outcome)


def cancel_job(job_id: str) -> Call[Job]:
    """Stop a job; the shapes that it has stored stay."""
    return Call("POST", f"{_job(job_id)}/cancel", parsed(Job))


def delete_job(job_id: str) -> Call[None]:
    """Cancel a job and delete its record; the shapes that it has stored stay."""
    return Call("DELETE", _job(job_id), nothing)


def sources() -> Call[Sources]:
    """List the folders whose mesh files are shapes, by name."""
    return Call("GET", "/sources", parsed(Sources))


def add_source(
    path: str,
    *,
    name: str | None = None,
    tags: Sequence[str] = (),
    rules: Mapping[str, Sequence[str]] | None = None,
    copies: bool = False,
) -> Call[Source]:
    """Have the mesh files of a folder of the service's machine as shapes; `copies` stores their bytes.

    `rules` has more tags by patterns of paths, in the syntax of .gitignore.
    """
    by_pattern = {pattern: list(of_path) for pattern, of_path in (rules or {}).items()}
    body = given(path=path, name=name, tags=list(tags), rules=by_pattern, copies=copies)
    return Call("POST", "/sources", parsed(Source), json=body)


def source(source_id: str) -> Call[Source]:
    """Get the state of a source, and the counts of its latest scan."""
    return Call("GET", _source(source_id), parsed(Source))


def follow_source(source_id: str, *, seconds: float = 1.0) -> Call[Step[Source]]:
    """Get the state of a source every `seconds` seconds; the last item is that after its scan."""

    def step(now: Source) -> Step[Source]:
        return Step([now], None if now.is_scanned else follow_source(source_id, seconds=seconds), seconds)

    return source(source_id).then(step)


def source_files(
    source_id: str, *, state: FileState | None = None, shape_id: str | None = None, equal: bool = False
) -> Call[Step[SourceFile]]:
    """List the files of a source, those of one shape, or those that are there more than once."""
    path, conditions = f"{_source(source_id)}/files", {"state": state, "shape_id": shape_id, "equal": equal}
    return pages(path, SourceFilePage, lambda answer: answer.files, **conditions)


def equal_files(*, merged: bool = False) -> Call[Step[FileGroup]]:
    """List groups of equal files, the one to keep first; `merged` joins files whose shapes were merged."""
    return pages("/equal-files", FileGroupPage, lambda answer: answer.groups, merged=merged)


def set_source_rules(source_id: str, rules: Mapping[str, Sequence[str]]) -> Call[Source]:
    """Have the shapes of a source tagged by patterns of their paths; a scan tags those that are stored."""
    by_pattern = {pattern: list(tags) for pattern, tags in rules.items()}
    return Call("PUT", f"{_source(source_id)}/rules", parsed(Source), json={"rules": by_pattern})


def rules() -> Call[MetadataRules]:
    """Get the tags that shapes get by their metadata."""
    return Call("GET", "/rules", parsed(MetadataRules))


def set_rules(rules: Mapping[str, Sequence[str]]) -> Call[RulesApplied]:
    """Have shapes tagged by conditions on their metadata, written key=value; a * stands for any text."""
    by_condition = {condition: list(tags) for condition, tags in rules.items()}
    return Call("PUT", "/rules", parsed(RulesApplied), json={"rules": by_condition})


def rescan_source(source_id: str) -> Call[Source]:
    """Scan a source for new and changed files."""
    return Call("POST", f"{_source(source_id)}/rescan", parsed(Source))


def confirm_source(source_id: str) -> Call[Source]:
    """Scan a source that is offline, and have the files missing that its folder lacks."""
    return Call("POST", f"{_source(source_id)}/confirm", parsed(Source))


def remove_source(source_id: str) -> Call[None]:
    """Remove a source and delete its shapes; no file is touched."""
    return Call("DELETE", _source(source_id), nothing)


def collections() -> Call[Collections]:
    """List the collections that the key may use, by name, each with the number of its shapes."""
    return Call("GET", "/collections", parsed(Collections))


def create_collection(name: str) -> Call[Collection]:
    """Create a collection, unless it exists."""
    return Call("PUT", f"/collections/{segment(name)}", parsed(Collection))


def delete_collection(name: str) -> Call[None]:
    """Delete a collection that has no shapes."""
    return Call("DELETE", f"/collections/{segment(name)}", nothing)


def version() -> Call[Version]:
    """Get the version of the service and its pipeline."""
    return Call("GET", "/version", parsed(Version))


def _shape(shape_id: str) -> str:
    return f"/shapes/{segment(shape_id)}"


def _job(job_id: str) -> str:
    return f"/jobs/{segment(job_id)}"


def _source(source_id: str) -> str:
    return f"/sources/{segment(source_id)}"


def _described(
    name: str | None, tags: Sequence[str], metadata: Mapping[str, JsonValue] | None
) -> dict[str, str | list[str]]:
    """Return the fields of a form that describe a shape."""
    return given(
        name=name,
        tags=",".join(tags) if tags else None,
        metadata=None if metadata is None else json.dumps(metadata),
    )


def _filtered(filters: Filters) -> dict[str, Any]:
    """Return the parameters of the filters."""
    lists = {"tag": list(filters.get("tag", ())), "metadata": conditions(filters.get("metadata", ()))}
    return given(**{**filters, **lists})


def _checked(options: dict[str, Any]) -> dict[str, Any]:
    """Return options of a search; raise TypeError if an option is unknown."""
    unknown = options.keys() - SearchOptions.model_fields.keys()
    if unknown:
        raise TypeError(f"a search has no option {min(unknown)!r}")
    return options | ({"metadata": conditions(options["metadata"])} if "metadata" in options else {})
