"""Preparation of a mesh before it is sampled: clean, closed, in its normal frame, bounded in size, smooth."""

from typing import NamedTuple

from core.mesh.cleaning import Cleaned, clean
from core.mesh.denoising import roughness, taubin_smoothing
from core.mesh.hole_filling import fill_holes
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame, normal_frame
from core.mesh.simplification import CONNECTED, simplify
from core.mesh.subdivision import refine
from core.parameters import MeshParameters


class PreparedSurface(NamedTuple):
    """A mesh that is ready to be sampled.

    Attributes
    ----------
    surface : Mesh
        Clean, with its holes filled, in its normal frame; simplified, smoothed and refined as the parameters
        ask.
    cleaned : Cleaned
    frame : NormalFrame
    smoothed : bool
        Whether the mesh was rough.
    """

    surface: Mesh
    cleaned: Cleaned
    frame: NormalFrame
    smoothed: bool


def prepared_surface(mesh: Mesh, wanted: MeshParameters, least_vertices: int) -> PreparedSurface:
    """Prepare a mesh.

    Parameters
    ----------
    mesh : Mesh
    wanted : MeshParameters
    least_vertices : int
        The vertices that the later stages need: a coarser mesh is refined.

    Raises
    ------
    DegenerateMeshError
        The mesh has no area.
    """
    cleaned = clean(mesh)
    surface = cleaned.mesh
    if wanted.fill_holes:
        surface = fill_holes(surface, wanted.fill_holes)
    frame = normal_frame(surface)
    normal = _simplified(Mesh(frame.apply(surface.vertices), surface.faces), wanted)
    fineness = _fineness(surface, normal, wanted, least_vertices)
    rough = _is_rough(normal, wanted, fineness)
    if rough:
        normal = taubin_smoothing(normal, wanted.smooth_rounds)
    return PreparedSurface(_refined(normal, fineness), cleaned, frame, rough)


def open_surface(cleaned: Cleaned, wanted: MeshParameters, least_vertices: int) -> Mesh:
    """A cleaned mesh, simplified and smoothed, in its normal frame, with its boundary loops open.

    Parameters are those of `prepared_surface`.
    """
    frame = normal_frame(cleaned.mesh)
    normal = _simplified(Mesh(frame.apply(cleaned.mesh.vertices), cleaned.mesh.faces), wanted)
    rough = _is_rough(normal, wanted, _fineness(cleaned.mesh, normal, wanted, least_vertices))
    return taubin_smoothing(normal, wanted.smooth_rounds) if rough else normal


def _simplified(normal: Mesh, wanted: MeshParameters) -> Mesh:
    """Simplify a large mesh; the mesh is in its normal frame."""
    most = wanted.decimate_above
    if most and len(normal.faces) < CONNECTED * len(normal.vertices):
        most = wanted.decimate_pieces_above or most
    return simplify(normal, wanted.decimate_to) if most and len(normal.vertices) > most else normal


def _fineness(given: Mesh, normal: Mesh, wanted: MeshParameters, least_vertices: int) -> int:
    """The vertices of an even mesh as fine as the surface must be; 0 if it is fine enough."""
    needed = max(wanted.refine_vertices, least_vertices)
    if wanted.refine_simplified and len(normal.vertices) < len(given.vertices):
        return max(wanted.refine_simplified, needed)
    return needed if len(normal.vertices) < needed else 0


def _is_rough(normal: Mesh, wanted: MeshParameters, fineness: int) -> bool:
    most = wanted.smooth_above
    if not most or roughness(normal) <= most:
        return False
    return not wanted.smooth_refined or roughness(_refined(normal, fineness)) > most


def _refined(normal: Mesh, fineness: int) -> Mesh:
    return refine(normal, fineness) if fineness else normal
