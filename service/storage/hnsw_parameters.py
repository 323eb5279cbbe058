"""The parameters of the HNSW index of signatures."""

from dataclasses import dataclass


@dataclass(frozen=True)
class HnswParameters:
    """The parameters of an HNSW index (Malkov and Yashunin 2018).

    Attributes
    ----------
    m : int
        Neighbours of a signature in each layer, twice as many in the lowest; 2 to 100.
    ef_construction : int
        Size of the candidate list while the index is built; 2 m to 1,000.
    ef_search : int
        Size of the candidate list while the index is searched; 1 to 1,000.
    """

    m: int = 16
    ef_construction: int = 200
    ef_search: int = 400
