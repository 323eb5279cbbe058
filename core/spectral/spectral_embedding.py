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
from core.spectral.laplace_beltrami import laplace_beltrami_spectrum
from core.spectral.orientation import ORIENTED, ORIENTING, face_signs, quantised_areas, signed_areas

FADED = 1e-6
"""Least squared weight of a tapered column, over the largest; the spline needs every dimension."""

SPECTRUM = 150
"""Number of eigenvalues of the Laplace-Beltrami operator that tell individuals apart."""

FAINTEST = 1e-2
"""Lower limit of an eigenvalue times the area; a tube a thousand times as long as wide has 0.03."""


@dataclass(frozen=True, eq=False)
class SampledSurface:
    """The d points of a surface that are embedded, their distances and areas.

    `vertices`, shape (d,), has the m samples first, and `distances`, shape (d, m), that from each point to
    each sample. `areas`, shape (m,), of sum 1, are the shares of the surface in the regions of the samples;
    `regions`, shape (n,), has the sample nearest to each vertex. `bridges`, shape (components - 1, 2), are
    pairs of vertices that join the components.
    """

    vertices: Ints
    distances: Floats
    areas: Floats
    regions: Ints
    bridges: Ints


def spectra_of(
    surface: Mesh, points: SampledSurface, wanted: SpectralParameters
) -> tuple[tuple[Spectrum, ...], Floats, Int8s, Floats]:
    """Return the spectral embeddings that the parameters name, signature, orientation and eigenvalues.

    The surface is in its normal frame. Embeddings are in the order of `wanted.operators`; the signature has
    the shape (affinity_values + laplacian_values,); the orientation, int8 of shape (m, p), is that of
    `core.embedding.Embedding`. The first `SPECTRUM` eigenvalues of the Laplace-Beltrami operator, or fewer,
    are times the area, ascending; there are none if the parameters do not ask for the operator.
    """
    orientation, spectrum = NO_ORIENTATION, np.empty(0)
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
        count = max(wanted.dimensions + 1, wanted.laplacian_values)
        values, functions, spectrum = laplace_beltrami_spectrum(surface, count, SPECTRUM, points.bridges)
        areas = face_areas(surface.vertices, surface.faces)
        area = float(areas.sum())
        spectrum = spectrum * area
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
    return tuple(spectra), np.concatenate(signature), orientation, spectrum


def spectral_coordinates(values: Floats, vectors: Floats, power: float, *, taper: bool = False) -> Floats:
    """Return the rows of the eigenvectors as points of the spectral domain, shape (m, k).

    Each column is multiplied by its eigenvalue's magnitude to the `power` (0: the paper's plain
    eigenvectors; 1/2: kernel principal components; -1/2 for a Laplacian: the global point signature). The
    points are then centred and scaled to unit root mean square radius.

    If the last eigenvalue kept is close to the first one dropped, a small change of the shape swaps their
    eigenvectors. Tapering subtracts the squared weight of the first eigenvalue dropped from each squared
    weight, so the last columns fade out as the two eigenvalues meet.

    Eigenvalues, shape (s,), s >= k, are by descending importance; tapering needs s > k. Eigenvectors are in
    columns, shape (m, k).
    """
    kept = vectors.shape[1]
    floor = 1e-9 * float(np.abs(values).max())
    squares = np.maximum(np.abs(values), floor) ** (2.0 * power)
    if taper:
        squares = np.maximum(squares - squares[kept], FADED * squares.max())
    points = vectors * np.sqrt(squares[:kept])
    points = points - points.mean(axis=0)
    return np.asarray(points / np.sqrt((points**2).sum(axis=1).mean()))


def affinity_signature(values: Floats) -> Floats:
    """Return the logarithms of the leading eigenvalues' magnitudes over the root of their number, shape (s,).

    The values are eigenvalues over the number of samples, or of the integral operator: those of a Gaussian
    affinity sum to at most 1, so shapes with different numbers of samples are comparable.
    """
    return np.asarray(np.log(np.maximum(np.abs(values), 1e-6)) / np.sqrt(max(1, len(values))))


def laplacian_signature(values: Floats, area: float) -> Floats:
    """Return the logarithms of eigenvalues times the area, over the root of their number, shape (s,).

    This is ShapeDNA (Reuter, Wolter, Peinecke 2006), normalised by the area. Its authors divide by the first
    eigenvalue, which a thin neck or a loose component changes most. The Euclidean distance of two signatures
    is the root mean square difference of logarithms, for any s. The values, ascending, are those after that
    of the constant function; the area is > 0.
    """
    return np.asarray(np.log(np.maximum(values * area, FAINTEST)) / np.sqrt(max(1, len(values))))


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
