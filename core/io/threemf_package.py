"""The package of a 3MF, a ZIP of parts (ISO/IEC 29500-2): unpacked in memory, within limits, and packed."""

import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from xml.parsers import expat

from core.errors import ExternalReferenceError, MalformedMeshError, MeshTooComplexError
from core.io.checks import Limits, within

Start = Callable[[str, dict[str, str]], object]
"""Handler of an element: its name, preceded by its namespace and a space, and its attributes likewise."""

_MEMBERS = 65_536
_PIECE = 1 << 20
# An older expat begins again at the start of a tag or a comment whenever more of it comes.
_TAG_BYTES = 4 << 20
# Bytes that a row of a model takes in text, and bytes that the rest of a package may take.
_ROW_BYTES = 128
_OTHER_BYTES = 16 << 20
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1 | 0x40 | 0x2000
_RELATIONSHIPS = "_rels/.rels"
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
    """The parts of a package, by name.

    The parts that are read have at most 128 bytes for each vertex and face of the limits, plus 16 MiB. Raise
    MalformedMeshError if the data are not a ZIP or a name occurs twice, and MeshTooComplexError if there are
    more than 65,536 members.
    """

    def __init__(self, data: bytes, limits: Limits) -> None:
        within(data.count(b"PK\x01\x02"), _MEMBERS, "members")
        try:
            self._archive = zipfile.ZipFile(BytesIO(data))
            members = self._archive.infolist()
        except Exception:
            raise MalformedMeshError("the 3MF is not a ZIP file, or is cut short") from None
        self._parts = {member.filename.lower(): member for member in members}
        if len(self._parts) < len(members):
            raise MalformedMeshError("the 3MF has two parts of one name")
        self._left = _ROW_BYTES * (limits.vertices + limits.faces) + _OTHER_BYTES

    def model(self) -> str:
        """Return the name of the package's start part.

        Raise MalformedMeshError if it names none, ExternalReferenceError if that is outside the package.
        """
        relationships: list[dict[str, str]] = []

        def start(name: str, attributes: dict[str, str]) -> None:
            if name == _RELATIONSHIP and attributes.get("Type") == _MODEL:
                relationships.append(attributes)

        self.parse(_RELATIONSHIPS, start)
        if not relationships or "Target" not in relationships[0]:
            raise MalformedMeshError("the ZIP is not a 3MF: it does not say which of its parts is the model")
        if relationships[0].get("TargetMode", "Internal") != "Internal":
            raise ExternalReferenceError("the model of the 3MF is not in it")
        return relationships[0]["Target"]

    def parse(
        self,
        name: str,
        start: Start,
        end: Callable[[str], object] = lambda name: None,
        namespace: Callable[[str | None, str], object] = lambda prefix, address: None,
    ) -> None:
        """Parse a part as XML; a document type declaration, and with it any entity, is an error.

        `name` is case-insensitive, with or without a leading slash. `start` and `end` are called for each
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
        except expat.ExpatError:
            raise MalformedMeshError("a part of the 3MF is not sound XML, or is cut short") from None

    def _pieces(self, name: str) -> Iterator[bytes]:
        """Yield the bytes of a part, at most the number in the directory, which is checked first."""
        member = self._parts.get(name.lower().removeprefix("/"))
        if member is None:
            raise MalformedMeshError("the 3MF refers to a part that is not there")
        if member.flag_bits & _ENCRYPTED or member.compress_type not in _METHODS:
            raise MalformedMeshError(
                "a part of the 3MF is encrypted, or compressed in a way that 3MF does not know"
            )
        if member.file_size > self._left:
            raise MeshTooComplexError(
                f"a part of the 3MF unpacks to {member.file_size} bytes; at most {self._left} are read"
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
            raise MalformedMeshError("a part of the 3MF cannot be unpacked: it is damaged") from None
        if size != member.file_size:
            raise MalformedMeshError("a part of the 3MF has fewer bytes than it should")


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
