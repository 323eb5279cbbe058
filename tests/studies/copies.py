"""Copies of a mesh, as they turn up in archives: turned, scaled, mirrored, and meshed anew."""

import numpy as np
import trimesh

from core.evaluation.perturbation import subdivide
from core.mesh.box_tree import triangle_tree
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


def quartered(mesh: Mesh) -> Mesh:
    """With each triangle cut in four: the surface is the same to rounding."""
    vertices, faces = trimesh.remesh.subdivide(mesh.vertices, mesh.faces)
    return Mesh(vertices, faces)


def simplified(mesh: Mesh, share: float = 0.5) -> Mesh:
    """With a share of the vertices."""
    frame = normal_frame(mesh)
    made = simplify(Mesh(frame.apply(mesh.vertices), mesh.faces), int(share * len(mesh.vertices)))
    return Mesh(frame.invert(made.vertices), made.faces)


def on_other_mesh(mesh: Mesh, vertices: int) -> Mesh:
    """The surface with about as many vertices, at other places."""
    split = quartered(mesh)
    return simplified(split, vertices / len(split.vertices))


def decimated(mesh: Mesh, tolerance: float) -> Mesh:
    """With half of the vertices, or the least share for which neither surface is farther from the other."""
    for share in np.arange(0.5, 1.0, 0.1):
        made = simplified(mesh, share)
        if max(_farthest(mesh, made), _farthest(made, mesh)) <= tolerance:
            return made
    return mesh


def _farthest(first: Mesh, second: Mesh) -> float:
    """The largest distance of corners and centres of triangles from another surface."""
    corners = first.vertices[first.faces]
    points = np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)])
    tree = triangle_tree(second.vertices[second.faces])
    shares, faces = tree.closest(points)
    nearest = np.einsum("nc,ncx->nx", shares, second.vertices[second.faces[faces]])
    return float(np.linalg.norm(points - nearest, axis=1).max())
