"""Embeddings as bytes (the safetensors format), and back."""

import json
from dataclasses import asdict

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from core.embedding import Embedding, Facts, Spectrum
from core.errors import BadRecordError


def embedding_to_bytes(embedding: Embedding) -> bytes:
    """The embedding as one block of bytes; the same embedding always gives the same bytes."""
    header = {
        "fingerprint": embedding.fingerprint,
        "facts": asdict(embedding.facts),
        "spectra": [spectrum.name for spectrum in embedding.spectra],
    }
    arrays = {
        "header": np.frombuffer(json.dumps(header, sort_keys=True).encode(), dtype=np.uint8),
        "positions": embedding.positions,
        "vertices": embedding.vertices,
        "graph_edges": embedding.graph_edges,
        "graph_lengths": embedding.graph_lengths,
        "tree_edges": embedding.tree_edges,
        "regions": embedding.regions,
        "signature": embedding.signature,
    }
    for i, spectrum in enumerate(embedding.spectra):
        arrays[f"eigenvalues_{i}"] = spectrum.eigenvalues
        arrays[f"coordinates_{i}"] = spectrum.coordinates
    return bytes(save({name: np.ascontiguousarray(array) for name, array in arrays.items()}))


def embedding_from_bytes(data: bytes) -> Embedding:
    """The embedding that `embedding_to_bytes` wrote.

    Raises
    ------
    BadRecordError
        The bytes are not such a record.
    """
    try:
        arrays = load(data)
        header = json.loads(arrays["header"].tobytes())
        return Embedding(
            fingerprint=header["fingerprint"],
            facts=Facts(**header["facts"]),
            positions=arrays["positions"],
            vertices=arrays["vertices"],
            graph_edges=arrays["graph_edges"],
            graph_lengths=arrays["graph_lengths"],
            tree_edges=arrays["tree_edges"],
            regions=arrays["regions"],
            signature=arrays["signature"],
            spectra=tuple(
                Spectrum(name, arrays[f"eigenvalues_{i}"], arrays[f"coordinates_{i}"])
                for i, name in enumerate(header["spectra"])
            ),
        )
    except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise BadRecordError(f"not an embedding: {error}") from error
