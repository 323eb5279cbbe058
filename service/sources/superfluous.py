"""Groups of files of which one is enough. The service never removes the others: their owner may."""

from collections import Counter
from collections.abc import Sequence
from itertools import accumulate

from service.collection import CollectionNumber
from service.shapes.schemas import write_cursor
from service.sources import superfluous_repository as repository
from service.sources.schemas import FileGroup, FileGroupPage, GroupedFile
from service.sources.superfluous_repository import Identity, PresentFile
from service.storage.database import ReadSession

FILES_OF_A_PAGE = 1_000
"""Number of files with which a page ends, after the group that reaches it."""


def groups(
    session: ReadSession, collection: CollectionNumber, *, merged: bool, after: int, limit: int
) -> FileGroupPage:
    """Return one page of the groups of equal files; with `merged`, also of those whose shapes were merged.

    A group is kept by a shape, the one that stayed. Files that are missing, and those of sources that are not
    ready, are in no group. A merge joins files if a file of the shape that stayed is there, outside zips.
    A page ends with the group that brings it to `FILES_OF_A_PAGE` files.
    """
    stayed = repository.merged(session, collection) if merged else {}
    files = repository.files_of(session, collection, {*stayed, *stayed.values()})
    there, plain = {file.shape for file in files}, {file.shape for file in files if not file.is_in_zip}
    stayed = {shape: kept for shape, kept in stayed.items() if shape in there and kept in plain}
    several = repository.counts_of_several(session, collection)
    keepers = sorted({*(several.keys() - stayed.keys()), *stayed.values()})
    counts = Counter({keeper: several.get(keeper, 1) for keeper in keepers})
    for shape, keeper in stayed.items():
        counts[keeper] += several.get(shape, 1)
    following = [keeper for keeper in keepers if keeper > after]
    totals = accumulate(counts[keeper] for keeper in following[:limit])
    shown = following[: 1 + sum(total < FILES_OF_A_PAGE for total in totals)][:limit]
    members: dict[int, list[PresentFile]] = {keeper: [] for keeper in shown}
    shapes = {*members, *(shape for shape, keeper in stayed.items() if keeper in members)}
    for file in repository.files_of(session, collection, shapes):
        members[stayed.get(file.shape, file.shape)].append(file)
    hashes = {file.sha256 for group in members.values() for file in group}
    of_several_paths = repository.of_several_paths(session, hashes)
    return FileGroupPage(
        groups=[_group(keeper, group, of_several_paths) for keeper, group in members.items()],
        total=len(keepers),
        next_cursor=write_cursor(shown[-1]) if len(following) > len(shown) else None,
    )


def _group(keeper: int, files: Sequence[PresentFile], of_several_paths: set[Identity]) -> FileGroup:
    """Return a group: its kept file is the first one of the shape that stayed, outside zips if one is."""
    kept = min(files, key=lambda file: (file.shape != keeper, file.is_in_zip))

    def shown(file: PresentFile) -> GroupedFile:
        left = None
        if file is not kept and file.is_in_zip:
            left = "it is in a zip"
        elif file is not kept and file.identity in of_several_paths:
            left = "the library has this file by another path too"
        return GroupedFile(
            source_id=file.source_id,
            path=f"{file.root.rstrip('/')}/{file.path}",
            bytes=file.size,
            sha256=file.sha256,
            role="kept" if file is kept else "equal" if file.sha256 == kept.sha256 else "merged",
            left=left,
        )

    return FileGroup(files=[shown(kept), *(shown(file) for file in files if file is not kept)])
