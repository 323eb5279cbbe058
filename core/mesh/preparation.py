"""Preparation of a mesh before it is sampled: clean, closed, in its normal frame, bounded in size, smooth."""

from core.mesh.cleaning import Cleaned, clean
from core.mesh.denoising import roughness, taubin_smoothing
from core.mesh.hole_filling import fill_holes
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame, normal_frame
from core.mesh.simplification import simplify
from core.mesh.subdivision import refine
from core.parameters import MeshParameters


def prepared_surface(
    mesh: Mesh, wanted: MeshParameters, least_vertices: int
) -> tuple[Mesh, Cleaned, NormalFrame]:
    """The mesh that is sampled, the cleaned mesh and the normal frame.

    The sampled mesh is clean, has its holes filled, is in its normal frame, and is simplified, smoothed
    and refined as the parameters ask.

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
        surface = fill_holes(surface, wanted.fill_holes, cleaned.sides)
    frame = normal_frame(surface)
    needed = max(wanted.refine_vertices, least_vertices)
    normal = _simplified_and_smoothed(Mesh(frame.apply(surface.vertices), surface.faces), wanted, needed)
    return _refined(normal, needed), cleaned, frame


def open_surface(cleaned: Cleaned, wanted: MeshParameters, least_vertices: int) -> Mesh:
    """A cleaned mesh, simplified and smoothed, in its normal frame, with its boundary loops open.

    Parameters are those of `prepared_surface`.
    """
    frame = normal_frame(cleaned.mesh)
    normal = Mesh(frame.apply(cleaned.mesh.vertices), cleaned.mesh.faces)
    return _simplified_and_smoothed(normal, wanted, max(wanted.refine_vertices, least_vertices))


def _simplified_and_smoothed(normal: Mesh, wanted: MeshParameters, needed: int) -> Mesh:
    """Simplify a large mesh and smooth a rough one; the mesh is in its normal frame."""
    if wanted.decimate_above and len(normal.vertices) > wanted.decimate_above:
        normal = simplify(normal, wanted.decimate_to)
    return taubin_smoothing(normal, wanted.smooth_rounds) if _is_rough(normal, wanted, needed) else normal


def _is_rough(normal: Mesh, wanted: MeshParameters, needed: int) -> bool:
    most = wanted.smooth_above
    if not most or roughness(normal) <= most:
        return False
    return not wanted.smooth_refined or roughness(_refined(normal, needed)) > most


def _refined(normal: Mesh, needed: int) -> Mesh:
    """Split long edges of a mesh with too few vertices."""
    return refine(normal, needed) if len(normal.vertices) < needed else normal
