"""The instances of a part in a surface of several pieces: how many of its pieces are copies of the part.

A plate with six brackets has six instances of the bracket. Instances have the size of the part. The lengths
of pieces (`core.descriptors.pieces`) tell which may be instances, and registration decides.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float32s, Floats
from core.descriptors.pieces import COUNT, RADII, SIZE, VOLUME, number_of_pieces, piece_lengths
from core.mesh.cleaning import clean
from core.mesh.mesh import Mesh
from core.registration.probed_surface import ProbedSurface, probed_surface
from core.registration.rigid_copy import EQUAL_RADIUS, EQUAL_VOLUME, IDENTICAL, copy_by_surfaces
from core.registration.similarity import best_similarity

EQUAL_SIZE = 0.01
"""Largest difference of the logarithms of the roots of the areas of a part and its instance: chord errors."""

JUDGED = 8
"""Most pieces that are registered with a part. Most pieces have the triangles of the part or of another
piece, and need no registration."""


@dataclass(frozen=True)
class Instances:
    """The numbers of the pieces that are copies of a part, and that are copies of its mirror image."""

    count: int
    mirrored: int


def may_be_instances(part: Floats, rows: Float32s | Floats) -> NDArray[np.bool_]:
    """Return whether pieces may be instances of a part, shape (k,), by the lengths of both.

    `part`, shape (w,), is a row of `core.descriptors.pieces.pieces`, and `rows`, shape (k, w), are such rows.
    """
    sizes = np.maximum(rows[:, SIZE], np.finfo(np.float32).tiny)
    own, others = part / part[SIZE], rows / sizes[:, None]
    equal = np.abs(np.log(sizes / part[SIZE])) <= EQUAL_SIZE
    equal &= (np.abs(others[:, RADII] - own[RADII]) <= EQUAL_RADIUS).all(axis=1)
    volumes = np.maximum(others[:, VOLUME], np.finfo(np.float32).tiny)
    # The volume of an open piece is 0, and tells nothing.
    solid = (others[:, VOLUME] > 0.0) & (own[VOLUME] > 0.0)
    growth = 3.0 * np.abs(np.log(volumes / max(own[VOLUME], np.finfo(np.float32).tiny)))
    return np.asarray(equal & (~solid | (growth <= EQUAL_VOLUME)))


def possible_instances(first: Float32s, second: Float32s) -> int:
    """Return how many pieces of one surface may be instances of the other, which has one piece; else 0."""
    part, rows = sorted((first, second), key=number_of_pieces)
    if number_of_pieces(part) != 1 or number_of_pieces(rows) == 1:
        return 0
    return int(rows[may_be_instances(part[0], rows), COUNT].sum())


def instances(part: Mesh, whole: Mesh) -> Instances:
    """Count the pieces of a surface that are copies of a part of one piece.

    Raise DegenerateMeshError if a mesh has no area.
    """
    own = clean(part)
    surface = clean(whole)
    lengths = piece_lengths(surface.mesh, surface.labels)
    alike = np.flatnonzero(may_be_instances(piece_lengths(own.mesh, own.labels)[0], lengths))
    # Each surface has a sign: 1 for a copy of the part, -1 for a copy of its mirror image, 0 for others.
    known: list[tuple[Mesh, int]] = [(own.mesh, 1)]
    probed: ProbedSurface | None = None
    counts = {1: 0, -1: 0, 0: 0}
    of_face = surface.labels[surface.mesh.faces[:, 0]]
    for label in alike.tolist():
        piece = clean(Mesh(surface.mesh.vertices, surface.mesh.faces[of_face == label])).mesh
        sign = next((sign for other, sign in known if _are_congruent(other, piece)), None)
        if sign is None:
            if len(known) > JUDGED:
                continue
            probed = probed or probed_surface(own.mesh)
            sign = _judged(probed, probed_surface(piece))
            known.append((piece, sign))
        counts[sign] += 1
    return Instances(counts[1], counts[-1])


def _are_congruent(first: Mesh, second: Mesh) -> bool:
    """Return whether two cleaned meshes have the same triangles after a motion, in their order."""
    if first.vertices.shape != second.vertices.shape or first.faces.shape != second.faces.shape:
        return False
    motion = best_similarity(first.vertices, second.vertices, sign=1, scaled=False)
    gaps = np.linalg.norm(motion.apply(first.vertices) - second.vertices, axis=1)
    radius = np.linalg.norm(first.vertices - first.vertices.mean(axis=0), axis=1).max()
    return bool(gaps.max() <= IDENTICAL * radius)


def _judged(part: ProbedSurface, piece: ProbedSurface) -> int:
    """Return 1 for a copy, -1 for a copy of the mirror image, 0 for neither."""
    ends = [one.samples.representatives * one.samples.unit + one.samples.centre for one in (part, piece)]
    copy = copy_by_surfaces(part, piece, (ends[0], ends[1]), variants=False)
    return 0 if copy is None else -1 if copy.mirrored else 1
