"""Shapes for benchmarks: meshes of the sizes wanted, and noisy copies of their embeddings."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import fast_simplification
import numpy as np

from core.arrays import Float32s
from core.descriptors.partial import is_part
from core.descriptors.pieces import COUNT
from core.embedding import Embedding
from core.evaluation.perturbation import subdivide
from core.gallery import CLASSES, make_shape
from core.io import format_of, read_mesh
from core.mesh.mesh import Mesh
from service.datasets import read_collection

MADE_POSES = 3

NEAR = 0.15
"""The tolerated relative error of a number of vertices."""

NOISE = 0.2
"""The largest noise of coordinates relative to their root mean square; that of signatures is a quarter."""

NamedMesh = tuple[str, Mesh]
Source = dict[str, list[NamedMesh]]
"""Named meshes by class; classes are in lower case."""


def read_source(folder: Path | None) -> Source:
    """Return the meshes of a labelled folder, or generated ones.

    Raise DatasetError or MeshError if the folder or one of its files cannot be read.
    """
    if folder is None:
        return {
            label: [(f"{label} {pose}", make_shape(label, pose)) for pose in range(MADE_POSES)]
            for label in CLASSES
        }
    source: Source = {}
    for path, label in read_collection(folder):
        mesh = read_mesh(path.read_bytes(), format_of(path.name))
        source.setdefault(label.casefold(), []).append((path.name, mesh))
    return source


def nearest(meshes: Sequence[NamedMesh], vertices: int, count: int) -> list[NamedMesh]:
    """Return the meshes with the nearest numbers of vertices."""
    return sorted(meshes, key=lambda entry: abs(len(entry[1].vertices) - vertices))[:count]


def resized(mesh: Mesh, vertices: int) -> Mesh:
    """Subdivide the surface, then simplify it to about a number of vertices."""
    while len(mesh.vertices) < (1.0 - NEAR) * vertices:
        mesh = subdivide(mesh, 1.0, 0)
    if len(mesh.vertices) <= (1.0 + NEAR) * vertices:
        return mesh
    points, faces = fast_simplification.simplify(
        np.array(mesh.vertices),
        mesh.faces.astype(np.int32),
        target_reduction=1.0 - vertices / len(mesh.vertices),
    )
    return Mesh(points, faces)


def shaken(embedding: Embedding, number: int, other: Embedding | None = None) -> Embedding:
    """Return the embedding with noise, in another size; the number seeds the noise and its strength.

    The views, and the spin images of a complete surface, are mixed with those of another shape, by twice the
    strength. Noisy proportions leave few copies that a query would register: there is no mesh to read.
    """
    rng = np.random.default_rng(number)
    strength = NOISE * rng.random()

    def noisy(values: Float32s, strength: float) -> Float32s:
        scale = strength * np.sqrt((values**2).mean(axis=0, keepdims=True))
        noise = rng.standard_normal(values.shape, dtype=np.float32)
        return np.asarray(values + scale * noise, dtype=np.float32)

    spectra = tuple(
        replace(spectrum, coordinates=noisy(spectrum.coordinates, strength)) for spectrum in embedding.spectra
    )
    descriptors = dict(embedding.descriptors)
    if "eigenvalues" in descriptors:
        # As much as moves the logarithms in the signature, whose norm is their root mean square.
        level = 0.25 * strength * np.linalg.norm(embedding.signature)
        noise = rng.standard_normal(descriptors["eigenvalues"].shape)
        descriptors["eigenvalues"] = (descriptors["eigenvalues"] + level * noise).astype(np.float16)
    size, radius = np.exp(rng.standard_normal()), np.exp(strength * rng.standard_normal())
    facts, pieces = embedding.facts, embedding.pieces.copy()
    pieces[:, :COUNT] *= size
    facts = replace(
        facts, area=facts.area * size**2, volume=facts.volume * size**3, scale=facts.scale * size * radius
    )
    shaken = replace(
        embedding,
        facts=facts,
        pieces=pieces,
        spectra=spectra,
        signature=noisy(embedding.signature, 0.25 * strength),
        descriptors=descriptors,
    )
    if other is None:
        return shaken
    views, others = embedding.descriptors["views"], other.descriptors["views"]
    mixed = np.rint((1.0 - 2.0 * strength) * views + 2.0 * strength * others).astype(np.uint8)
    spin_images = embedding.descriptors["spin_images"].copy()
    if not is_part(spin_images):
        rows = rng.random(len(spin_images)) < 2.0 * strength
        spin_images[rows] = other.descriptors["spin_images"][: len(spin_images)][rows]
    return replace(shaken, descriptors={**descriptors, "spin_images": spin_images, "views": mixed})
