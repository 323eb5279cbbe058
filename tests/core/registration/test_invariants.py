"""Invariants: copies of a part pass, and other parts of its family do not."""

from dataclasses import replace

import numpy as np
import pytest

from core.descriptors.facts import global_descriptors, gyration_radii, signed_volume
from core.mesh.bounding_box import bounding_box
from core.mesh.cleaning import centroid, face_areas
from core.mesh.mesh import Mesh
from core.registration.invariants import (
    COARSE,
    COARSE_GYRATION,
    GYRATION,
    Invariants,
    possible_copies,
    possible_variants,
)
from tests.studies.copies import moved
from tests.studies.kinship import PHASE
from tests.studies.machine_parts import Drawing, part

MESHES = [
    part("plate", Drawing(1, 0.05)),
    moved(part("plate", Drawing(1, 0.05)), 1, scale=25.4),
    moved(part("plate", Drawing(1, 0.1, PHASE)), 2, mirrored=True),
    part("plate", Drawing(1, 0.05, change="hole")),
    part("plate", Drawing(2, 0.05)),
    part("flange", Drawing(1, 0.05)),
]
FIRST, LARGER, REMESHED, DRILLED, OTHER, FLANGE = range(6)


def radius_and_extents(mesh: Mesh) -> tuple[float, list[float]]:
    areas = face_areas(mesh.vertices, mesh.faces)
    corners = mesh.vertices - centroid(mesh.vertices, mesh.faces, areas)
    corners = corners[mesh.faces]
    squares = ((corners**2).sum(axis=(1, 2)) + (corners.sum(axis=1) ** 2).sum(axis=1)) / 12.0
    unit = np.sqrt(areas.sum())
    radius = float(np.sqrt((areas * squares).sum() / areas.sum()) / unit)
    return radius, np.log(np.array(bounding_box(mesh)) / unit).tolist()


def volume_of(mesh: Mesh) -> float:
    return abs(signed_volume(mesh.vertices, mesh.faces))


@pytest.fixture(scope="module")
def surfaces() -> Invariants:
    rows = [radius_and_extents(mesh) for mesh in MESHES]
    # All spectra but the flange's are alike.
    eigenvalues = np.zeros((len(MESHES), 30), np.float32)
    eigenvalues[FLANGE] = 1.0
    return Invariants(
        eigenvalues=eigenvalues,
        descriptors=np.array([global_descriptors(mesh) for mesh in MESHES]),
        radii=np.array([radius for radius, _ in rows]),
        extents=np.array([extents for _, extents in rows]),
        gyration=np.log([np.array(gyration_radii(mesh)) / np.cbrt(volume_of(mesh)) for mesh in MESHES]),
        faces=np.array([len(mesh.faces) for mesh in MESHES]),
        closed=np.ones(len(MESHES), bool),
    )


def test_copies_pass_and_other_parts_do_not(surfaces: Invariants) -> None:
    # A hole more may pass: registration tells it.
    for place in (FIRST, LARGER, REMESHED):
        found = set(possible_copies(surfaces, place).tolist())
        assert found - {DRILLED} == {FIRST, LARGER, REMESHED} - {place}
    for place in (OTHER, FLANGE):
        assert not possible_copies(surfaces, place).size


def test_solids_with_other_radii_of_gyration_do_not_pass(surfaces: Invariants) -> None:
    gyration = surfaces.gyration.copy()
    gyration[LARGER] += 1.1 * COARSE_GYRATION
    found = possible_copies(replace(surfaces, gyration=gyration), FIRST)
    assert REMESHED in found
    assert LARGER not in found
    many = replace(surfaces, gyration=surfaces.gyration + 0.0, faces=np.full(len(MESHES), COARSE))
    many.gyration[LARGER] += 1.1 * GYRATION
    assert LARGER not in possible_copies(many, FIRST)
    assert LARGER in possible_copies(replace(many, faces=surfaces.faces), FIRST)


def test_variants_pass_as_variants(surfaces: Invariants) -> None:
    assert {LARGER, REMESHED, DRILLED} <= set(possible_variants(surfaces, FIRST).tolist())
    assert FLANGE not in possible_variants(surfaces, FIRST)


def test_the_volume_of_an_open_surface_does_not_count(surfaces: Invariants) -> None:
    descriptors = surfaces.descriptors.copy()
    descriptors[LARGER, :2] += 1.0
    for closed in (True, False):
        other = replace(surfaces, descriptors=descriptors, closed=np.full(len(MESHES), closed))
        found = possible_copies(other, FIRST)
        assert REMESHED in found
        assert (LARGER in found) is not closed
        assert FLANGE not in found


def test_spectral_distances(surfaces: Invariants) -> None:
    found = surfaces.spectral_distances(FIRST, np.array([LARGER, FLANGE]))
    assert found == pytest.approx([0.0, np.sqrt(30.0)])
