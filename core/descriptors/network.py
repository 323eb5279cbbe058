"""EfficientNet-Lite0 as an ONNX model, which onnxruntime runs on one thread.

The graph is written here by hand, in the wire format of protocol buffers: three operators, of which the batch
norms are folded into the convolutions before them. onnx.proto of version 1.17 has the numbers of the fields.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from core.arrays import Float32s

SIZE = 128
"""Width and height of an image. The network was trained with 224; 128 take a third of the time."""

FEATURES = 1280
"""Number of pooled features."""

EPSILON = 1e-3
"""The number that batch norms add to a variance."""

STRIDES = {0: 1, 1: 2, 3: 2, 5: 2, 11: 2}
"""Strides of the blocks that begin a stage; 1 for all others."""

BLOCKS = 16

OPSET, IR_VERSION = 13, 8
"""Versions of the operators and of the format."""

FLOAT = 1
"""The type of the numbers of a tensor."""

INT, STRING, INTS = 2, 3, 7
"""The types of attributes."""


def network(weights: dict[str, Float32s]) -> bytes:
    """Return the model, from images (n, 3, SIZE, SIZE) in [-1, 1] to features (n, FEATURES), >= 0.

    `weights` are those of `core.descriptors.network_weights`. The mean over the image of the last layer of
    convolutions, before the classifier, are the features.
    """
    graph = _Graph(weights)
    value = graph.convolution("image", "_conv_stem", "_bn0", stride=2)
    for block in range(BLOCKS):
        name, start = f"_blocks.{block}", value
        if f"{name}._expand_conv.weight" in weights:
            value = graph.convolution(value, f"{name}._expand_conv", f"{name}._bn0")
        stride = STRIDES.get(block, 1)
        value = graph.convolution(value, f"{name}._depthwise_conv", f"{name}._bn1", stride=stride)
        value = graph.convolution(value, f"{name}._project_conv", f"{name}._bn2", bounded=False)
        if graph.channels[value] == graph.channels.get(start) and stride == 1:
            value = graph.node("Add", [value, start], graph.channels[value])
    value = graph.convolution(value, "_conv_head", "_bn1")
    value = graph.node("GlobalAveragePool", [value], FEATURES)
    graph.node("Flatten", [value], FEATURES, "features")
    return graph.model()


class _Graph:
    """The nodes and the tensors of a graph; `channels` has the number of each value's."""

    def __init__(self, weights: dict[str, Float32s]) -> None:
        self._weights = weights
        self._nodes: list[bytes] = []
        self._tensors = [_tensor("least", np.float32(0.0)), _tensor("most", np.float32(6.0))]
        self.channels: dict[str, int] = {}

    def convolution(self, value: str, name: str, norm: str, *, stride: int = 1, bounded: bool = True) -> str:
        """Add a convolution with its batch norm folded into it, clipped to [0, 6] if `bounded`."""
        kernel = self._weights[f"{name}.weight"]
        scale = self._weights[f"{norm}.weight"] / np.sqrt(self._weights[f"{norm}.running_var"] + EPSILON)
        bias = self._weights[f"{norm}.bias"] - scale * self._weights[f"{norm}.running_mean"]
        self._tensors += [
            _tensor(f"{name}.kernel", kernel * scale[:, None, None, None]),
            _tensor(f"{name}.bias", bias),
        ]
        channels, inputs, size, _ = kernel.shape
        before = self.channels.get(value, inputs)
        attributes = [
            _text(1, "auto_pad") + _text(4, "SAME_UPPER") + _number(20, STRING),
            _text(1, "strides") + _number(8, stride) + _number(8, stride) + _number(20, INTS),
            _text(1, "kernel_shape") + _number(8, size) + _number(8, size) + _number(20, INTS),
            _text(1, "group") + _number(3, before // inputs) + _number(20, INT),
        ]
        value = self.node("Conv", [value, f"{name}.kernel", f"{name}.bias"], channels, attributes=attributes)
        return self.node("Clip", [value, "least", "most"], channels) if bounded else value

    def node(
        self,
        operator: str,
        inputs: Iterable[str],
        channels: int,
        output: str | None = None,
        attributes: Iterable[bytes] = (),
    ) -> str:
        """Add a node, and return the name of its output."""
        output = output or f"{operator}{len(self._nodes)}"
        fields = [*(_text(1, name) for name in inputs), _text(2, output), _text(4, operator)]
        self._nodes.append(b"".join([*fields, *(_field(5, attribute) for attribute in attributes)]))
        self.channels[output] = channels
        return output

    def model(self) -> bytes:
        """Return the model as a message of ONNX."""
        fields = [
            *(_field(1, node) for node in self._nodes),
            _text(2, "EfficientNet-Lite0"),
            *self._tensors,
            _field(11, _information("image", ("n", 3, SIZE, SIZE))),
            _field(12, _information("features", ("n", FEATURES))),
        ]
        # Each copy of the tensors would take 13 MB.
        start = _number(1, IR_VERSION) + _start(7, sum(map(len, fields)))
        return b"".join([start, *fields, _field(8, _number(2, OPSET))])


def _tensor(name: str, values: Float32s | np.float32) -> bytes:
    """Return the field of a graph that holds a tensor."""
    dimensions = b"".join(_number(1, length) for length in np.shape(values))
    content = _field(9, np.asarray(values, "<f4").tobytes())
    return _field(5, dimensions + _number(2, FLOAT) + _text(8, name) + content)


def _information(name: str, shape: tuple[str | int, ...]) -> bytes:
    """Return the name and the type of an input or output; a dimension with a name may have any length."""
    dimensions = (
        _field(1, _text(2, length) if isinstance(length, str) else _number(1, length)) for length in shape
    )
    tensor = _number(1, FLOAT) + _field(2, b"".join(dimensions))
    return _text(1, name) + _field(2, _field(1, tensor))


def _field(number: int, content: bytes) -> bytes:
    """Return a field of some bytes: its number, the length, and the bytes."""
    return _start(number, len(content)) + content


def _start(number: int, length: int) -> bytes:
    return _varint(number << 3 | 2) + _varint(length)


def _text(number: int, text: str) -> bytes:
    return _field(number, text.encode())


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _varint(value: int) -> bytes:
    """Return a whole number in groups of seven bits, the lowest first."""
    return bytes(_groups(value))


def _groups(value: int) -> Iterator[int]:
    while value > 127:
        yield value & 127 | 128
        value >>= 7
    yield value
