"""On real meshes: all are embedded."""

import numpy as np
import pytest

from core.descriptors.global_descriptors import GLOBAL_DESCRIPTORS
from core.parameters import DEFAULT
from core.pipeline import Pipeline
from service.datasets import read_collection
from tests.soak.collections.folders import every_collection, read

pytestmark = pytest.mark.collections

PIPELINE = Pipeline(DEFAULT)
PARTS = 8


@every_collection
@pytest.mark.parametrize("part", range(PARTS))
def test_every_file_is_read_and_embedded(folder, part):
    files = sorted(path for path, _ in read_collection(folder))[part::PARTS]
    assert files
    for path in files:
        embedding = PIPELINE.embed(read(path))
        assert len(embedding.positions) == DEFAULT.sampling.samples, path.name
        length = DEFAULT.spectral.affinity_values + DEFAULT.spectral.laplacian_values + GLOBAL_DESCRIPTORS
        assert len(embedding.signature) == length, path.name
        for array in (embedding.signature, *(spectrum.coordinates for spectrum in embedding.spectra)):
            assert np.isfinite(array).all(), path.name
