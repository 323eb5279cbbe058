"""The package of a 3MF: a ZIP of parts (ISO/IEC 29500-2), of which little is unpacked, and none to a file."""

import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from xml.parsers import expat

from core.errors import ExternalReferenceError, MalformedMeshError, MeshTooComplexError
from core.io.checks import Limits, within

Start = Callable[[str, dict[str, str]], object]
"""Told of an element: its name behind its namespace and a space, and its attributes likewise."""

_MEMBERS = 65_536
_PIECE = 1 << 20
# An older expat begins again at the start of a tag or a comment whenever more of it comes.
_TAG_BYTES = 4 << 20
# What a row of a model takes in text, and what the rest of a package may take.
_ROW_BYTES = 128
_OTHER_BYTES = 16 << 20
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1 | 0x40 | 0x2000
_RELATIONSHIPS = "_rels/.rels"
_RELATIONSHIP = "http://schemas.openxmlformats.org/package/2006/relationships Relationship"
_MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"


class Package:
    """The parts of a package, by name.

    Parameters
    ----------
    data : bytes
        The ZIP.
    limits : Limits
        All parts that are read have at most 128 bytes for each vertex and face of the limits, and 16 MiB.

    Raises
    ------
    MalformedMeshError
        It is no ZIP, or has one name twice.
    MeshTooComplexError
        It has more than 65,536 members.
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
        """Return the name of the part that the package starts from.

        Raises
        ------
        MalformedMeshError
            It names none.
        ExternalReferenceError
            It lies elsewhere.
        """
        found: list[dict[str, str]] = []

        def start(name: str, attributes: dict[str, str]) -> None:
            if name == _RELATIONSHIP and attributes.get("Type") == _MODEL:
                found.append(attributes)

        self.parse(_RELATIONSHIPS, start)
        if not found or "Target" not in found[0]:
            raise MalformedMeshError("the ZIP is not a 3MF: it does not say which of its parts is the model")
        if found[0].get("TargetMode", "Internal") != "Internal":
            raise ExternalReferenceError("the model of the 3MF is not in it")
        return found[0]["Target"]

    def parse(
        self,
        name: str,
        start: Start,
        end: Callable[[str], object] = lambda name: None,
        namespace: Callable[[str | None, str], object] = lambda prefix, address: None,
    ) -> None:
        """Read a part as XML; a document type, and with it any entity, is refused.

        Parameters
        ----------
        name : str
            As relationships name it: in any case of letters, with or without a slash in front.
        start, end : callable
            Told when an element begins and ends.
        namespace : callable
            Told of prefixes and their namespaces.

        Raises
        ------
        MalformedMeshError
            There is no such part, or it is not plain XML.
        MeshTooComplexError
            It has too many bytes.
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
        """Yield the bytes of a part: never more than the directory says, which is checked first."""
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
