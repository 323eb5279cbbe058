"""JSON models of sources."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool

from service.http.problem_document import Cause
from service.shapes.fields import Tags, clean_name, storable_text
from service.shapes.schemas import Page

if TYPE_CHECKING:
    from service.storage.tables import SourceFileRow, SourceRow

State = Literal["waiting", "scanning", "ready", "offline"]
"""The state of a source. One that is `scanning` without the lease of a service waits for another scan."""

FileState = Literal["present", "missing", "refused", "unreadable"]
"""The state of a file: a shape; no longer in its folder; no mesh; or a file that the system does not open."""

PATH_CHARACTERS = 2_000
RULES = 100

Pattern = Annotated[str, AfterValidator(storable_text), Field(min_length=1, max_length=255)]
TagRules = Annotated[
    dict[Pattern, Tags],
    Field(
        max_length=RULES,
        description="More tags of the shapes that the source stores, by patterns of their paths in the "
        "folder, in the syntax of .gitignore.",
        examples=[{"brackets/": ["bracket"], "*_v[0-9].stl": ["draft"]}],
    ),
]

SOURCE: dict[str, Any] = {
    "id": "0c0f6c0a-7f0e-4d8b-8a51-0a2d1c3f9b10",
    "name": "models",
    "path": "/srv/models",
    "copies": False,
    "tags": ["printed"],
    "rules": {"brackets/": ["bracket"]},
    "state": "ready",
    "detail": None,
    "counts": {"present": 1204, "missing": 2, "refused": 7, "unreadable": 0},
    "scan": {
        "found": 1211,
        "due": 3,
        "done": 3,
        "stored": 3,
        "copies": 0,
        "changed": 0,
        "moved": 0,
        "missing": 2,
        "refused": 0,
        "left": 0,
        "seconds": 1.8,
        "unread": {},
    },
    "created_at": "2026-01-31T12:00:00Z",
    "scanned_at": "2026-01-31T12:30:00Z",
}


class NewSource(BaseModel):
    """A folder of the service's machine that becomes a source."""

    model_config = ConfigDict(extra="forbid")

    path: Annotated[str, AfterValidator(storable_text)] = Field(
        min_length=1, max_length=PATH_CHARACTERS, description="The absolute path of the folder."
    )
    name: Annotated[str, AfterValidator(clean_name)] | None = Field(
        default=None, description="Its name in lists; the name of the folder by default."
    )
    tags: Tags = Field(default=[], description="Tags of every shape that the source stores.")
    rules: TagRules = {}
    copies: StrictBool = Field(
        default=False, description="Store the bytes in the archive too, as those of an upload."
    )


class NewRules(BaseModel):
    """The rules of a source."""

    model_config = ConfigDict(extra="forbid")

    rules: TagRules


class Scan(BaseModel):
    """The counts of a scan, which grow while it runs."""

    found: int = Field(default=0, description="Mesh files in the folder.")
    due: int = Field(default=0, description="New or changed files.")
    done: int = Field(default=0, description="New or changed files with an outcome.")
    stored: int = Field(default=0, description="New shapes.")
    copies: int = Field(default=0, description="New paths of files that are shapes already.")
    changed: int = Field(default=0, description="Shapes with another file.")
    moved: int = Field(default=0, description="Shapes whose file has another path.")
    missing: int = Field(default=0, description="Files that are gone.")
    refused: int = Field(default=0, description="New or changed files that are no mesh, or cannot be read.")
    left: int = Field(default=0, description="Files that were being written; the next scan reads them.")
    seconds: float = Field(default=0.0, description="The time that the scan took.")
    unread: dict[str, str] = Field(
        default={}, description="Paths that could not be listed, at most 100, each with the reason."
    )


class Counts(BaseModel):
    """The numbers of a source's files by state."""

    present: int = Field(default=0, description="Files that are shapes.")
    missing: int = Field(
        default=0, description="Files that are gone. Their shapes stay for ISOSHAPE_UNDO_DAYS."
    )
    refused: int = Field(default=0, description="Files that are no mesh; a changed one keeps its shape.")
    unreadable: int = Field(default=0, description="Files that the system does not let the service read.")


class Source(BaseModel):
    """A folder whose mesh files are shapes of a collection and stay where they are."""

    model_config = ConfigDict(json_schema_extra={"example": SOURCE})

    id: str
    name: str
    path: str = Field(description="The real path of the folder.")
    copies: bool = Field(description="Whether the archive keeps the bytes too.")
    tags: list[str]
    rules: dict[str, list[str]] = Field(description="More tags, by patterns of paths.")
    state: State = Field(
        description="`offline`: the folder is absent or empty, or has lost more than half of its files. "
        "Nothing is taken for deleted until the folder is back or the loss is confirmed."
    )
    detail: str | None = Field(description="The reason of `offline`.")
    counts: Counts
    scan: Scan = Field(description="The scan that runs, or the latest one.")
    created_at: datetime = Field(description="UTC.")
    scanned_at: datetime | None = Field(description="UTC; the end of the latest complete scan.")

    @classmethod
    def of(cls, source: "SourceRow", counts: Mapping[str, int]) -> "Source":
        """Return the JSON of a source, and its numbers of files by state."""
        names = ("id", "name", "copies", "tags", "rules", "detail", "created_at", "scanned_at")
        state = source.state
        if source.leased_until is not None and source.leased_until > datetime.now(UTC):
            state = "scanning"
        elif source.requested or state == "scanning":
            state = "waiting"
        values: dict[str, Any] = {name: getattr(source, name) for name in names}
        return cls(
            **values,
            path=source.root,
            state=state,  # type: ignore[arg-type]
            counts=Counts.model_validate(dict(counts)),
            scan=Scan.model_validate(source.report),
        )

    @property
    def is_scanned(self) -> bool:
        """Return whether no scan runs or is asked for."""
        return self.state in {"ready", "offline"}


class Sources(BaseModel):
    """The sources of a collection, by name."""

    sources: list[Source]


class SourceFile(BaseModel):
    """A file of a source."""

    path: str = Field(description="The path from the folder of the source.")
    bytes: int
    state: FileState
    shape_id: str | None = Field(
        description="The shape; null if the file has none, or it was deleted or moved to another collection."
    )
    missing_since: datetime | None = Field(description="UTC.")
    problem: Cause | None = Field(description="The reason why the file was refused, or cannot be read.")

    @classmethod
    def of(cls, file: "SourceFileRow", shape_id: str | None) -> "SourceFile":
        """Return the JSON of a file."""
        values: dict[str, Any] = {name: getattr(file, name) for name in ("path", "state", "missing_since")}
        problem = None if file.kind is None else Cause.of(file.kind, file.detail or "")
        return cls(**values, bytes=file.size, shape_id=shape_id, problem=problem)


class SourceFilePage(Page):
    """A page of a source's files, in the order in which they were found."""

    files: list[SourceFile]


class GroupedFile(BaseModel):
    """A file of a group."""

    source_id: str
    path: str = Field(description="The absolute path on the service's machine.")
    bytes: int
    sha256: str
    role: Literal["kept", "equal", "merged"] = Field(
        description="`equal`: it has the bytes of the kept file. `merged`: its shape was merged into that of "
        "the kept file, and its bytes are others: it may be a variant."
    )
    left: str | None = Field(
        description="The reason why the file is not to be removed; null if it can go, and for the kept file."
    )


class FileGroup(BaseModel):
    """Two or more files of which one is enough: the kept one first, the others by source and path."""

    files: list[GroupedFile]


class FileGroupPage(Page):
    """A page of groups of files, those of the oldest kept shape first."""

    groups: list[FileGroup]
