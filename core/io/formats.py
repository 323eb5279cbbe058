"""The table of file formats: the facts that readers, writers, endpoints and the page need about each."""

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

from core.errors import UnknownFormatError

if TYPE_CHECKING:
    from core.io.checks import Content, Limits
    from core.io.parts import Part
    from core.mesh.mesh import Mesh


class Form(NamedTuple):
    """A form of the files of a format: their first bytes, the endings of their names and their media type."""

    magic: bytes
    endings: tuple[str, ...]
    media_type: str


@dataclass(frozen=True)
class Format:
    """A file format.

    Attributes
    ----------
    endings : tuple of str
        The endings of file names, in lower case; the first one is that of written files.
    module : str
        The module with the functions `read`, `write` if the format is written, and `read_parts` if its files
        are split into parts, as the methods call them. It is imported on first use: the names of formats need
        no reader.
    media_type : str
        The registered media type, or that of any bytes.
    magic : bytes
        The first bytes that no file of another format has, white space aside; empty if there are none.
    millimetres : float
        Millimetres in the unit of the format; 0 if files do not state their unit. Meshes of a format with a
        unit are read and written in millimetres.
    y_up : bool
        Whether y is the upward axis by convention of most programs; otherwise z is.
    vertex_bytes, face_bytes : int
        The largest size of a vertex and of a face in a written file, before compression; zero faces if the
        format is not written.
    splits : bool
        Whether files are assemblies, which `read_parts` splits.
    package : str
        The package that the reader needs beyond those of every installation; empty if none.
    variants : tuple of Form
        The forms of files that are read beside the one that is written; the first that fits is taken.
    """

    endings: tuple[str, ...]
    module: str
    media_type: str = "application/octet-stream"
    magic: bytes = b""
    millimetres: float = 0.0
    y_up: bool = False
    vertex_bytes: int = 0
    face_bytes: int = 0
    splits: bool = False
    package: str = ""
    variants: tuple[Form, ...] = ()

    @property
    def name(self) -> str:
        """The name in requests and records: the first ending."""
        return self.endings[0]

    @property
    def title(self) -> str:
        """The name in messages."""
        return self.name.upper()

    @property
    def is_read(self) -> bool:
        """Whether the package of the reader is installed."""
        return not self.package or find_spec(self.package) is not None

    @property
    def is_written(self) -> bool:
        """Whether there is a writer."""
        return self.face_bytes > 0

    @property
    def unit(self) -> str:
        """Return the unit of meshes that are read: "mm", or "" if the format does not state it."""
        return "mm" if self.millimetres else ""

    @property
    def written(self) -> Form:
        """The form of the files that are written."""
        others = {ending for form in self.variants for ending in form.endings}
        own = tuple(ending for ending in self.endings if ending not in others)
        return Form(self.magic, own, self.media_type)

    @property
    def forms(self) -> tuple[Form, ...]:
        """The forms of the files that are read, the written one first."""
        return self.written, *self.variants

    def form_of(self, data: bytes) -> Form:
        """Return the form of a file that is read."""
        return next((form for form in self.forms if data.startswith(form.magic)), self.written)

    def read(self, data: bytes, limits: "Limits") -> "Content":
        """Return the mesh of a file, and warnings.

        Raise a MeshError, whose subclass tells the kind of fault, if it is malformed or exceeds the limits.
        """
        content: Content = import_module(self.module).read(data, limits)
        return content

    def read_parts(self, data: bytes, limits: "Limits") -> "list[Part]":
        """Return the distinct parts of an assembly; errors are those of `read`."""
        parts: list[Part] = import_module(self.module).read_parts(data, limits)
        return parts

    def write(self, mesh: "Mesh") -> bytes:
        """Return the bytes of a file."""
        data: bytes = import_module(self.module).write(mesh)
        return data


# STL repeats vertices in its faces. OFF and PLY have no registered media type.
_TABLE = (
    Format(("stl",), "core.io.stl", "model/stl", vertex_bytes=0, face_bytes=50),
    Format(("obj",), "core.io.obj", "model/obj", y_up=True, vertex_bytes=80, face_bytes=30),
    Format(("ply",), "core.io.ply", vertex_bytes=12, face_bytes=13),
    Format(("off",), "core.io.off", vertex_bytes=78, face_bytes=31),
    Format(
        ("glb", "gltf"),
        "core.io.glb",
        "model/gltf-binary",
        b"glTF",
        millimetres=1_000.0,
        y_up=True,
        vertex_bytes=12,
        face_bytes=12,
        variants=(Form(b"PK\x03\x04", ("zip",), "application/zip"), Form(b"", ("gltf",), "model/gltf+json")),
    ),
    Format(
        ("3mf",),
        "core.io.threemf",
        "model/3mf",
        b"PK\x03\x04",
        millimetres=1.0,
        vertex_bytes=98,
        face_bytes=58,
        splits=True,
    ),
    Format(
        ("step", "stp"),
        "core.io.step",
        "model/step",
        b"ISO-10303-21;",
        millimetres=1.0,
        splits=True,
        package="cascadio",
    ),
    Format(("iges", "igs"), "core.io.iges", "model/iges", millimetres=1.0, package="cascadio"),
)

FORMATS: dict[str, Format] = {format.name: format for format in _TABLE}
"""The formats by name."""


def readable() -> tuple[str, ...]:
    """Return the names of the formats whose readers are installed."""
    return tuple(format.name for format in FORMATS.values() if format.is_read)


def writable() -> tuple[str, ...]:
    """Return the names of the formats that are written."""
    return tuple(format.name for format in FORMATS.values() if format.is_written)


def by_ending(ending: str) -> Format | None:
    """Return the format with an ending of file names, in any case, whether or not its reader is installed."""
    return next((format for format in FORMATS.values() if ending.lower() in format.endings), None)


def read_format(ending: str) -> Format:
    """Return the format of an ending; raise UnknownFormatError if none with a reader here has it.

    A ZIP is that of a glTF and its files.
    """
    format = by_ending("gltf" if ending.lower() == "zip" else ending)
    if format is None:
        raise UnknownFormatError(f"the format {_shown(ending)} is not one of {', '.join(readable())}")
    if not format.is_read:
        raise UnknownFormatError(
            f"{format.title} is not read here: it needs the extra 'step', as pip install 'isoshape[step]'"
        )
    return format


def written_format(name: str) -> Format:
    """Return a format by its name in any case; raise UnknownFormatError if it is not one of `writable()`."""
    format = FORMATS.get(name.lower())
    if format is None or not format.is_written:
        raise UnknownFormatError(
            f"the format {_shown(name)} is not one that is written: {', '.join(writable())}"
        )
    return format


def format_of(filename: str) -> str:
    """Return the name of the format of a file name, by the text after its last dot, in any case.

    Raise UnknownFormatError if no format has this ending, or its reader is not installed.
    """
    return read_format(filename.rpartition(".")[2] if "." in filename else "").name


def _shown(name: str) -> str:
    """Return the name of a format from a request, shortened and reduced to letters and digits."""
    letters = "".join(letter for letter in name.lower()[:16] if letter.isalnum())
    return letters or "of a file without an extension"
