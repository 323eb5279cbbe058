"""Landmarks, points, curves and values of a comparison: from JSON to arrays, and back."""

import numpy as np

from core.arrays import Floats
from core.dense.transfer import Transferred, Wanted, curve_length
from core.mesh.mesh import Mesh
from service.errors import BadRequestFieldsError, FieldFault
from service.search.transfer_schemas import (
    Distances,
    Landmark,
    Transfer,
    TransferAnswer,
    TransferredCurve,
    TransferredPoint,
)


def landmarks_of(landmarks: list[Landmark] | None) -> tuple[Floats, Floats] | None:
    """Return the points of landmarks on both shapes, shape (l, 3) each."""
    if landmarks is None:
        return None
    return np.array([each.first for each in landmarks]), np.array([each.second for each in landmarks])


def wanted_of(transfer: Transfer, mesh: Mesh) -> Wanted:
    """Return what is to be transferred from a mesh, as arrays.

    Raise BadRequestFieldsError unless there is a value for each vertex, or none.
    """
    if transfer.values is not None and len(transfer.values) != len(mesh.vertices):
        fault = f"{len(transfer.values)} values for the {len(mesh.vertices)} vertices of the first file"
        raise BadRequestFieldsError(FieldFault("transfer.values", fault))
    return Wanted(
        points=np.array(transfer.points, dtype=np.float64).reshape(-1, 3),
        curves=tuple(np.array(curve, dtype=np.float64) for curve in transfer.curves),
        values=None if transfer.values is None else np.array(transfer.values, dtype=np.float64),
    )


def answer_of(found: Transferred) -> TransferAnswer:
    """Return what has been transferred, as JSON."""
    places = zip(found.points.points.tolist(), found.points.confidence.tolist(), strict=True)
    values = None
    if found.values is not None:
        values = [None if np.isnan(value) else value for value in found.values.tolist()]
    first, second = found.distances or (None, None)
    return TransferAnswer(
        points=[TransferredPoint(position=at, confidence=round(sure, 4)) for at, sure in places],
        curves=[_curve(ours, theirs) for ours, theirs in found.curves],
        values=values,
        first_distances=_distances(first),
        second_distances=_distances(second),
        landmark_gaps=found.gaps.tolist(),
    )


def _curve(ours: Floats, theirs: Floats) -> TransferredCurve:
    return TransferredCurve(
        first=ours.tolist(),
        second=theirs.tolist(),
        first_length=curve_length(ours),
        second_length=curve_length(theirs),
    )


def _distances(found: tuple[Floats, Floats] | None) -> Distances | None:
    if found is None:
        return None
    straight, along = found
    return Distances(straight=straight.tolist(), along=along.tolist())
