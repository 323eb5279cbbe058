"""The kind of a file by its first bytes, whatever its name says: the reason why it cannot be read as that."""

import re

from core.io.formats import FORMATS, Format

_LEADING = 4096
# Bytes at the end of a ZIP in which the names of its first members are looked for.
_DIRECTORY = 1 << 20
# Kinds of files by their first bytes: what a person saves, downloads or exports in the place of a mesh.
_KINDS = (
    (rb"version https://git-lfs\.github\.com", "a pointer of Git LFS: the file itself was not downloaded"),
    (rb"(?is)\s*(?:<!--.*?-->\s*)?(?:<!doctype html|<html|<head)", "a web page (HTML)"),
    (rb"\x1f\x8b", "compressed (gzip)"),
    (rb"BZh[1-9]1AY&SY", "compressed (bzip2)"),
    (rb"\xfd7zXZ\0", "compressed (xz)"),
    (rb"7z\xbc\xaf\x27\x1c", "compressed (7z)"),
    (rb"Rar!\x1a\x07", "compressed (RAR)"),
    (rb"\(\xb5/\xfd", "compressed (Zstandard)"),
    (rb"Kaydara FBX Binary|; FBX", "an FBX"),
    (rb"BLENDER", "a Blender file"),
    (rb"#VRML|#X3D", "a VRML"),
    (rb"(?s)\s*<\?xml.*?<COLLADA", "a COLLADA"),
    (rb"(?s)\s*<\?xml.*?<X3D", "an X3D"),
    (rb"(?s)\s*<\?xml.*?<amf", "an AMF"),
    (rb"(?s)\s*<\?xml.*?<svg|<svg", "a picture (SVG)"),
    (rb"DBRep_DrawableShape|(?:CASCADE|Open CASCADE) Topology V", "a BREP of OpenCASCADE"),
    (rb"xof 0", "an X file of DirectX"),
    (rb"AC10[0-9]{2}", "a drawing of AutoCAD (DWG)"),
    (rb"(?s)\s*0\r?\nSECTION", "a drawing (DXF)"),
    (rb"MZ|\x7fELF", "a program"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|BM.{4}\0\0\0\0", "a picture"),
    (rb"%PDF", "a PDF"),
    (rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a file of a CAD program or of Microsoft Office (OLE)"),
)
_KINDS_BY_PATTERN = tuple((re.compile(start), kind) for start, kind in _KINDS)
# Formats of text by a line among the first, in the order of the strictest.
_TEXTS = (
    ("iges", rb"[^\r\n]{72}S *0*1\b"),
    ("ply", rb"ply[ \t]*[\r\n]"),
    ("off", rb"(?:ST)?C?N?[4n]?OFF\b|off[ \t]*[\r\n]"),
    ("stl", rb"(?is)\s*solid\b.*?facet\s"),
    ("obj", rb"(?s)(?:\A|.*?[\r\n])[ \t]*v[ \t]+[-+0-9.]"),
)
_TEXTS_BY_PATTERN = tuple((FORMATS[name], re.compile(start)) for name, start in _TEXTS)


def recognised(data: bytes) -> "str | Format | None":
    """Return what a file is by bytes that nothing else begins with: a kind, or a format; None if unsure."""
    start = data[:_LEADING].lstrip(b"\xef\xbb\xbf \t\r\n")
    for format in FORMATS.values():
        if format.magic and start.startswith(format.magic):
            if format.name == "3mf" and b".model" not in data[-_DIRECTORY:].lower():
                return "a ZIP without a 3MF"
            return format
    return next((kind for pattern, kind in _KINDS_BY_PATTERN if pattern.match(start)), None)


def recognised_text(data: bytes) -> Format | None:
    """Return the format of text that a file looks like; it may be another, so ask only if reading failed."""
    start = data[:_LEADING].removeprefix(b"\xef\xbb\xbf")
    formats = (format for format, pattern in _TEXTS_BY_PATTERN if pattern.match(start))
    # A PLY may go on in binary.
    return next((format for format in formats if format.name == "ply" or b"\0" not in start), None)
