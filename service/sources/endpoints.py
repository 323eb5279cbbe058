"""The addresses under /sources, and /equal-files.

All of them need a key that may write: their answers have paths.
"""

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from pydantic import Field

from service.auth.gate import EQUAL_FILES, SOURCES
from service.collections.endpoints import InCollection, address
from service.container import Service
from service.http.problems import READ_PROBLEMS, WRITE_PROBLEMS, documented
from service.http.request_bodies import once_each
from service.shapes.endpoints import PageOptions
from service.shapes.fields import Id
from service.shapes.schemas import read_cursor
from service.sources import service, superfluous
from service.sources.scanner import Scanner
from service.sources.schemas import (
    FileGroupPage,
    FileState,
    NewRules,
    NewSource,
    Source,
    SourceFilePage,
    Sources,
)

router = APIRouter(tags=["sources"])

SourceId = Annotated[Id, Path(description="The id of a source.")]


def _scanner(request: Request) -> Scanner:
    scanner = request.app.state.scanner
    assert isinstance(scanner, Scanner)
    return scanner


InScanner = Annotated[Scanner, Depends(_scanner)]


class SourceFileListing(PageOptions):
    """A page of a source's files."""

    state: FileState | None = Field(default=None, description="Only files in this state.")
    shape_id: list[Id] = Field(
        default=[],
        max_length=100,
        description="Only files of these shapes: where they are on disk. Repeatable.",
    )
    equal: bool = Field(
        default=False,
        description="Only files that are there more than once: several present files have the shape, in any "
        "source. The files of one shape come together.",
    )


@router.get(SOURCES, summary="List sources", responses=documented(*READ_PROBLEMS))
def list_sources(container: Service, collection: InCollection) -> Sources:
    """Return the folders whose files are shapes of the collection, by name, with their states."""
    with container.database.read() as session:
        return service.list_all(session, collection.number)


@router.post(
    SOURCES,
    status_code=201,
    summary="Add a source",
    response_model=Source,
    response_description="The folder is a source, and its first scan begins; Location is its URL.",
    responses=documented("bad-request-fields", "source-refused", *WRITE_PROBLEMS),
)
async def add_source(
    new: NewSource, response: Response, container: Service, scanner: InScanner, collection: InCollection
) -> Source:
    """Have the mesh files of a folder of this machine as shapes, which stay where they are.

    The folder must be in one of ISOSHAPE_SOURCE_ROOTS. Zip files are read like folders, and the archive keeps
    the bytes of their meshes.
    """
    allowed = container.settings.source_roots
    root = await container.database.in_thread(partial(service.real_folder, new.path, allowed))
    source = await container.database.writing(service.add, collection.number, new, root)
    scanner.look()
    response.headers["Location"] = address(f"{SOURCES}/{source.id}", collection)
    return source


class FileGroupListing(PageOptions):
    """A page of groups of files."""

    merged: bool = Field(
        default=False, description="Join files whose shapes were merged, as long as the merge can be undone."
    )


@router.get(
    EQUAL_FILES,
    summary="List equal files",
    responses=documented(*READ_PROBLEMS),
    dependencies=[once_each(FileGroupListing)],
)
def list_equal_files(
    listing: Annotated[FileGroupListing, Query()], container: Service, collection: InCollection
) -> FileGroupPage:
    """Return the groups of files with equal bytes, of all sources that are ready: one file of each is enough.

    The kept file is the first by source and path. A page ends with the group that brings it to 1,000 files.
    The service removes no file.
    """
    after = read_cursor(listing.cursor)
    with container.database.read() as session:
        return superfluous.groups(
            session, collection.number, merged=listing.merged, after=after, limit=listing.limit
        )


@router.get(
    f"{SOURCES}/{{source_id}}",
    summary="Read a source",
    responses=documented("source-not-found", *READ_PROBLEMS),
)
def read_source(source_id: SourceId, container: Service, collection: InCollection) -> Source:
    """Return the state of a source, and the counts of its latest scan."""
    with container.database.read() as session:
        return service.get(session, collection.number, source_id)


@router.get(
    f"{SOURCES}/{{source_id}}/files",
    summary="List the files of a source",
    responses=documented("source-not-found", *READ_PROBLEMS),
    dependencies=[once_each(SourceFileListing)],
)
def list_source_files(
    source_id: SourceId,
    listing: Annotated[SourceFileListing, Query()],
    container: Service,
    collection: InCollection,
) -> SourceFilePage:
    """Return the state of each file: its shape, or why it has none."""
    after = read_cursor(listing.cursor)
    with container.database.read() as session:
        return service.list_files(
            session,
            collection.number,
            source_id,
            listing.state,
            listing.shape_id,
            equal=listing.equal,
            after=after,
            limit=listing.limit,
        )


@router.put(
    f"{SOURCES}/{{source_id}}/rules",
    summary="Set the rules of a source",
    responses=documented("bad-request-fields", "source-not-found", *WRITE_PROBLEMS),
)
async def set_source_rules(
    source_id: SourceId, new: NewRules, container: Service, scanner: InScanner, collection: InCollection
) -> Source:
    """Have the shapes of the source tagged by these rules: those that are stored, by a scan, and later ones.

    Tags that shapes have stay. A shape that would have too many gets none.
    """
    source = await container.database.writing(service.set_rules, collection.number, source_id, new.rules)
    scanner.look()
    return source


@router.post(
    f"{SOURCES}/{{source_id}}/rescan",
    status_code=202,
    summary="Scan a source",
    responses=documented("source-not-found", *WRITE_PROBLEMS),
)
async def rescan_source(
    source_id: SourceId, container: Service, scanner: InScanner, collection: InCollection
) -> Source:
    """Read the files that are new or have changed. The answer's `state` tells when the scan has ended."""
    source = await container.database.writing(service.ask_for_scan, collection.number, source_id)
    scanner.look()
    return source


@router.post(
    f"{SOURCES}/{{source_id}}/confirm",
    status_code=202,
    summary="Confirm a loss",
    responses=documented("source-not-found", *WRITE_PROBLEMS),
)
async def confirm_source(
    source_id: SourceId, container: Service, scanner: InScanner, collection: InCollection
) -> Source:
    """Scan a source that is offline, and have the files missing that its folder lacks, however many."""
    ask = container.database.writing
    source = await ask(service.ask_for_scan, collection.number, source_id, confirmed=True)
    scanner.look()
    return source


@router.delete(
    f"{SOURCES}/{{source_id}}",
    status_code=204,
    summary="Remove a source",
    responses=documented("source-not-found", *WRITE_PROBLEMS),
)
async def remove_source(
    source_id: SourceId, container: Service, scanner: InScanner, collection: InCollection
) -> None:
    """Delete the shapes of a source, which can be restored for a time. No file is touched."""
    database = container.database
    number = await database.writing(service.begin_removal, collection.number, source_id)
    await database.in_thread(partial(service.delete_shapes, database, number, container.settings.undo_time))
    scanner.look()
