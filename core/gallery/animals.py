"""Animals: quadruped, bird, fish and snake with a backbone, octopus and spider without one."""

import numpy as np
from numpy.random import Generator

from core.gallery.solids import Frame, Part, chain, ellipsoid, mirrored, plate, tube


def quadruped(rng: Generator) -> list[Part]:
    """Build a dog or horse: trunk, neck, head with muzzle and ears, four jointed legs, a tail."""
    u = rng.uniform
    length, girth, leg = u(0.85, 1.15), u(0.19, 0.25), u(0.3, 0.44)
    bow, curve = u(-12, 12), u(-14, 14)
    rear = Frame().rotate("y", -bow).rotate("z", -curve)
    joints, chest = chain(rear, [length * 0.5, length * 0.5], [(0, 0), (bow, curve)])
    parts = [tube(joints, np.array([0.95, 0.92, 1.08]) * girth, blend=0.06)]
    rise, look = u(25, 70), u(-35, 35)
    neck_length = u(0.26, 0.5)
    bends = [(-rise, look / 2), (u(-15, 15), look / 2)]
    neck, nape = chain(chest.move(0.04, z=0.3 * girth), [neck_length * 0.5] * 2, bends)
    parts.append(tube(neck, np.array([0.8, 0.55, 0.47]) * girth, blend=0.08))
    # Level the head to a nod of its own, whatever the neck does.
    skull = nape.rotate("y", rise + u(-10, 35))
    muzzle = skull.points((-0.02,), (0.1,), (0.1 + u(0.2, 0.32), 0.0, -0.03))
    parts.append(tube(muzzle, [0.11, 0.12, 0.07], blend=0.05))
    ear = u(0.09, 0.17)
    for left in (-1, 1):
        root = skull.move(0.0, left * 0.07, 0.08)
        parts.append(tube([root.origin, root.at(-0.03, left * 0.05, ear)], [0.045, 0.03], blend=0.03))
    for left in (-1, 1):
        shoulder = chest.move(-0.06, left * 0.55 * girth, -0.35 * girth)
        fore = [(leg, 0.0, 0.5), (leg * 0.95, u(0, 45), 0.33)]
        parts.extend(_leg(shoulder, left, fore, girth, rng))
        hip = rear.move(0.06, left * 0.55 * girth, -0.3 * girth)
        flex = u(10, 45)
        hind = [(leg * 0.75, -15.0, 0.6), (leg * 0.65, 15 + flex, 0.38), (leg * 0.6, -flex, 0.27)]
        parts.extend(_leg(hip, left, hind, girth, rng))
    tail_length, droop, wag = u(0.35, 0.75), u(-50, 50), u(-14, 14)
    bends = [(u(-8, 22), wag) for _ in range(6)]
    dock = rear.move(-0.7 * girth, z=0.45 * girth).rotate("z", 180).rotate("y", droop)
    tail, _ = chain(dock, [tail_length / 6] * 6, bends)
    parts.append(tube(tail, np.linspace(0.055, 0.032, 7), blend=0.06))
    return parts


def _leg(
    root: Frame, left: int, bones: list[tuple[float, float, float]], girth: float, rng: Generator
) -> list[Part]:
    """Build a leg with a paw, from bones given as length, bend in degrees and thickness by the trunk's."""
    u = rng.uniform
    down = root.rotate("y", 90 - u(-30, 30)).rotate("z", left * u(3, 14))
    joints, foot = chain(down, [length for length, _, _ in bones], [(bend, 0.0) for _, bend, _ in bones])
    radii = np.array([*(thick for _, _, thick in bones), 0.25]) * girth
    # The leg runs along x, so that forwards is z.
    paw = foot.points((-0.01,), (0.01, 0.0, 0.08))
    return [tube(joints, radii, blend=0.05), tube(paw, np.array([0.27, 0.24]) * girth, blend=0.02)]


def bird(rng: Generator) -> list[Part]:
    """Build body, neck, head with beak, two wings jointed at the elbow, a fan of tail, two legs with toes."""
    u = rng.uniform
    size, slim = u(0.9, 1.1), u(0.17, 0.23)
    body = Frame()
    trunk = body.points((-0.32 * size,), (0.0,), (0.26 * size, 0.0, 0.03))
    parts = [tube(trunk, [0.6 * slim, slim, 0.75 * slim], blend=0.05)]
    reach, rise = u(0.16, 0.42), u(0, 60)
    breast = body.move(0.3 * size, z=0.06).rotate("z", u(-25, 25))
    neck, nape = chain(breast, [reach / 2] * 2, [(-rise, 0), (u(-20, 20), u(-20, 20))])
    parts.append(tube(neck, [0.11, 0.085, 0.08], blend=0.07))
    head = nape.rotate("y", rise)
    parts.append(ellipsoid(head.move(0.04), (0.13, 0.1, 0.1), blend=0.04))
    beak = head.points((0.12,), (0.12 + u(0.14, 0.26), 0.0, -0.02))
    parts.append(tube(beak, [0.055, 0.027], blend=0.02))
    fan = u(0.16, 0.26)
    tail = body.move(-0.34 * size).rotate("y", u(-15, 20))
    outline = [(0.08, 0.05), (-0.42, fan), (-0.46, 0.0), (-0.42, -fan), (0.08, -0.05)]
    parts.append(plate(tail, outline, 0.055, blend=0.04))
    span, chord, sweep = u(0.75, 1.15), u(0.26, 0.36), u(-0.05, 0.25)
    flap, fold = u(-25, 45), u(-45, 30)
    for left in (-1, 1):
        shoulder = body.move(0.06, left * 0.5 * slim, 0.4 * slim).rotate("x", left * (flap + u(-6, 6)))
        parts.extend(_wing(shoulder, left, span=span, chord=chord, sweep=sweep, fold=fold + u(-6, 6)))
        parts.extend(_bird_leg(body.move(-0.1, left * 0.5 * slim, -0.6 * slim), left, rng))
    return parts


def _wing(shoulder: Frame, left: int, *, span: float, chord: float, sweep: float, fold: float) -> list[Part]:
    """Build two plates that meet at the elbow, where the outer one is turned up by `fold` degrees."""
    inner, outer = 0.45 * span, 0.55 * span
    arm = [(0.5 * chord, 0.0), (0.55 * chord, inner), (-0.5 * chord, inner), (-0.6 * chord, 0.0)]
    tip = [
        (0.55 * chord, 0.0),
        (0.35 * chord - 0.4 * sweep, 0.6 * outer),
        (-sweep, outer),
        (-0.35 * chord - sweep, 0.75 * outer),
        (-0.5 * chord, 0.0),
    ]
    elbow = shoulder.move(0.0, left * inner).rotate("x", left * fold)
    return [
        plate(shoulder, mirrored(arm, left), 0.06, blend=0.04),
        plate(elbow, mirrored(tip, left), 0.055, blend=0.03),
    ]


def _bird_leg(hip: Frame, left: int, rng: Generator) -> list[Part]:
    u = rng.uniform
    down = hip.rotate("y", 90 + u(-25, 35)).rotate("z", left * u(0, 12))
    leg, foot = chain(down, [0.14, u(0.12, 0.2)], [(20, 0), (-35, 0)])
    parts = [tube(leg, [0.06, 0.035, 0.033], blend=0.03)]
    for yaw in (-35, 0, 35):
        toe = foot.rotate("y", -75).rotate("z", yaw)
        parts.append(tube([foot.origin, toe.at(0.12)], [0.033, 0.027], blend=0.01))
    return parts


def fish(rng: Generator) -> list[Part]:
    """Build a body bent sideways as in swimming, tail fin, back fin, belly fin and two breast fins."""
    u = rng.uniform
    tall, flat = u(0.17, 0.29), u(1.9, 2.8)
    sway = u(-9, 9)
    bends = [(0.0, sway + u(-9, 9)) for _ in range(6)]
    joints, tail = chain(Frame().move(0.5).rotate("z", 180), [0.17] * 6, bends)
    heights = np.array([0.42, 0.8, 1.0, 0.95, 0.72, 0.45, 0.26]) * tall
    parts = []
    for i in range(6):
        along = joints[i + 1] - joints[i]
        across = np.cross(along, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        parts.append(tube(joints[i : i + 2], heights[i : i + 2], blend=0.03, across=across, squash=flat))
    parts.append(tube([joints[0] + [0.12, 0, -0.02], joints[0]], [0.05, 0.09], blend=0.08))
    fork, reach = u(0.16, 0.3), u(0.24, 0.36)
    fan = tail.rotate("z", u(-25, 25)).rotate("x", 90)
    upper = [(-0.1, 0.05), (0.08, 0.06), (reach, fork)]
    outline = [*upper, (reach * 0.62, 0.0), *mirrored(upper[::-1], -1)]
    parts.append(plate(fan, outline, 0.05, blend=0.04))
    for up, start, height in ((1, 0.2, u(0.12, 0.24)), (-1, -0.05, u(0.08, 0.16))):
        base = Frame(joints[3]).move(z=up * 0.8 * tall).rotate("x", 90)
        fin = [
            (start, -0.04 * up),
            (start - 0.16, up * height),
            (start - 0.3, up * height * 0.8),
            (start - 0.26, -0.04 * up),
        ]
        parts.append(plate(base, fin, 0.05, blend=0.03))
    for left in (-1, 1):
        root = Frame(joints[1]).move(-0.04, left * 0.6 * tall / flat, -0.25 * tall)
        root = root.rotate("z", 180 - left * u(25, 60)).rotate("x", left * u(20, 60))
        parts.append(plate(root, [(0.0, -0.04), (0.22, -0.09), (0.25, 0.05), (0.0, 0.04)], 0.048, blend=0.03))
    return parts


def snake(rng: Generator) -> list[Part]:
    """Build a long body in waves or in a loose coil, with a flattened head and a pointed tail."""
    u = rng.uniform
    bones = 44
    step, thick = u(0.075, 0.09), u(0.075, 0.1)
    along = np.arange(bones) / bones
    if u() < 0.7:
        swing = u(9, 17) * np.sin(2 * np.pi * (u(1.0, 2.2) * along + u()))
        yaw = swing + u(-2, 2)
    else:
        yaw = np.linspace(u(3, 6), u(12, 15), bones) * (1 if u() < 0.5 else -1)
    pitch = u(0, 2.2) * np.sin(2 * np.pi * (u(0.5, 1.5) * along + u()))
    head = Frame().rotate("z", 180)
    joints, _ = chain(head, [step] * bones, list(zip(pitch, yaw, strict=True)))
    fat = thick * np.interp(along, [0.0, 0.06, 0.35, 0.7, 1.0], [0.75, 0.72, 1.0, 0.85, 0.45])
    parts = [tube(joints, np.append(fat, thick * 0.33), blend=0.03)]
    skull, radii = head.points((0.06,), (-0.08,), (-0.2,)), np.array([1.1, 1.35, 0.8]) * thick
    parts.append(tube(skull, radii, blend=0.04, across=head.axes[:, 2], squash=1.6))
    return parts


def octopus(rng: Generator) -> list[Part]:
    """Build a bulbous mantle with eyes, and eight arms that taper and curl."""
    u = rng.uniform
    bulb, tall = u(0.26, 0.36), u(1.1, 1.6)
    mantle = Frame().move(z=0.12).rotate("y", u(-30, 15)).rotate("x", u(-15, 15))
    crown = mantle.move(z=bulb * tall * 0.75)
    parts = [
        ellipsoid(Frame(), (0.27, 0.27, 0.16), blend=0.05),
        ellipsoid(crown, (bulb, bulb, bulb * tall), blend=0.12),
    ]
    for left in (-1, 1):
        parts.append(ellipsoid(mantle.move(0.22, left * 0.17, 0.08), (0.075, 0.075, 0.075), blend=0.03))
    length, bones = u(1.0, 1.5), 12
    for arm in range(8):
        root = Frame().rotate("z", 22.5 + 45 * arm + u(-5, 5)).move(0.2, z=-0.04).rotate("y", u(0, 25))
        reach = length * u(0.85, 1.1)
        lift, curl, side = u(-5, 2), u(-11, 11), u(-5, 5)
        bends = [
            (lift * (i < 4) + curl * (i >= 5), side * (i < 7) + 1.5 * side * (i >= 7)) for i in range(bones)
        ]
        joints, _ = chain(root, [reach / bones] * bones, bends)
        parts.append(tube(joints, np.linspace(0.115, 0.034, bones + 1), blend=0.06))
    return parts


def spider(rng: Generator) -> list[Part]:
    """Build head and thorax in one, a round abdomen, two feelers, and eight legs of three bones each."""
    u = rng.uniform
    front = Frame()
    abdomen = u(0.24, 0.36)
    rear = front.rotate("y", u(-15, 25)).rotate("z", u(-12, 12)).move(-0.16 - abdomen)
    parts = [
        ellipsoid(front, (0.25, 0.19, 0.13), blend=0.03),
        ellipsoid(rear, (abdomen * 1.15, abdomen * 0.9, abdomen * 0.8), blend=0.06),
    ]
    thigh, shin, foot, thick = u(0.4, 0.55), u(0.42, 0.6), u(0.25, 0.4), u(0.04, 0.052)
    for left in (-1, 1):
        feeler = front.move(0.2, left * 0.08).rotate("z", left * u(5, 20)).rotate("y", u(-20, 10))
        joints, _ = chain(feeler, [0.12, 0.12], [(0, 0), (u(20, 60), 0)])
        parts.append(tube(joints, [0.045, 0.04, 0.036], blend=0.03))
        for place, yaw in ((0.14, 40), (0.05, 72), (-0.04, 105), (-0.12, 138)):
            hip = front.move(place, left * 0.13, 0.0).rotate("z", left * (yaw + u(-9, 9)))
            lift, knee, ankle = u(15, 55), u(50, 90), u(0, 25)
            joints, _ = chain(hip.rotate("y", -lift), [thigh, shin, foot], [(0, 0), (knee, 0), (ankle, 0)])
            parts.append(tube(joints, thick * np.array([1.15, 1.0, 0.85, 0.7]), blend=0.04))
    return parts
