"""The network against a forward pass by SciPy, its views under rotation, and weights from hostile files."""

import hashlib
import io
import pickle
from collections import OrderedDict
from functools import cache

import numpy as np
import pytest
from scipy.signal import correlate

from core.descriptors import network_weights
from core.descriptors.network import EPSILON, FEATURES, SIZE, STRIDES
from core.descriptors.network_views import VIEWS, network_view_distance, network_views, session
from core.descriptors.network_weights import tensors
from core.descriptors.view_images import (
    BRIGHTEST,
    DARKEST,
    EMPTY,
    FARTHEST,
    FILLED,
    LIGHT,
    NEAREST,
    view_images,
)
from core.descriptors.views import view_surface
from core.mesh.mesh import Mesh
from tests.core.shapes import blob, box


@cache
def weights():
    return network_weights.network_weights()


def convolved(image, kernel, stride):
    """A convolution of one image, channels first, padded as TensorFlow pads: the odd pixel comes last."""
    size = kernel.shape[-1]
    out = -(-image.shape[1] // stride)
    padding = max((out - 1) * stride + size - image.shape[1], 0)
    around = (padding // 2, padding - padding // 2)
    image = np.pad(image, ((0, 0), around, around))
    if size == 1:
        return np.tensordot(kernel[:, :, 0, 0], image, 1)
    if kernel.shape[1] == 1:
        found = [
            correlate(plane, one[0], "valid", method="direct")
            for plane, one in zip(image, kernel, strict=True)
        ]
    else:
        found = [
            sum(correlate(p, k, "valid", method="direct") for p, k in zip(image, one, strict=True))
            for one in kernel
        ]
    return np.stack(found)[:, ::stride, ::stride]


def forward(image):
    """EfficientNet-Lite0 as its authors define it: each convolution, then its batch norm, then ReLU6."""

    def layer(value, name, norm, stride=1, bounded=True):
        value = convolved(value, weights()[f"{name}.weight"].astype(np.float64), stride)
        mean, variance, scale, shift = (
            weights()[f"{norm}.{part}"][:, None, None]
            for part in ("running_mean", "running_var", "weight", "bias")
        )
        value = (value - mean) / np.sqrt(variance + EPSILON) * scale + shift
        return np.clip(value, 0.0, 6.0) if bounded else value

    value = layer(image, "_conv_stem", "_bn0", 2)
    for block in range(16):
        name, start, stride = f"_blocks.{block}", value, STRIDES.get(block, 1)
        if block:
            value = layer(value, f"{name}._expand_conv", f"{name}._bn0")
        value = layer(value, f"{name}._depthwise_conv", f"{name}._bn1", stride)
        value = layer(value, f"{name}._project_conv", f"{name}._bn2", bounded=False)
        if value.shape == start.shape:
            value = value + start
    return layer(value, "_conv_head", "_bn1").mean(axis=(1, 2))


def test_the_features_are_those_of_a_plain_forward_pass():
    image = np.random.default_rng(0).uniform(-1.0, 1.0, size=(3, SIZE, SIZE))
    found = session().run(None, {"image": image[None].astype(np.float32)})[0]
    assert found.shape == (1, FEATURES)
    np.testing.assert_allclose(found[0], forward(image), atol=1e-3)


def rotation(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def views(mesh, turn=None, scale=1.0):
    vertices = mesh.vertices if turn is None else scale * mesh.vertices @ turn.T + 3.0
    return network_views(*view_surface(vertices, mesh.faces))


def test_views_follow_no_rotation_reflection_scale_or_translation():
    uneven = blob(3, 3)
    first, other = views(uneven), views(blob(4, 3))
    assert first.shape == (VIEWS, FEATURES)
    assert (np.abs(first).max(axis=1) == 127).all()
    turn = rotation(1)
    for each in (turn, turn * np.array([1.0, 1.0, -1.0])):
        near = network_view_distance(first, [views(uneven, each, 7.0)])[0]
        assert near < 0.05 < 0.3 * network_view_distance(first, [other])[0]


def test_the_flat_faces_of_a_turned_part_are_as_flat_as_before():
    part = box(5, 3, 1)
    for seed in range(3):
        turned = Mesh((part.vertices @ rotation(seed)).astype(np.float32).astype(np.float64), part.faces)
        assert network_view_distance(views(part), [views(turned)])[0] < 1e-3


def test_distances_are_those_of_the_definition():
    rng = np.random.default_rng(2)
    query, *others = rng.integers(-127, 128, size=(4, VIEWS, FEATURES)).astype(np.int8)
    query[:3] = others[0][3:]
    found = network_view_distance(query, others)
    for distance, other in zip(found, others, strict=True):
        a, b = (x / np.linalg.norm(x.astype(float), axis=1, keepdims=True) for x in (query, other))
        best = np.concatenate([(a @ b.T).max(axis=0), (a @ b.T).max(axis=1)])
        # The views of an axis follow one another, and meet those of another axis in either order.
        axes = np.array(
            [
                [
                    max((a[i:][:2] * b[j:][:2][order]).sum() / 2 for order in ([0, 1], [1, 0]))
                    for j in range(0, VIEWS, 2)
                ]
                for i in range(0, VIEWS, 2)
            ]
        )
        best_axes = np.concatenate([axes.max(axis=0), axes.max(axis=1)])
        assert distance == pytest.approx(1.0 - 0.5 * (best.mean() + best_axes.mean()), abs=1e-12)
    assert network_view_distance(query, [query]) == pytest.approx([0.0], abs=1e-12)


def test_a_box_fills_the_images_and_is_as_deep_as_it_is():
    mesh = box(4, 2, 1)
    images = view_images(mesh.vertices, mesh.faces, np.eye(3), 100)
    widths = {0: (2, 1), 1: (1, 4), 2: (4, 2)}  # along x one sees y and z, and so on
    for axis, (across, up) in widths.items():
        scale = FILLED * 100 / max(across, up)
        for image in images[2 * axis : 2 * axis + 2, 0]:
            covered = image != EMPTY
            assert covered.sum() == pytest.approx(across * up * scale**2, rel=0.05)
            assert np.ptp(image[covered]) == 0.0
    tilted = view_images(mesh.vertices, mesh.faces, rotation(5), 100)
    for image in tilted[:, 0]:
        depths = image[image != EMPTY]
        assert (depths.min(), depths.max()) == pytest.approx((FARTHEST, NEAREST), abs=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.6])
def test_the_shading_of_a_plane_is_the_cosine_of_its_normal_with_the_light(tilt):
    """The light comes from the first rows; the plane is turned about the axis of the rows."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float)
    # Seen along z, columns are x and rows are y.
    plane = np.column_stack([corners, corners[:, 1] * np.tan(tilt)])
    near, far = view_images(plane, np.array([(0, 1, 2), (0, 2, 3)]), np.eye(3), 64)[4:]
    for image, angle in ((near, LIGHT - tilt), (far, LIGHT + tilt)):
        depth, both, shading = image[:, 12:-12, 12:-12]
        np.testing.assert_allclose(shading, DARKEST + (BRIGHTEST - DARKEST) * np.cos(angle), atol=1e-6)
        np.testing.assert_allclose(both, 0.5 * (depth + shading), atol=1e-6)


class _Call:
    def __reduce__(self):
        return print, ("called",)


def test_a_pickle_that_calls_anything_is_refused(capsys):
    head = b"".join(pickle.dumps(value, 2) for value in (0x1950A86A20F9469CFC6C, 1001, {}))
    with pytest.raises(pickle.UnpicklingError, match="is no part of a tensor"):
        tensors(head + pickle.dumps(OrderedDict(weight=_Call()), 2))
    assert not capsys.readouterr().out


def test_a_tensor_outside_its_numbers_is_refused():
    with pytest.raises(ValueError, match="a tensor of shape"):
        network_weights._strided(np.zeros(5, np.float32), (2, 3), (3, 1))
    with pytest.raises(ValueError, match="a tensor of shape"):
        network_weights._strided(np.zeros(5, np.float32), (2,), (-1,))


def test_a_file_of_other_weights_is_refused(monkeypatch):
    monkeypatch.setattr(network_weights, "SHA256", hashlib.sha256(b"").hexdigest())
    with pytest.raises(ValueError, match="not the file"):
        network_weights.network_weights()


def test_reading_stops_at_the_end_of_a_cut_file():
    with pytest.raises((EOFError, pickle.UnpicklingError)):
        tensors(io.BytesIO(pickle.dumps(1, 2)).getvalue())
