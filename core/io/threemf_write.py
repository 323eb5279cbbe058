"""Writing a mesh as a 3MF of one object and one build item (3MF Core Specification 1.3)."""

import zipfile
from io import BytesIO

from core.errors import NoTrianglesError
from core.io.text import face_lines, vertex_lines
from core.mesh.mesh import Mesh

_XML = b'<?xml version="1.0" encoding="UTF-8"?>\n'
_TYPES = (
    b'<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    b'<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    b'<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    b"</Types>\n"
)
_RELATIONSHIPS = (
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


def write(mesh: Mesh) -> bytes:
    """Write a mesh, with its coordinates in millimetres.

    The format forbids faces that name a vertex twice; they are left out. Nothing else changes: an open
    surface stays open.

    Raises
    ------
    NoTrianglesError
        Every face names a vertex twice.
    """
    a, b, c = mesh.faces.T
    faces = mesh.faces[(a != b) & (b != c) & (c != a)]
    if not len(faces):
        raise NoTrianglesError("each face of the mesh names a vertex twice, which a 3MF may not hold")
    vertices = vertex_lines(mesh.vertices, '<vertex x="%r" y="%r" z="%r"/>\n')
    triangles = face_lines(faces, '<triangle v1="%d" v2="%d" v3="%d"/>\n')
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as package:
        for name, parts in (
            ("[Content_Types].xml", (_TYPES,)),
            ("_rels/.rels", (_RELATIONSHIPS,)),
            ("3D/3dmodel.model", (_BEGIN, vertices, _BETWEEN, triangles, _END)),
        ):
            about = zipfile.ZipInfo(name, _TIME)
            about.compress_type, about.create_system = zipfile.ZIP_DEFLATED, _UNIX
            with package.open(about, "w") as member:
                for part in (_XML, *parts):
                    member.write(part)
    return file.getvalue()
