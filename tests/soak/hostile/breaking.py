"""Files that end the process which reads them."""

from tests.soak.hostile.case import Hostile

DEEP = 100_000


def cases() -> list[Hostile]:
    """All of them."""
    return [Hostile("nested", "brackets.step", _brackets, 422, "malformed-mesh", fatal=True)]


def _brackets() -> bytes:
    """Brackets in brackets, over which OpenCASCADE overflows its stack."""
    head = b"ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nENDSEC;\nDATA;\n"
    return head + b"#1=A" + b"(" * DEEP + b")" * DEEP + b";\nENDSEC;\nEND-ISO-10303-21;\n"
