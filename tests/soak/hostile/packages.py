"""3MF and STEP: packages that stand for more than they are, and entities that lead elsewhere."""

from tests.core.io.files import CUBE
from tests.core.io.step_files import Step, step_box
from tests.core.io.threemf_files import MALFORMED, mesh, model, nested, package, thing, with_coordinate
from tests.soak.hostile.case import Hostile, malformed, refused, stored

SHEET = thing(1, mesh([*CUBE] * 500, [(n, n + 1, n + 2) for n in range(3_990)]))
XML = ("billion laughs", "an external entity", "a DTD elsewhere", "laughs in the relationships")
LARGE = ("index too large", "an index of 4e9", "an index of 1e30")
CIRCLES = ("its own component", "a circle", "a circle across parts")
BROKEN = ("a damaged part", "no directory", "shorter than it says", "longer than it says", "cut in the XML")
BOX = step_box()
DEEP = 100_000


def cases() -> list[Hostile]:
    """All of them."""
    return [*_threemf(), *_step()]


def _named(names: tuple[str, ...]) -> dict[str, bytes]:
    return {f"{name.replace(' ', '-')}.3mf": MALFORMED[name] for name in names}


def _threemf() -> list[Hostile]:
    return [
        *malformed("xml", _named(XML)),
        *malformed("index-large", _named(LARGE)),
        *malformed("index-negative", _named(("a negative index",))),
        *malformed("archive", _named((*BROKEN, "two parts of one name", "a path out of the package"))),
        *malformed("instances", _named(CIRCLES)),
        *refused("empty", "empty-file", {"empty.3mf": b"", "empty.step": b""}),
        *refused("archive", "mesh-too-complex", {"members.3mf": _of_many_members}),
        Hostile("archive", "spaces.3mf", _of_spaces, 422, "mesh-too-complex", slow=True),
        *refused(
            "instances",
            "mesh-too-complex",
            {
                "layers.3mf": lambda: package(model(nested(12), [(12, None)])),
                "items.3mf": lambda: package(model(items=[(1, None)] * 100_000)),
                "sheets.3mf": lambda: package(model(SHEET, [(1, None)] * 4_000)),
            },
        ),
        *refused(
            "non-finite",
            "non-finite-coordinates",
            {f"{value}.3mf": with_coordinate(value) for value in ("NaN", "inf", "-inf", "1e999")},
        ),
        *refused("no-faces", "no-triangles", {"no-build.3mf": package(model(items=()))}),
        *stored("strange", {"cube.3mf": package()}),
    ]


def _of_spaces() -> bytes:
    """900 MB in one."""
    return package(" " * 900_000_000)


def _of_many_members() -> bytes:
    return package(parts={str(number): "" for number in range(100_000)})


def _step() -> list[Hostile]:
    file = Step()
    file.product("nothing", [], file.context("millimetre"))
    long, short = (
        BOX.replace(b"DATA;\n", b"DATA;\n#9000=%b('/etc/passwd','','',#9001,'','');\n" % entity)
        for entity in (b"DOCUMENT_FILE", b"DCMFL")
    )
    return [
        *malformed(
            "cut",
            {f"cut-{share}.step": BOX[: len(BOX) * share // 100] for share in (1, 10, 50, 84, 99)}
            | {"prose.step": b"Dear Sir or Madam,\n", "header.stp": b"ISO-10303-21;\nHEADER;\n"},
        ),
        *refused("no-faces", "no-triangles", {"nothing.step": file.data()}),
        *refused(
            "reference",
            "external-reference",
            {"elsewhere.step": long, "elsewhere-short.step": short},
        ),
        *stored("strange", {"box.step": BOX}),
        Hostile("nested", "brackets.step", _brackets, 422, "malformed-mesh", fatal=True),
    ]


def _brackets() -> bytes:
    """Return brackets in brackets, over which OpenCASCADE overflows its stack."""
    head = b"ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nENDSEC;\nDATA;\n"
    return head + b"#1=A" + b"(" * DEEP + b")" * DEEP + b";\nENDSEC;\nEND-ISO-10303-21;\n"
