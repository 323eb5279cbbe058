"""The spectral embeddings and the signature of one shape, by its parameters (section 3.3)."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Float32s, Floats, Int8s, Ints
from core.embedding import NO_ORIENTATION, Spectrum
from core.mesh.cleaning import face_areas
from core.mesh.mesh import Mesh
from core.parameters import SpectralParameters
from core.spectral.affinity import (
    distance_affinity,
    gaussian_affinity,
    leading_eigenpairs,
    oriented,
    sampled_eigenpairs,
)
from core.spectral.coordinates import affinity_signature, laplacian_signature, spectral_coordinates
from core.spectral.laplace_beltrami import laplace_beltrami
from core.spectral.orientation import ORIENTED, ORIENTING, face_signs, quantised_areas, signed_areas


@dataclass(frozen=True, eq=False)
class SampledSurface:
    """The d points of a surface that are embedded, their distances and areas.

    Attributes
    ----------
    vertices : int64, shape (d,)
        Vertices of the surface; the m samples come first.
    distances : float64, shape (d, m)
        Distance from each point to each sample.
    areas : float64, shape (m,)
        Share of the surface in each sample's region, of sum 1.
    regions : int64, shape (n,)
        The sample nearest to each vertex of the surface.
    bridges : int64, shape (components - 1, 2)
        Pairs of vertices that join the components of the surface.
    """

    vertices: Ints
    distances: Floats
    areas: Floats
    regions: Ints
    bridges: Ints


def spectra_of(
    surface: Mesh, points: SampledSurface, wanted: SpectralParameters
) -> tuple[tuple[Spectrum, ...], Floats, Int8s]:
    """Return the spectral embeddings that the parameters name, the signature and the orientation.

    The surface is in its normal frame.

    Returns
    -------
    tuple of Spectrum
        In the order of `wanted.operators`.
    float64, shape (affinity_values + laplacian_values,)
        The signature of eigenvalues.
    int8, shape (m, p)
        See `core.embedding.Embedding.orientation`.
    """
    orientation = NO_ORIENTATION
    spectra: list[Spectrum] = []
    signature: list[Floats] = []
    if "affinity" in wanted.operators or wanted.affinity_values:
        values, vectors = _affinity_pairs(points, wanted)
        short = max(0, wanted.affinity_values - len(values))
        signature.append(affinity_signature(np.pad(values, (0, short))[: wanted.affinity_values]))
        kept = slice(1, wanted.dimensions + 1)
        coordinates = spectral_coordinates(
            values[1:], vectors[:, kept], wanted.eigenvalue_power, taper=wanted.taper
        ).astype(np.float32)
        spectra.append(Spectrum("affinity", values.astype(np.float32), coordinates))
    if "laplace-beltrami" in wanted.operators or wanted.laplacian_values:
        values, functions = laplace_beltrami(
            surface, max(wanted.dimensions + 1, wanted.laplacian_values), points.bridges
        )
        areas = face_areas(surface.vertices, surface.faces)
        area = float(areas.sum())
        signature.append(laplacian_signature(values[: wanted.laplacian_values], area))
        chosen = oriented(values, functions[points.vertices], wanted.dimensions)
        coordinates = spectral_coordinates(
            values, chosen, -wanted.eigenvalue_power, taper=wanted.taper
        ).astype(np.float32)
        spectra.append(Spectrum("laplace-beltrami", values.astype(np.float32), coordinates))
        signs = face_signs(surface, areas) if ORIENTING in wanted.operators else None
        if signs is not None:
            everywhere = _at_all_vertices(functions, points.vertices, coordinates[:, :ORIENTED])
            turns = signed_areas(everywhere, surface.faces, signs, points.regions, len(points.areas))
            orientation = quantised_areas(turns)
    spectra = [spectrum for spectrum in spectra if spectrum.name in wanted.operators]
    spectra.sort(key=lambda spectrum: wanted.operators.index(spectrum.name))
    return tuple(spectra), np.concatenate(signature), orientation


def _at_all_vertices(functions: Floats, points: Ints, coordinates: Float32s) -> Floats:
    """Return the coordinates of the embedded points at all vertices, shape (n, k), by eigenfunctions (n, s).

    They are exact up to a constant, which signed areas do not depend on.
    """
    centred = functions[points] - functions[points].mean(axis=0)
    return np.asarray(functions @ np.linalg.lstsq(centred, coordinates.astype(np.float64))[0])


def _affinity_pairs(points: SampledSurface, wanted: SpectralParameters) -> tuple[Floats, Floats]:
    """Return eigenvalues of the affinity over the number of samples, and eigenvectors at the points."""
    samples = len(points.areas)
    count = min(max(wanted.dimensions + 2, wanted.affinity_values), samples)
    if wanted.affinity == "distance":
        values, vectors = leading_eigenpairs(distance_affinity(points.distances), count)
        return values / samples, vectors
    if len(points.vertices) > samples:
        affinity = gaussian_affinity(points.distances, wanted.width, points.areas)
        return sampled_eigenpairs(affinity, points.areas, count)
    values, vectors = leading_eigenpairs(gaussian_affinity(points.distances, wanted.width), count)
    return values / samples, vectors
