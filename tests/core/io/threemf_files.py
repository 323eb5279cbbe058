"""Small 3MF packages, sound and faulty."""

import io
import struct
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


MOVED = "1 0 0 0 1 0 0 0 1 10 20 30"
OTHER = "/3D/Objects/other.model"
BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"


def entities(count):
    return "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(count))


LAUGHS = f'<!DOCTYPE model [<!ENTITY a "ha">{entities(9)}]>\n'
OUTSIDE = '<!DOCTYPE model [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n'
ELSEWHERE = '<!DOCTYPE model SYSTEM "http://127.0.0.1:1/x.dtd">\n'
SOUND = package()


def nested(levels, times=10):
    """Objects of objects: 10^levels places of a cube in a few lines."""
    return thing(0) + "".join(thing(n, components(*[(n - 1, None)] * times)) for n in range(1, levels + 1))


def with_corner(value):
    return package(model().replace('v1="0"', f'v1="{value}"', 1))


def with_coordinate(value):
    return package(model().replace('x="0.0"', f'x="{value}"', 1))


def declared(size):
    """The length of the model, said to be another in the directory and before the part."""
    place = SOUND.rindex(b"3D/3dmodel.model") - 46
    found = struct.unpack_from("<I", SOUND, place + 24)[0]
    return SOUND[: place + 24] + struct.pack("<I", size) + SOUND[place + 28 :], found


MALFORMED = {
    "not a ZIP": b"3D model",
    "a ZIP of nothing": package(None, {"3D/3dmodel.model": None, "_rels/.rels": None}),
    "billion laughs": package(model(before=LAUGHS).replace("millimeter", "&j;")),
    "an external entity": package(model(before=OUTSIDE).replace("</build>", "&e;</build>")),
    "a DTD elsewhere": package(model(before=ELSEWHERE)),
    "laughs in the relationships": package(rels=RELS.replace("<Rel", LAUGHS + "<Rel", 1)),
    "not XML": package("v 0 0 0\n"),
    "another document": package("<svg xmlns='http://www.w3.org/2000/svg'/>"),
    "another namespace": package(model().replace("core/2015/02", "core/2099/02")),
    "cut in the XML": package(model()[:-40]),
    "bytes that are no text": package(model().encode().replace(b"millimeter", b"\xff\xfe\xff")),
    "an unknown encoding": package(model().replace("UTF-8", "klingon")),
    "an unknown unit": package(model(head='unit="parsec"')),
    "an unknown extension": package(model(head=f'xmlns:b="{BEAMS}" requiredextensions="b"')),
    "an undeclared extension": package(model(head='requiredextensions="q"')),
    "index too large": with_corner(8),
    "a negative index": with_corner(-1),
    "an index of 4e9": with_corner(4_000_000_000),
    "an index of 1e30": with_corner("1" + "0" * 30),
    "half an index": with_corner(0.5),
    "no index": with_corner(""),
    "an index in words": with_corner("one"),
    "a coordinate in words": with_coordinate("one"),
    "a coordinate with an underscore": with_coordinate("1_0"),
    "a coordinate in other digits": with_coordinate("١"),
    "a vertex of two": package(model().replace(' z="0.0"', "", 1)),
    "a triangle of two": package(model().replace(' v3="', ' v4="', 1)),
    "a transform of eleven": package(model(items=[(1, "1 0 0 0 1 0 0 0 1 0 0")])),
    "a transform of words": package(model(items=[(1, "a b c d e f g h i j k l")])),
    "an object without an id": package(model().replace(' id="1"', "")),
    "one id twice": package(model(thing(1) + thing(1))),
    "no such object": package(model(items=[(2, None)])),
    "no such component": package(model(thing(1, components((9, None))))),
    "no such part": package(model(items=[(1, None, "/3D/none.model")])),
    "its own component": package(model(thing(1, components((1, None))))),
    "a circle": package(model(thing(1, components((2, None))) + thing(2, components((1, None))))),
    "a circle across parts": package(
        model(thing(1, components((2, None, OTHER)))),
        {OTHER[1:]: model(thing(2, components((1, None, "/3D/3dmodel.model"))), ())},
    ),
    "two units": package(
        model(items=[(7, None, OTHER)]), {OTHER[1:]: model(thing(7), (), head='unit="inch"')}
    ),
    "two parts of one name": package(parts={"3d/3DMODEL.model": model()}),
    "a damaged part": SOUND.replace(SOUND[300:310], bytes(10), 1),
    "no directory": SOUND[:-60],
    "shorter than it says": declared(10_000_000)[0],
    "longer than it says": declared(100)[0],
}  # fmt: skip
