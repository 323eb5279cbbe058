"""Two-legged bodies and the hand: person, teddy, hand."""

import numpy as np
from numpy.random import Generator

from core.gallery.solids import Frame, Part, chain, ellipsoid, tube


def person(rng: Generator) -> list[Part]:
    """Build head, torso, arms with hands, legs with feet; about 1.75 tall when standing."""
    u = rng.uniform
    build, leg_scale, arm_scale = u(0.85, 1.3), u(0.9, 1.12), u(0.92, 1.1)
    hip_width, shoulder_width = u(0.085, 0.11), u(0.17, 0.22)
    pelvis = Frame()
    lean, side, twist = u(-8, 35), u(-12, 12), u(-20, 20)
    # The spine is a chain that starts upwards: its frames have x up and z backwards.
    spine, neck_base = chain(
        pelvis.move(z=0.02).rotate("y", -90), [0.16, 0.2, 0.17], [(lean / 3, side / 3)] * 3
    )
    chest = neck_base.rotate("x", twist)
    depth = chest.axes[:, 2]
    torso = tube(
        spine,
        np.array([0.155, 0.135 * build, 0.16, 0.1]) * [1.0, build**0.5, 1.0, 1.0],
        blend=0.06,
        across=depth,
        squash=1.45 / build**0.5,
    )
    top, half = chest.move(-0.03), 0.85 * shoulder_width
    parts = [torso, tube([top.at(y=-half), top.at(y=half)], [0.07, 0.07], blend=0.07)]
    nod, turn = u(-20, 25), u(-40, 40)
    neck, skull = chain(chest, [0.1, 0.12], [(nod / 2, 0), (nod / 2, 0)])
    skull = skull.rotate("x", turn)
    parts.append(tube(neck[:2], [0.06, 0.055], blend=0.05))
    parts.append(ellipsoid(skull, (0.13, 0.085, 0.105), blend=0.03))
    parts.append(ellipsoid(skull.move(-0.02, 0.0, -0.105), (0.03, 0.02, 0.03), blend=0.03))
    for left in (-1, 1):
        parts.extend(_arm(top.move(y=left * shoulder_width), left, arm_scale, build, rng))
        parts.extend(_leg(pelvis.move(y=left * hip_width), left, leg_scale, build, rng))
    return parts


def _arm(shoulder: Frame, left: int, scale: float, build: float, rng: Generator) -> list[Part]:
    u = rng.uniform
    # The shoulder's x is up the spine: turn it down, swing it forwards, then lift it sideways.
    down = shoulder.rotate("y", 180 - u(-45, 95))
    upper = down.rotate("z", left * u(12, 85)).rotate("x", left * u(-60, 30))
    girth = scale * build**0.5
    bends = [(0.0, 0.0), (-u(5, 95), 0.0), (u(-20, 20), 0.0)]
    joints, wrist = chain(upper, [0.29 * scale, 0.25 * scale, 0.06], bends)
    arm = tube(joints, np.array([0.055, 0.045, 0.034, 0.036]) * girth, blend=0.05)
    palm = wrist.rotate("x", u(-60, 60))
    joints, radii = palm.points((-0.03,), (0.05,), (0.11, 0.0, 0.02)), np.array([0.042, 0.05, 0.036]) * scale
    hand = tube(joints, radii, blend=0.03, across=palm.axes[:, 2], squash=1.6)
    thumb = tube([palm.at(0.0), palm.at(0.06, -left * 0.075)], [0.024, 0.02], blend=0.02)
    return [arm, hand, thumb]


def _leg(hip: Frame, left: int, scale: float, build: float, rng: Generator) -> list[Part]:
    u = rng.uniform
    lift = u(-25, 75)
    knee = u(0, 25) + u(0.3, 1.0) * max(lift, 0.0) + u(0, 30)
    thigh = hip.rotate("y", 90).rotate("y", -lift).rotate("z", left * u(6, 28))
    joints, ankle = chain(thigh, [0.42 * scale, 0.42 * scale], [(0.0, 0.0), (knee, 0.0)])
    leg = tube(joints, np.array([0.095, 0.062, 0.042]) * build**0.5, blend=0.04)
    sole = ankle.rotate("y", -90 + u(-15, 25)).rotate("z", left * u(0, 15))
    joints = sole.points((-0.04, 0.0, -0.02), (0.08, 0.0, -0.03), (0.17, 0.0, -0.035))
    return [leg, tube(joints, np.array([0.045, 0.05, 0.038]) * scale, blend=0.03)]


def teddy(rng: Generator) -> list[Part]:
    """Build a stuffed bear: round head with ears and muzzle, round belly, stubby arms and legs."""
    u = rng.uniform
    belly = u(0.36, 0.46)
    body = Frame()
    head_size = u(0.27, 0.34)
    neck = body.rotate("x", u(-10, 10)).move(z=belly * 1.15 + head_size * 0.75)
    head = neck.rotate("z", u(-35, 35)).rotate("y", u(-15, 20))
    parts = [
        ellipsoid(body, (belly * 0.85, belly * 0.92, belly * 1.15), blend=0.05),
        ellipsoid(head, (head_size * 0.92, head_size, head_size * 0.92), blend=0.08),
        ellipsoid(head.move(head_size * 0.85, z=-head_size * 0.25), (0.13, 0.13, 0.1), blend=0.05),
    ]
    ear = u(0.1, 0.13)
    for left in (-1, 1):
        spot = head.move(0.0, left * head_size * 0.72, head_size * 0.78)
        parts.append(ellipsoid(spot, (ear * 0.55, ear, ear), blend=0.03))
        shoulder = body.move(0.0, left * belly * 0.68, belly * 0.7)
        arm = shoulder.rotate("z", left * u(25, 85)).rotate("y", u(-50, 55))
        joints, _ = chain(arm, [0.22, u(0.16, 0.26)], [(0, 0), (u(-25, 25), left * u(-30, 10))])
        parts.append(tube(joints, [0.13, 0.12, 0.115], blend=0.06))
        hip = body.move(0.06, left * belly * 0.55, -belly * 0.8)
        leg = hip.rotate("z", left * u(8, 35)).rotate("y", u(5, 75))
        joints, ankle = chain(leg, [0.26, u(0.1, 0.2)], [(0, 0), (u(-10, 10), 0)])
        parts.append(tube(joints, [0.16, 0.15, 0.14], blend=0.06))
        parts.append(ellipsoid(ankle.move(0.02, z=0.06), (0.11, 0.15, 0.19), blend=0.05))
    return parts


def hand(rng: Generator) -> list[Part]:
    """Build a right hand with a stump of forearm: palm, four fingers and a thumb, each with its own bend."""
    u = rng.uniform
    slim, length = u(0.85, 1.1), u(0.88, 1.15)
    # Upright, fingers up.
    wrist = Frame().rotate("y", -90)
    parts: list[Part] = []
    sideways = wrist.axes[:, 2]
    elbow = wrist.rotate("z", 180).rotate("y", u(-30, 30)).rotate("z", u(-12, 12))
    arm, _ = chain(elbow, [0.25, 0.35], [(0, 0), (0, 0)])
    parts.append(tube(arm, np.array([0.22, 0.2, 0.23]) * slim, blend=0.1, across=sideways, squash=1.3))
    spread, curl = u(2, 9), u(0, 45)
    spans = np.array([0.82, 0.95, 0.88, 0.68]) * length
    for finger in range(4):
        offset = (1.5 - finger) * 0.215 * slim
        knuckle = wrist.move(0.95 - 0.05 * abs(finger - 1.0), offset)
        bone, radii = [wrist.at(0.08, 0.6 * offset), knuckle.origin], np.array([0.2, 0.15]) * slim
        parts.append(tube(bone, radii, blend=0.1, across=sideways, squash=1.15))
        bend = np.clip(curl + u(-30, 30), -8, 62)
        pointed = knuckle.rotate("z", (1.5 - finger) * (spread + 2))
        bones = spans[finger] * np.array([0.45, 0.3, 0.25])
        joints, _ = chain(pointed, list(bones), [(bend, 0), (0.9 * bend, 0), (0.6 * bend, 0)])
        parts.append(tube(joints, np.array([0.115, 0.105, 0.095, 0.08]) * slim, blend=0.03))
    base = wrist.move(0.22, 0.26 * slim, -0.05).rotate("z", u(35, 62)).rotate("y", u(-5, 30))
    bones, bends = [0.36 * length, 0.3 * length, 0.26 * length], [(0, 0), (0, -u(5, 30)), (0, -u(0, 30))]
    joints, _ = chain(base, bones, bends)
    parts.append(tube(joints, np.array([0.17, 0.135, 0.115, 0.09]) * slim, blend=0.07))
    return parts
