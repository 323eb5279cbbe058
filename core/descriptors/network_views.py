"""Views of a surface as a network trained on photographs sees them, where the extra `views` is installed.

EfficientNet-Lite0 (M. Tan, Q. Le, ICML 2019) with the weights of ImageNet sees six images of depth and
shading. Its pooled features are compared view by view, so neither the connectivity of the mesh nor its pieces
matter. H. Su, S. Maji, E. Kalogerakis, E. Learned-Miller, "Multi-view convolutional neural networks for 3D
shape recognition", ICCV 2015.
"""

from collections.abc import Sequence
from functools import cache
from importlib import resources
from importlib.util import find_spec
from typing import Any

import numpy as np

from core.arrays import Float32s, Floats, Int8s, Ints
from core.descriptors.network import FEATURES, SIZE, network
from core.descriptors.network_weights import PACKAGE, network_weights
from core.descriptors.view_frames import NormalisedSurface, directed_axes
from core.descriptors.view_images import view_images
from core.numerics.compilation import compiled, constant

VIEWS = 6
"""Number of views: along each axis of the frame of the points, and against it."""


@cache
def is_available() -> bool:
    """Return whether the packages of the extra `views` are installed."""
    return all(find_spec(name) for name in ("onnxruntime", PACKAGE))


def network_views(surface: NormalisedSurface, faces: Ints) -> Int8s:
    """Return the features of each view, shape (VIEWS, FEATURES), each row scaled to a maximum of 127.

    The roots of the features, less their mean over many shapes, are rounded. Rotation, reflection, scale and
    translation change them by rounding only.
    """
    images = view_images(surface.points, faces, directed_axes(surface, faces), SIZE)
    pixels = (255.0 * images - 127.0) / 128.0
    # One view at a time takes a sixth of the memory, and as long.
    features = np.concatenate([session().run(None, {"image": view[None]})[0] for view in pixels])
    centred = np.sqrt(features) - _mean()
    largest = np.maximum(np.abs(centred).max(axis=1, keepdims=True), np.finfo(np.float32).tiny)
    return np.asarray(np.rint(127.0 / largest * centred), dtype=np.int8)


def network_view_distance(query: Int8s, others: Sequence[Int8s]) -> Floats:
    """Compute distances between the views of one surface and of c others, shape (c,), in [0, 2].

    The distance is 1 less the mean of two similarities. The first is the mean cosine of each view of both
    with the most similar view of the other. The second compares axes so: the two views of an axis go together
    with the two of another axis, in the better order.
    """
    cosines = _cosines(constant(query), np.stack(others))
    pairs = cosines.reshape(-1, VIEWS // 2, 2, VIEWS // 2, 2)
    straight = pairs[:, :, 0, :, 0] + pairs[:, :, 1, :, 1]
    crossed = pairs[:, :, 0, :, 1] + pairs[:, :, 1, :, 0]
    of_axes = 0.5 * np.maximum(straight, crossed)
    return 1.0 - 0.5 * (_partner_similarity(cosines) + _partner_similarity(of_axes))


def _partner_similarity(cosines: Floats) -> Floats:
    """Return the mean cosine of each row and column with its best partner, from shape (c, v, v)."""
    return np.asarray(0.5 * (cosines.max(axis=1).mean(axis=1) + cosines.max(axis=2).mean(axis=1)))


def mean_view(views: Int8s) -> Float32s:
    """Return the mean direction of the views of a surface, shape (FEATURES,), of unit length or 0.

    Surfaces whose mean directions have a small angle are mostly those at a small distance.
    """
    mean = (views / _lengths(views)[:, None]).mean(axis=0)
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-6), dtype=np.float32)


@compiled
def _cosines(query: Int8s, stored: Int8s) -> Floats:
    """Return the cosines between the views of c surfaces and those of one, shape (c, VIEWS, VIEWS)."""
    lengths = _lengths(query)
    cosines = np.empty((len(stored), stored.shape[1], len(query)))
    for i in range(len(stored)):
        others = _lengths(stored[i])
        for j in range(len(others)):
            for k in range(len(lengths)):
                cosines[i, j, k] = _product(stored[i, j], query[k]) / (others[j] * lengths[k])
    return cosines


@compiled
def _lengths(views: Int8s) -> Floats:
    """Return the norms of views, at least 1, shape (VIEWS,)."""
    lengths = np.empty(len(views))
    for i in range(len(views)):
        lengths[i] = np.sqrt(max(np.float64(_product(views[i], views[i])), 1.0))
    return lengths


@compiled
def _product(first: Int8s, second: Int8s) -> np.int32:
    """Return the inner product of two views, a whole number."""
    total = np.int32(0)
    for i in range(len(first)):
        total = np.int32(total + np.int32(np.int32(first[i]) * np.int32(second[i])))
    return total


@cache
def model() -> bytes:
    """Return the network with its weights, 13 MB; raise ModuleNotFoundError without the extra `views`."""
    return network(network_weights())


@cache
def session() -> Any:  # noqa: ANN401  the module is not installed everywhere
    """Return the network, ready to run on the thread that calls it.

    Memory is allocated for each run, and returned after it: a worker process keeps no arena. A process that
    forks others has no session: the library takes 100 MB of address space in each of them.
    """
    from onnxruntime import InferenceSession, SessionOptions  # noqa: PLC0415  an extra

    options = SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.enable_cpu_mem_arena = False
    options.log_severity_level = 3
    return InferenceSession(model(), options, providers=["CPUExecutionProvider"])


@cache
def _mean() -> Float32s:
    """Return the means of the roots of the features over the views of many shapes, shape (FEATURES,)."""
    data = resources.files("core.descriptors").joinpath("network_mean.f16").read_bytes()
    return np.frombuffer(data, dtype="<f2").astype(np.float32).reshape(FEATURES)
