"""Parts: unions of fields that are blended into the body they are added to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Floats
from core.gallery import fields
from core.gallery.fields import Field
from core.gallery.frames import Frame


@dataclass(frozen=True, eq=False)
class Part:
    """A plain union of fields, joined to the parts before it by a smooth minimum of radius `blend`."""

    fields: tuple[Field, ...]
    blend: float


def tube(
    joints: Floats,
    radii: Sequence[float] | Floats,
    *,
    blend: float,
    across: Floats | None = None,
    squash: float = 1.0,
) -> Part:
    """Capsules along a polyline: joints of shape (m, 3), m radii; `squash` times thinner along `across`."""
    direction = np.array([0.0, 0.0, 1.0]) if across is None else across
    bones = zip(joints[:-1], joints[1:], radii[:-1], radii[1:], strict=True)
    return Part(
        tuple(fields.capsule(a, b, (float(r), float(s)), direction, squash) for a, b, r, s in bones), blend
    )


def ellipsoid(frame: Frame, radii: tuple[float, float, float], *, blend: float) -> Part:
    """One ellipsoid centred on a frame."""
    return Part((fields.ellipsoid(frame, np.array(radii)),), blend)


def box(frame: Frame, size: tuple[float, float, float], *, rounding: float, blend: float) -> Part:
    """One box of full extents `size` centred on a frame."""
    return Part((fields.box(frame, np.array(size) / 2.0, rounding),), blend)


def plate(frame: Frame, outline: Sequence[tuple[float, float]], thickness: float, *, blend: float) -> Part:
    """One plate in the x, y plane of a frame; its edges lie half a thickness outside the outline."""
    return Part((fields.plate(frame, np.array(outline), thickness / 2.0),), blend)


def mirrored(outline: Sequence[tuple[float, float]], left: int) -> list[tuple[float, float]]:
    """An outline drawn for the left side, or its mirror image when `left` is -1."""
    return [(x, left * y) for x, y in outline]


def revolved(
    frame: Frame, profile: Sequence[tuple[float, float]] | Floats, rounding: float, *, blend: float
) -> Part:
    """One solid of revolution; its surface lies `rounding` outside the profile."""
    return Part((fields.revolved(frame, np.array(profile), rounding),), blend)
