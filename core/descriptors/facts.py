"""Measurements of a mesh: sizes, area, volume, damage."""

from core.descriptors.boundary_ratio import boundary_ratio
from core.descriptors.global_descriptors import signed_volume
from core.embedding import Facts
from core.mesh.cleaning import Cleaned, face_areas
from core.mesh.mesh import Mesh
from core.mesh.normal_frame import NormalFrame


def measure(mesh: Mesh, cleaned: Cleaned, frame: NormalFrame) -> Facts:
    """Return the measurements of a mesh, from the mesh as read, the cleaned mesh and its normal frame."""
    faces = cleaned.mesh.faces
    volume = signed_volume(frame.apply(cleaned.mesh.vertices), faces)
    face_counts = cleaned.mesh.half_edges.face_counts
    area = float(face_areas(cleaned.mesh.vertices, faces).sum())
    return Facts(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        area=area,
        volume=float(abs(volume) * frame.scale**3),
        scale=frame.scale,
        components=cleaned.components,
        merged_vertices=cleaned.merged_vertices,
        dropped_faces=cleaned.dropped_faces,
        boundary_edges=int((face_counts == 1).sum()),
        nonmanifold_edges=int((face_counts > 2).sum()),
        boundary_ratio=boundary_ratio(cleaned.mesh, cleaned.mesh.half_edges, area),
    )
