"""Whether a stored shape, read back, is one: finite numbers, and indices that refer to something."""

import io
from collections.abc import Mapping

import numpy as np


def other_format(format: str) -> str:
    """A format of text in which the mesh of a file has to be written anew to be read back."""
    return "obj" if format == "off" else "off"


def fault_in_mesh(facts: Mapping[str, float], data: bytes, format: str) -> str:
    """The fault of a stored mesh, as the service writes it in a format of text; "" without a fault.

    It is read here by the letter, without what the service reads by.
    """
    try:
        vertices, faces = {"off": _off, "obj": _obj}[format](data.split())
    except (ValueError, IndexError) as error:
        return f"the mesh is no {format}: {error}; {data[:100]!r}"
    if (len(vertices), len(faces)) != (facts["vertices"], facts["faces"]):
        return f"{len(vertices)} vertices and {len(faces)} faces are stored, and the facts are {facts}"
    if not np.isfinite(vertices).all():
        return "a coordinate is not finite"
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        return f"a face has a corner outside 0 .. {len(vertices)} - 1"
    return ""


def _off(words: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    if words[0] != b"OFF":
        raise ValueError("no OFF")
    end = 4 + 3 * int(words[1])
    faces = np.array(words[end:], int).reshape(int(words[2]), 4)
    if (faces[:, 0] != 3).any():
        raise ValueError("not only triangles")
    return np.array(words[4:end], float).reshape(-1, 3), faces[:, 1:]


def _obj(words: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    rows = np.array(words).reshape(-1, 4)
    faces = rows[:, 0] == b"f"
    if not (faces | (rows[:, 0] == b"v")).all():
        raise ValueError("not only vertices and triangles")
    return rows[~faces, 1:].astype(float), rows[faces, 1:].astype(int) - 1


def fault_in_embedding(facts: Mapping[str, float], npz: bytes) -> str:
    """The fault of a stored shape, by its facts and the arrays of its embedding; "" without a fault."""
    if not all((np.isfinite(value) & (np.asarray(value) >= 0)).all() for value in facts.values()):
        return f"facts {facts}"
    if not (facts["area"] > 0 and facts["scale"] > 0 and facts["faces"] >= 1 and facts["vertices"] >= 3):
        return f"no surface: {facts}"
    with np.load(io.BytesIO(npz), allow_pickle=False) as arrays:
        found = dict(arrays)
    for name, array in found.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            return f"{name} holds a number that is not finite"
    samples = len(found["positions"])
    bounds = dict.fromkeys(("graph_edges", "tree_edges", "regions"), samples)
    for name, bound in {**bounds, "vertices": facts["vertices"]}.items():
        if found[name].size and not (found[name].min() >= 0 and found[name].max() < bound):
            return f"{name} holds an index outside 0 .. {bound} - 1"
    lengths = (samples, len(found["vertices"]), len(found["tree_edges"]) + 1)
    if samples == 0 or len(set(lengths)) > 1:
        return f"samples, vertices and edges of the tree do not fit together: {lengths}"
    return ""
