"""Web models and ten changed copies of each, in every format: area, volume and box as they were written.

Three are compared: what `core.io` reads, what trimesh reads, and the triangles that were written, which are
those of the model, transformed. One formula computes all figures from triangles. Where trimesh reads other
triangles, they must be those that its fault, named in `FAULTS`, makes of the file.
"""

import io
import warnings
from collections import defaultdict
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

from core.arrays import Floats
from core.errors import CoreError
from core.io import read_mesh
from core.mesh.mesh import face_normals
from tests.soak.collections import polygon_copies, scene_copies
from tests.soak.collections.copies import MOST, Copy, Writer, by_core, by_trimesh
from tests.soak.collections.folders import read, sample

COPIES = 10
LARGEST = 1e-3
"""Largest relative difference of area, volume and box."""
LEAST_VOLUME = 1e-3
"""Least volume that a difference is measured by, over the area times the diagonal of the box: the volumes of
the parts of an open surface cancel."""

KINDS: dict[str, Writer] = {
    "STL by core.io": by_core("stl"),
    "STL by trimesh": by_trimesh("stl"),
    "STL text by trimesh": by_trimesh("stl_ascii", "stl"),
    "STL text of many solids": polygon_copies.stl_text,
    "STL with attributes": polygon_copies.stl_binary,
    "PLY by core.io": by_core("ply"),
    "PLY by trimesh": by_trimesh("ply"),
    "PLY text by trimesh": by_trimesh("ply", encoding="ascii"),
    "PLY big-endian of polygons": polygon_copies.ply_big_endian,
    "PLY text of polygons": partial(polygon_copies.ply_text, lists=False),
    "PLY text with lists at vertices": partial(polygon_copies.ply_text, lists=True),
    "PLY with lists and floats": polygon_copies.ply_lists,
    "PLY of strips": polygon_copies.ply_strips,
    "OFF by core.io": by_core("off"),
    "OFF by trimesh": by_trimesh("off"),
    "OFF of coloured polygons": polygon_copies.off_polygons,
    "OFF with homogeneous coordinates": polygon_copies.off_homogeneous,
    "OFF wrapped": polygon_copies.off_wrapped,
    "OBJ by core.io": by_core("obj"),
    "OBJ by trimesh": by_trimesh("obj"),
    "OBJ of groups, counted back": polygon_copies.obj_blocks,
    "OBJ of quadrilaterals": partial(polygon_copies.obj_polygons, most=2),
    "OBJ of polygons, a group each": partial(polygon_copies.obj_polygons, most=MOST),
    "GLB by core.io": by_core("glb"),
    "GLB by trimesh": by_trimesh("glb"),
    "GLB of instances": partial(scene_copies.gltf_instances, embedded=False),
    "glTF of instances, embedded": partial(scene_copies.gltf_instances, embedded=True),
    "glTF by trimesh, in a ZIP": by_trimesh("gltf", "zip"),
    "GLB of many primitives": scene_copies.gltf_primitives,
    "GLB of strips": scene_copies.gltf_strips,
    "GLB of fans": scene_copies.gltf_fans,
    "GLB quantized": scene_copies.gltf_quantized,
    "GLB sparse": scene_copies.gltf_sparse,
    "GLB with skin and morph target": scene_copies.gltf_posed,
    "GLB of GPU instances": scene_copies.gltf_copies,
    "3MF by core.io": by_core("3mf"),
    "3MF of an assembly in inches": scene_copies.threemf_assembly,
}
"""What writes each kind of file."""

CONCAVE, UNEQUAL = "cuts concave polygons into fans", "fails on rows of different lengths"
FAULTS = {
    "PLY big-endian of polygons": UNEQUAL,
    "PLY text of polygons": CONCAVE,
    "PLY text with lists at vertices": CONCAVE,
    "PLY with lists and floats": UNEQUAL,
    "PLY of strips": "does not read strips",
    "OFF of coloured polygons": "fails on more than four corners",
    "OFF with homogeneous coordinates": "does not divide by the fourth",
    "OFF wrapped": "takes each line for a row",
    "OBJ of groups, counted back": "counts back from the last vertex of the file",
    "OBJ of quadrilaterals": CONCAVE,
    "OBJ of polygons, a group each": CONCAVE,
    "GLB of fans": "leaves fans out",
    "GLB quantized": "leaves integers as they are",
    "GLB sparse": "leaves sparse values out",
    "GLB with skin and morph target": "leaves skins and morph targets out",
    "GLB of GPU instances": "reads one of the instances",
    "3MF by core.io": "needs further packages",
    "3MF of an assembly in inches": "needs further packages",
}
"""Why trimesh reads other figures than were written, or nothing."""


@dataclass
class Row:
    """The files of one kind: how many were read, and the largest differences."""

    files: int = 0
    both: int = 0
    ours: int = 0
    theirs: int = 0
    from_written: float = 0.0
    from_trimesh: float = 0.0
    differing: int = 0
    wrong: list[str] = field(default_factory=list)


def figures(triangles: Floats) -> Floats:
    """Return the area, the volume about the middle of the box, and the corners of the box, shape (8,)."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    areas = np.linalg.norm(face_normals(triangles, unit=False), axis=1) / 2
    centred = triangles - (low + high) / 2
    volume = np.einsum("ij,ij->i", centred[:, 0], np.cross(centred[:, 1], centred[:, 2])).sum() / 6
    return np.array([areas.sum(), volume, *low, *high])


def difference(found: Floats, expected: Floats) -> float:
    """Return the largest relative difference of two results of `figures`."""
    size = float(np.linalg.norm(expected[5:] - expected[2:5]))
    scales = [expected[0], max(abs(expected[1]), LEAST_VOLUME * expected[0] * size), *[size] * 6]
    return float((np.abs(found - expected) / scales).max())


def read_by_core(copy: Copy) -> Floats:
    """Return the figures by `core.io`, in the unit of the file."""
    mesh = read_mesh(copy.data, copy.ending)
    return figures(mesh.vertices[mesh.faces] / copy.unit)


def read_by_trimesh(copy: Copy) -> Floats | None:
    """Return the figures by trimesh; None if it does not read the file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            mesh = trimesh.load_mesh(io.BytesIO(copy.data), file_type=copy.ending, process=False)
        except Exception:
            return None
    return figures(mesh.triangles) if len(mesh.faces) else None


def model(path: Path) -> Copy:
    """Return a model of the collection, an OBJ of triangles, read by its lines alone."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=float)
    faces = [[int(corner.partition("/")[0]) - 1 for corner in row[1:]] for row in rows if row[:1] == ["f"]]
    return Copy(path.read_bytes(), "obj", vertices[np.array(faces)])


def compared(row: Row, name: str, copy: Copy) -> None:
    """Add one file to the row of its kind."""
    row.files += 1
    expected, theirs = figures(copy.triangles), read_by_trimesh(copy)
    try:
        ours = read_by_core(copy)
    except CoreError as error:
        row.theirs += theirs is not None
        row.wrong.append(f"{name}: {error}")
        return
    row.both, row.ours = row.both + (theirs is not None), row.ours + (theirs is None)
    off = difference(ours, expected)
    row.from_written = max(row.from_written, off)
    if off > LARGEST:
        row.wrong.append(f"{name}: {off:.2%} from what was written")
    if theirs is not None:
        apart = difference(theirs, ours)
        row.from_trimesh = max(row.from_trimesh, apart)
        row.differing += apart > LARGEST
        fault = np.inf if copy.misread is None else difference(theirs, figures(copy.misread))
        if apart > LARGEST < fault:
            row.wrong.append(f"{name}: trimesh reads something else")


def test_area_volume_and_box_are_those_that_were_written() -> None:
    rows: dict[str, Row] = defaultdict(Row)
    names = list(KINDS)
    for number, (path, _) in enumerate(sample("webmodels")):
        mesh = read(path)
        compared(rows["the models, OBJ"], path.name, model(path))
        for copy in range(COPIES):
            # Every kind gets as many models.
            name = names[(COPIES * number + copy) % len(names)]
            compared(rows[name], path.name, KINDS[name](mesh, np.random.default_rng([number, copy])))
    print("Largest relative differences, and the files in which trimesh differs by more than 0.1 %:\n")
    print("| kind | files | both | only core.io | only trimesh | written | trimesh | differing | trimesh |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---|")
    for name, row in rows.items():
        print(
            f"| {name} | {row.files} | {row.both} | {row.ours} | {row.theirs} | {row.from_written:.0e} | "
            f"{row.from_trimesh:.0e} | {row.differing} | {FAULTS.get(name, '')} |"
        )
    assert [f"{name}, {wrong}" for name, row in rows.items() for wrong in row.wrong] == []
    assert {name for name, row in rows.items() if row.differing or row.ours} <= set(FAULTS)
