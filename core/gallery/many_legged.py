"""Animals without a backbone: octopus, spider."""

import numpy as np
from numpy.random import Generator

from core.gallery.frames import Frame, chain
from core.gallery.parts import Part, ellipsoid, tube


def octopus(rng: Generator) -> list[Part]:
    """A bulbous mantle with eyes, and eight arms that taper and curl."""
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
    """Head and thorax in one, a round abdomen, two feelers, and eight legs of three bones each."""
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
