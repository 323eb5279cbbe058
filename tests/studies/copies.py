"""Copies of a mesh, as they turn up in archives: turned, scaled, mirrored, and meshed anew."""

import numpy as np

from core.evaluation.perturbation import subdivide
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import normal_frame
from core.mesh.simplification import simplify

KINDS = ("turned", "scaled", "split", "simplified", "mirrored")


def copy(mesh: Mesh, kind: str, seed: int) -> Mesh:
    """A copy of one of `KINDS`; each is turned and moved too."""
    if kind == "scaled":
        return moved(mesh, seed, scale=2.5 if seed % 2 else 0.3)
    if kind == "split":
        return moved(subdivide(mesh, 0.4, seed), seed)
    if kind == "simplified":
        return moved(simplified(mesh), seed)
    if kind == "mirrored":
        return moved(mesh, seed, scale=1.5, mirrored=True)
    return moved(mesh, seed)


def moved(mesh: Mesh, seed: int, *, scale: float = 1.0, mirrored: bool = False) -> Mesh:
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn[0] *= (-1.0 if mirrored else 1.0) * np.sign(np.linalg.det(turn))
    faces = mesh.faces[:, ::-1] if mirrored else mesh.faces
    return Mesh(scale * mesh.vertices @ turn.T + [2.0, 0.0, -3.0], faces)


def simplified(mesh: Mesh) -> Mesh:
    """With half the vertices."""
    frame = normal_frame(mesh)
    made = simplify(Mesh(frame.apply(mesh.vertices), mesh.faces), len(mesh.vertices) // 2)
    return Mesh(frame.invert(made.vertices), made.faces)
