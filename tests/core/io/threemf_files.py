"""Small 3MF files, sound and otherwise, made part by part."""

import io
import zipfile

from tests.core.io.files import CUBE, TRIANGLES

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
RELS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Id="r0" Type="{MODEL}" Target="/3D/3dmodel.model"/></Relationships>'
)
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    "</Types>"
)


def mesh(vertices=CUBE, faces=TRIANGLES):
    rows = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in as_floats(vertices))
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    return f"<mesh><vertices>{rows}</vertices><triangles>{corners}</triangles></mesh>"


def as_floats(rows):
    return [[float(value) for value in row] for row in rows]


def thing(number, inside=None, **attributes):
    """An object."""
    more = "".join(f' {name}="{value}"' for name, value in attributes.items())
    return f'<object id="{number}"{more}>{mesh() if inside is None else inside}</object>'


def components(*placed):
    """What a component object holds: ids, each with its transform or None."""
    return "<components>" + "".join(_reference("component", *one) for one in placed) + "</components>"


def model(objects=None, items=((1, None),), head='unit="millimeter"', before=""):
    objects = thing(1) if objects is None else objects
    build = "".join(_reference("item", *one) for one in items)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n{before}'
        f'<model xmlns="{CORE}" xmlns:p="{PRODUCTION}" {head}>'
        f"<resources>{objects}</resources><build>{build}</build></model>"
    )


def package(text=None, parts=None, rels=RELS, method=zipfile.ZIP_DEFLATED):
    """The ZIP: the model, and other parts by name."""
    buffer = io.BytesIO()
    inside = {
        "[Content_Types].xml": TYPES,
        "_rels/.rels": rels,
        "3D/3dmodel.model": model() if text is None else text,
    }
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, data in {**inside, **(parts or {})}.items():
            if data is not None:
                archive.writestr(zipfile.ZipInfo(name), data, compress_type=method)
    return buffer.getvalue()


def _reference(tag, number, transform=None, path=None):
    return (
        f'<{tag} objectid="{number}"'
        + (f' transform="{transform}"' if transform else "")
        + (f' p:path="{path}"' if path else "")
        + "/>"
    )
