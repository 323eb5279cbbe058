"""Names for the types of arrays; docstrings give their shapes."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Float32s = NDArray[np.float32]
Int32s = NDArray[np.int32]
Int8s = NDArray[np.int8]
Int16s = NDArray[np.int16]
Bytes = NDArray[np.uint8]
Reals = NDArray[np.floating]
"""Floating-point numbers of single or double precision."""
