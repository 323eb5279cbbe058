"""Things made by people: chair, cup, plane, pliers, glasses."""

import numpy as np
from numpy.random import Generator

from core.gallery.solids import Frame, Part, box, mirrored, plate, revolved, tube


def chair(rng: Generator) -> list[Part]:
    """Build a seat, a closed back and four splayed legs."""
    u = rng.uniform
    width, depth, thick = u(0.42, 0.58), u(0.4, 0.55), u(0.05, 0.08)
    legs, back, tilt = u(0.35, 0.6), u(0.4, 0.8), u(-3, 18)
    seat = Frame()
    parts = [box(seat, (depth, width, thick), rounding=0.022, blend=0.0)]
    rest = seat.move(-0.5 * depth + 0.03).rotate("y", -tilt)
    narrow = u(0.65, 1.05)
    right = [(0.0, -0.45 * width), (back, -0.45 * narrow * width)]
    if u() < 0.4:
        right.append((back + 0.1, -0.2 * width))
    outline = [*right, *mirrored(right[::-1], -1)]
    parts.append(plate(rest.rotate("y", -90), outline, thick * 0.9, blend=0.03))
    stout, splay = u(0.026, 0.04), u(0.0, 0.14)
    for x in (-1, 1):
        for y in (-1, 1):
            top = seat.move(x * (0.5 * depth - 0.06), y * (0.5 * width - 0.06))
            foot = top.at(x * splay, y * splay, -legs)
            parts.append(tube([top.origin, foot], [stout * 1.15, stout], blend=0.02))
    return parts


def cup(rng: Generator) -> list[Part]:
    """Build a hollow turned body with a floor and one handle."""
    u = rng.uniform
    height, bottom, top = u(0.7, 1.2), u(0.28, 0.42), u(0.36, 0.5)
    wall, belly = u(0.035, 0.05), u(-0.05, 0.1)
    levels = np.linspace(0.0, 1.0, 9)
    radii = bottom + (top - bottom) * levels + belly * np.sin(np.pi * levels)
    # Up the outside, down the inside: two lines that the rounding makes into a wall.
    floor, gap = 0.07, 0.02
    heights, depths = height * levels, floor + (height - floor) * levels
    outside = np.column_stack([radii, heights])
    inside = np.column_stack([radii - gap, depths])[::-1]
    profile = np.vstack([[0.0, 0.0], outside, inside, [0.0, floor]])
    parts = [revolved(Frame(), profile, wall, blend=0.0)]
    middle, span, reach = u(0.45, 0.6) * height, u(0.24, 0.34) * height, u(0.2, 0.36)
    angles = np.radians(np.linspace(-80, 80, 11))
    up = middle + span * np.sin(angles)
    out = np.interp(up, heights, radii) + reach * np.cos(angles) ** 0.6
    loop = np.column_stack([out, np.zeros(11), up])
    # Its ends go into the wall.
    loop[[0, -1], 0] = np.interp(up[[0, -1]], heights, radii)
    parts.append(tube(loop, np.full(11, u(0.045, 0.065)), blend=0.03))
    return parts


def plane(rng: Generator) -> list[Part]:
    """Build an airliner: fuselage, swept wings with engines under them, tail fin and tail planes."""
    u = rng.uniform
    long, thick = u(1.7, 2.3), u(0.1, 0.14)
    body = Frame()
    hull = [(-0.5, 0.45, 0.4), (-0.3, 0.85, 0.1), (0.3, 1.0, 0.0), (0.43, 0.85, -0.05), (0.5, 0.35, -0.2)]
    joints, radii = [body.at(x * long, z=z * thick) for x, _, z in hull], [r * thick for _, r, _ in hull]
    parts = [tube(joints, radii, blend=0.02)]
    span, chord, taper, sweep, dihedral = u(0.8, 1.25), u(0.32, 0.45), u(0.3, 0.55), u(0.15, 0.6), u(0, 9)
    place, engines = u(0.05, 0.15) * long, u(0.3, 0.42)
    fin, tailplane, tail_sweep = u(0.28, 0.42), u(0.3, 0.45), u(0.1, 0.25)
    stern = body.move(-0.42 * long, z=0.05).rotate("x", 90)
    parts.append(plate(stern, _wing(0.26, 0.14, fin, tail_sweep), 0.045, blend=0.03))
    for left in (-1, 1):
        root = body.move(place, left * 0.3 * thick, -0.35 * thick).rotate("x", left * dihedral)
        wing = mirrored(_wing(chord, chord * taper, span, sweep), left)
        parts.append(plate(root, wing, 0.055, blend=0.03))
        pod = root.move(0.5 * chord - engines * sweep, left * engines * span, -0.075)
        parts.append(tube(pod.points((0.02,), (-0.2,)), [0.065, 0.055], blend=0.02))
        rear = body.move(-0.42 * long, left * 0.2 * thick, 0.03).rotate("x", left * dihedral)
        small = mirrored(_wing(0.22, 0.12, tailplane, tail_sweep), left)
        parts.append(plate(rear, small, 0.045, blend=0.02))
    return parts


def _wing(root: float, tip: float, span: float, sweep: float) -> list[tuple[float, float]]:
    """Return the outline of a tapered wing along y whose leading edge runs back by `sweep` over the span."""
    return [(root / 2, 0.0), (root / 2 - sweep, span), (root / 2 - sweep - tip, span), (-root / 2, 0.0)]


def pliers(rng: Generator) -> list[Part]:
    """Build two arms that cross at a pivot, open: short jaws in front, long bent handles behind."""
    u = rng.uniform
    opening, jaw, grip = u(11, 30), u(0.35, 0.6), u(0.95, 1.4)
    thick, bulge, flare = u(0.07, 0.1), u(0.08, 0.18), u(-0.06, 0.14)
    # Upright, jaws up.
    pivot = Frame().rotate("y", -90)
    disc = [(0.0, -0.07), (0.09, -0.07), (0.09, 0.07), (0.0, 0.07)]
    parts = [revolved(pivot, disc, 0.03, blend=0.0)]
    for left in (-1, 1):
        arm = pivot.rotate("z", left * opening)
        inner, outer = [(-0.06, -0.05), (0.1, -0.06), (0.75 * jaw, -0.03)], [(0.1, 0.1), (-0.06, 0.06)]
        cheek = mirrored([*inner, (jaw, -0.005), (jaw, 0.01), *outer], left)
        parts.append(plate(arm, cheek, thick, blend=0.02))
        bow = [
            (0.0, 0.0),
            (-0.14, -0.03),
            (-0.32, -bulge),
            (-0.6 * grip, -0.04 - bulge),
            (-grip, flare - bulge),
        ]
        parts.append(tube(arm.points(*mirrored(bow, left)), [0.075, 0.06, 0.05, 0.06, 0.05], blend=0.03))
    return parts


def glasses(rng: Generator) -> list[Part]:
    """Build two empty rims, a bridge and two folding temples with hooked ends."""
    u = rng.uniform
    wide, tall, power = u(0.24, 0.32), u(0.17, 0.25), u(0.6, 1.0)
    gap, wire = u(0.09, 0.14), u(0.028, 0.038)
    angles = np.linspace(0.0, 2.0 * np.pi, 33)
    rim_y = wide * np.sign(np.cos(angles)) * np.abs(np.cos(angles)) ** power
    rim_z = tall * np.sign(np.sin(angles)) * np.abs(np.sin(angles)) ** power
    front = Frame()
    bow = u(0, 8)
    parts: list[Part] = []
    inner = front.at(y=0.5 * gap, z=0.3 * tall)
    for left in (-1, 1):
        side = front.move(y=left * 0.5 * gap).rotate("z", left * bow)
        rim = [side.at(y=left * (wide + y), z=z) for y, z in zip(rim_y, rim_z, strict=True)]
        parts.append(tube(rim, np.full(len(rim), wire), blend=0.02))
        hinge = side.move(0.0, left * 2.0 * wide, 0.2 * tall)
        temple = hinge.rotate("z", 180 - left * u(-12, 45))
        length, drop = u(0.85, 1.1), u(20, 50)
        bend = temple.move(0.75 * length).rotate("y", drop)
        joints = [temple.at(-0.01), bend.origin, bend.at(0.28 * length)]
        parts.append(tube(joints, [wire * 1.1, wire, wire], blend=0.03))
    over = [inner * [1, -1.35, 1], inner * [1, -0.4, 1.25], inner * [1, 0.4, 1.25], inner * [1, 1.35, 1]]
    parts.insert(1, tube(over, np.full(4, wire), blend=0.02))
    return parts
