"""Small IGES files (5.3) of bilinear patches, in lines of 80 columns."""

UNITS = {1: "4HINCH", 2: "2HMM", 6: "1HM"}


def iges(patches, unit=2):
    """Untrimmed patches (entity 128), each of corners (0, 0), (1, 0), (0, 1), (1, 1), in one of `UNITS`."""
    about = "1H,,1H;,5Hpatch,5Hpatch,4Htest,4Htest,32,38,6,308,15,5Hpatch,1.,%d,%s,1,0.01,15H20260101.000000,"
    about = about % (unit, UNITS[unit]) + "1E-06,100.,4Htest,4Htest,11,0,15H20260101.000000;"
    sections = {"S": ["patches"], "G": cut(about, 72), "D": [], "P": []}
    for patch in patches:
        knots, weights = [0.0, 0.0, 1.0, 1.0] * 2, [1.0] * 4
        points = [float(coordinate) for corner in patch for coordinate in corner]
        values = [128, 1, 1, 1, 1, 0, 0, 1, 0, 0, *knots, *weights, *points, 0.0, 1.0, 0.0, 1.0]
        rows = cut(",".join(map(str, values)) + ";", 64)
        start, number = len(sections["P"]) + 1, len(sections["D"]) + 1
        sections["D"] += [
            "".join(f"{value:>8}" for value in (128, start, 0, 0, 0, 0, 0, 0, "00000000")),
            "".join(f"{value:>8}" for value in (128, 0, 0, len(rows), 0, "", "", "", 0)),
        ]
        sections["P"] += [f"{row:<64}{number:>8}" for row in rows]
    lines = [
        f"{row:<72}{letter}{number:>7}"
        for letter, rows in sections.items()
        for number, row in enumerate(rows, start=1)
    ]
    counts = "".join(f"{letter}{len(rows):>7}" for letter, rows in sections.items())
    return "\n".join([*lines, f"{counts:<72}T{1:>7}", ""]).encode()


def cut(text, width):
    """Pieces that end at commas."""
    pieces = []
    while len(text) > width:
        end = text.rindex(",", 0, width) + 1
        pieces.append(text[:end])
        text = text[end:]
    return [*pieces, text]
