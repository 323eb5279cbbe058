"""Machine code of a whole match: its bits do not depend on who compiled it."""

from core.gallery import make_shape
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.serialization import embedding_to_bytes
from tests.core.numerics.test_compilation import assert_compiled_and_loaded_alike

MATCH = """
import sys
from pathlib import Path

import numpy as np

from core.parameters import DEFAULT
from core.pipeline import Pipeline
from core.serialization import embedding_from_bytes

shapes = [embedding_from_bytes(Path(path).read_bytes()) for path in sys.argv[1:]]
scores = [Pipeline(DEFAULT).score(shape, shapes) for shape in shapes]
print(np.array([[row.cc, row.ssd, row.sim] for row in scores]).tobytes().hex())
"""


def test_who_compiles_a_match_and_who_loads_it_find_the_same_bits(tmp_path):
    pipeline = Pipeline(DEFAULT)
    paths = []
    for name in ("pliers", "hand", "person"):
        paths.append(tmp_path / name)
        paths[-1].write_bytes(embedding_to_bytes(pipeline.embed(make_shape(name, 0))))
    assert_compiled_and_loaded_alike(MATCH, tmp_path, "compare_many", *paths)
