"""Noise, triangle soup and loose pieces: perturbations beside those of `core.evaluation.perturbation`."""

import numpy as np

from core.evaluation.perturbation import distances_from, drawn_centres
from core.mesh.mesh import Mesh
from core.mesh.simplification import check_amount, diagonal

PARTS = 8


def add_noise(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Add isotropic Gaussian noise to every vertex; `amount` is its deviation over the diagonal."""
    check_amount(amount, 0.0, np.inf)
    noise = np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return Mesh(mesh.vertices + amount * diagonal(mesh) * noise, mesh.faces)


def make_soup(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Give every face its own three vertices and shrink it, by `amount` in [0, 0.5] on average."""
    check_amount(amount, 0.0, 0.5)
    corners = mesh.vertices[mesh.faces]
    lost = amount * np.random.default_rng(seed).uniform(0.5, 1.5, size=(len(corners), 1, 1))
    corners = corners + lost * (corners.mean(axis=1, keepdims=True) - corners)
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def separate_parts(mesh: Mesh, amount: float, seed: int) -> Mesh:
    """Move `PARTS` pieces of the surface apart, each by `amount` times the diagonal."""
    check_amount(amount, 0.0, np.inf)
    distances = distances_from(mesh, drawn_centres(mesh, PARTS, seed))
    part = np.argmin(distances[:, mesh.faces].sum(axis=2), axis=0)
    moves = np.random.default_rng([seed, 1]).normal(size=(PARTS, 3))
    moves *= amount * diagonal(mesh) / np.linalg.norm(moves, axis=1, keepdims=True)
    keys, corner = np.unique(part[:, None] * len(mesh.vertices) + mesh.faces, return_inverse=True)
    of_part, vertex = np.divmod(keys, len(mesh.vertices))
    return Mesh(mesh.vertices[vertex] + moves[of_part], corner.reshape(-1, 3))
