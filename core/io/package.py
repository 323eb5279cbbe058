"""A ZIP of parts, as the package of a 3MF (ISO/IEC 29500-2): unpacked in memory within limits; packed."""

import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from urllib.parse import unquote
from xml.parsers import expat

from core.errors import ExternalReferenceError, MalformedMeshError, MeshTooComplexError
from core.io.checks import Limits, within

Start = Callable[[str, dict[str, str]], object]
"""Handler of an element: its name, preceded by its namespace and a space, and its attributes likewise."""

_MEMBERS = 65_536
_PIECE = 1 << 20
_UNBOUND_PREFIX = expat.errors.codes[expat.errors.XML_ERROR_UNBOUND_PREFIX]
# An older expat begins again at the start of a tag or a comment whenever more of it comes.
_TAG_BYTES = 4 << 20
# Bytes that a row of a model takes in text, and bytes that the rest of a package may take.
_ROW_BYTES = 128
_OTHER_BYTES = 16 << 20
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1 | 0x40 | 0x2000
_RELATIONSHIPS = "_rels/.rels"
_USUAL = "/3d/3dmodel.model"
_RELATIONSHIP = "http://schemas.openxmlformats.org/package/2006/relationships Relationship"
_MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
# The parts of a written package.
_XML = b'<?xml version="1.0" encoding="UTF-8"?>\n'
_TYPES = (
    b'<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    b'<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    b'<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    b"</Types>\n"
)
_ROOT_RELATIONSHIPS = (
    b'<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    b'<Relationship Id="r1" Target="/3D/3dmodel.model" '
    b'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
)
_BEGIN = (
    b'<model unit="millimeter" xml:lang="en-US" '
    b'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n'
    b'<resources><object id="1" type="model"><mesh>\n<vertices>\n'
)
_BETWEEN = b"</vertices>\n<triangles>\n"
_END = b'</triangles>\n</mesh></object></resources>\n<build><item objectid="1"/></build>\n</model>\n'
# The earliest time that a ZIP can hold, and the number of the system (Unix) that wrote it.
_TIME = (1980, 1, 1, 0, 0, 0)
_UNIX = 3


class Package:
    """The parts of a package, by canonical name; `title` is that of the format in messages.

    The parts that are read have at most 128 bytes for each vertex and face of the limits, plus 16 MiB. Raise
    MalformedMeshError if the data are not a ZIP or a name occurs twice, and MeshTooComplexError if there are
    more than 65,536 members.
    """

    def __init__(self, data: bytes, limits: Limits, title: str = "3MF") -> None:
        self._title = title
        within(data.count(b"PK\x01\x02"), _MEMBERS, "members")
        try:
            self._archive = zipfile.ZipFile(BytesIO(data))
            members = self._archive.infolist()
        except Exception:
            raise MalformedMeshError(f"the {title} is not a ZIP file, or is cut short") from None
        self._parts = {canonical(member.filename): member for member in members}
        if len(self._parts) < len(members):
            raise MalformedMeshError(f"the {title} has two parts of one name")
        self._left = _ROW_BYTES * (limits.vertices + limits.faces) + _OTHER_BYTES

    def names(self) -> tuple[str, ...]:
        """Return the canonical names of the parts."""
        return tuple(self._parts)

    def read(self, name: str) -> bytes:
        """Return the bytes of a part; errors are those of `parse`."""
        return b"".join(self._pieces(name))

    def model(self) -> str:
        """Return the canonical name of the package's start part.

        If the package names none, or one that it lacks, that is its only model of the usual name. Raise
        MalformedMeshError if there is none, ExternalReferenceError if it is outside the package.
        """
        relationships: list[dict[str, str]] = []

        def start(name: str, attributes: dict[str, str]) -> None:
            if name == _RELATIONSHIP and attributes.get("Type") == _MODEL:
                relationships.append(attributes)

        if _RELATIONSHIPS in self._parts:
            self.parse(_RELATIONSHIPS, start)
        if relationships and relationships[0].get("TargetMode", "Internal") != "Internal":
            raise ExternalReferenceError("the model of the 3MF is not in it")
        named = canonical(relationships[0].get("Target", "")) if relationships else ""
        if named in self._parts:
            return named
        usual = [name for name in self._parts if f"/{name}".endswith(_USUAL)]
        if len(usual) != 1:
            raise MalformedMeshError("the ZIP is not a 3MF: it does not say which of its parts is the model")
        return usual[0]

    def parse(
        self,
        name: str,
        start: Start,
        end: Callable[[str], object] = lambda name: None,
        namespace: Callable[[str | None, str], object] = lambda prefix, address: None,
    ) -> None:
        """Parse a part as XML; a document type declaration, and with it any entity, is an error.

        `name` need not be canonical. `start` and `end` are called for each
        element, and `namespace` with prefixes and their namespaces. Raise MalformedMeshError if the part is
        missing or not well-formed, and MeshTooComplexError if it has too many bytes.
        """
        parser = expat.ParserCreate(namespace_separator=" ")

        def refuse(*_: object) -> None:
            raise MalformedMeshError("the XML of the 3MF has a document type, which the format forbids")

        parser.StartElementHandler = start
        parser.EndElementHandler = end
        parser.StartNamespaceDeclHandler = namespace
        parser.StartDoctypeDeclHandler = refuse
        fed = 0
        try:
            for piece in self._pieces(name):
                parser.Parse(piece, False)
                fed += len(piece)
                within(fed - parser.CurrentByteIndex, _TAG_BYTES, "bytes in one tag or comment")
            parser.Parse(b"", True)
        except expat.ExpatError as error:
            if error.code == _UNBOUND_PREFIX:
                raise MalformedMeshError(
                    "the XML of the 3MF uses a prefix that it does not declare"
                ) from None
            raise MalformedMeshError("a part of the 3MF is not sound XML, or is cut short") from None

    def _pieces(self, name: str) -> Iterator[bytes]:
        """Yield the bytes of a part, at most the number in the directory, which is checked first."""
        member = self._parts.get(canonical(name))
        if member is None:
            raise MalformedMeshError(f"the {self._title} refers to a part that is not there")
        if member.flag_bits & _ENCRYPTED or member.compress_type not in _METHODS:
            raise MalformedMeshError(
                f"a part of the {self._title} is encrypted, or compressed in a way that is not read"
            )
        if member.file_size > self._left:
            raise MeshTooComplexError(
                f"a part of the {self._title} unpacks to {member.file_size} bytes; "
                f"at most {self._left} are read"
            )
        self._left -= member.file_size
        size = 0
        try:
            with self._archive.open(member) as opened:
                while piece := opened.read(_PIECE):
                    size += len(piece)
                    yield piece
        except MemoryError:
            raise
        except Exception:
            raise MalformedMeshError(
                f"a part of the {self._title} cannot be unpacked: it is damaged"
            ) from None
        if size != member.file_size:
            raise MalformedMeshError(f"a part of the {self._title} has fewer bytes than it should")


def canonical(part: str) -> str:
    """Return the canonical name of a part: in lower case, with slashes, without the first and without %20."""
    return unquote(part).replace("\\", "/").lower().removeprefix("/")


def pack(vertices: bytes, triangles: bytes) -> bytes:
    """Return the package of one object, from the XML of its vertices and triangles (3MF Core, section 4)."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as package:
        for name, pieces in (
            ("[Content_Types].xml", (_TYPES,)),
            ("_rels/.rels", (_ROOT_RELATIONSHIPS,)),
            ("3D/3dmodel.model", (_BEGIN, vertices, _BETWEEN, triangles, _END)),
        ):
            entry = zipfile.ZipInfo(name, _TIME)
            entry.compress_type, entry.create_system = zipfile.ZIP_DEFLATED, _UNIX
            with package.open(entry, "w") as member:
                for piece in (_XML, *pieces):
                    member.write(piece)
    return file.getvalue()
