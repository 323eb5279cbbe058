"""Orientation of a surface in its spectral domain: what tells a map from its mirror image.

Two functions f, g map a surface into a plane. The signed area of the image of a region is the integral of
n . (grad f x grad g) over the region, n the outward normal. Over all pairs of coordinates these areas are an
antisymmetric matrix; a map between two surfaces turns it, and a map that reverses orientation also changes
its sign (the orientation operators of Ren, Poulenard, Wonka and Ovsjanikov, "Continuous and
orientation-preserving correspondences via functional maps", 2018).
"""

import numpy as np

from core.arrays import Floats, Int8s, Ints
from core.mesh.edges import component_labels
from core.mesh.mesh import Mesh
from core.numerics.compilation import compiled_for_reading

ORIENTED = 6
"""Number of coordinates whose signed areas are computed; the lowest are the most stable ones."""

ORIENTING = "laplace-beltrami"
"""The operator whose coordinates they are: its eigenfunctions are known at all vertices."""

ORIENTED_AREA = 0.9
"""Least share of a surface's area in components whose faces are turned alike."""


def face_signs(mesh: Mesh, areas: Floats) -> Floats | None:
    """Return the sign that turns the normal of each face outward, shape (f,): 1, -1, or 0 for none.

    The faces of a component are turned alike if the two faces at an edge pass it in opposite directions. A
    closed component has its normals outward: its volume is positive. An open one keeps its faces as they are.
    Return None for a surface whose faces are turned every way: components without an orientation have more
    than 1 - `ORIENTED_AREA` of its area.
    """
    faces = mesh.faces
    sides = mesh.half_edges
    count, labels = component_labels(len(mesh.vertices), faces)
    component = labels[faces[:, 0]]
    edge_of = np.repeat(np.arange(len(sides.first)), sides.face_counts)
    forward = (faces.ravel() == np.minimum(faces, faces[:, [1, 2, 0]]).ravel())[sides.order]
    balance = np.bincount(edge_of, np.where(forward, 1.0, -1.0), minlength=len(sides.first))
    here = component[sides.order[sides.first] // 3]
    turned = np.bincount(here[(sides.face_counts == 2) & (balance != 0.0)], minlength=count) == 0
    closed = np.bincount(here[balance != 0.0], minlength=count) == 0
    corners = mesh.vertices[faces]
    volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    inward = closed & (np.bincount(component, volumes, minlength=count) < 0.0)
    if areas[turned[component]].sum() < ORIENTED_AREA * areas.sum():
        return None
    signs = np.where(turned, np.where(inward, -1.0, 1.0), 0.0)
    return np.asarray(signs[component])


@compiled_for_reading
def signed_areas(functions: Floats, faces: Ints, signs: Floats, regions: Ints, count: int) -> Floats:
    """Return the signed areas of the images of regions in the planes of all pairs of functions.

    The functions, shape (n, k), and the `regions`, shape (n,), are given at the vertices; a third of each
    face belongs to the region of each corner. `signs`, shape (f,), are those of `face_signs`. The result,
    shape (count, k (k - 1) / 2), has for each of `count` regions the entries below the diagonal of its
    antisymmetric matrix, row by row.
    """
    k = functions.shape[1]
    areas = np.zeros((count, k * (k - 1) // 2))
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        share = signs[f] / 6.0
        pair = 0
        for i in range(k):
            first, second = functions[b, i] - functions[a, i], functions[c, i] - functions[a, i]
            for j in range(i):
                area = share * (
                    first * (functions[c, j] - functions[a, j]) - second * (functions[b, j] - functions[a, j])
                )
                for corner in range(3):
                    areas[regions[faces[f, corner]], pair] += area
                pair += 1
    return areas


def quantised_areas(areas: Floats) -> Int8s:
    """Return signed areas in bytes, int8, of the same shape; the largest magnitude is 127.

    A scale does not change the agreement.
    """
    largest = float(np.abs(areas).max(initial=0.0))
    return np.rint(areas * (127.0 / largest if largest > 0.0 else 0.0)).astype(np.int8)


def orientation_agreement(first: Floats, second: Floats, rotations: Floats) -> Floats:
    """Return whether maps preserve orientation: cosines between matched signed areas, shape (r,), in [-1, 1].

    A cosine is positive for a map that preserves orientation, and negative for one that reverses it. `first`,
    shape (p, e), e = k (k - 1) / 2, has signed areas at p places of the first surface, `second`, shape
    (r, p, e), those of their partners under each map. Coordinates of the first surface times the `rotations`,
    shape (r, k, k), lie on those of the second.
    """
    i, j = np.tril_indices(rotations.shape[1], -1)
    # The second compound matrix turns the entries of an antisymmetric matrix.
    straight = rotations[:, i[:, None], i] * rotations[:, j[:, None], j]
    crossed = rotations[:, j[:, None], i] * rotations[:, i[:, None], j]
    turned = first @ (straight - crossed)
    sizes = np.sqrt((turned**2).sum(axis=(1, 2)) * (second**2).sum(axis=(1, 2)))
    return np.asarray((turned * second).sum(axis=(1, 2)) / np.where(sizes > 0.0, sizes, 1.0))
