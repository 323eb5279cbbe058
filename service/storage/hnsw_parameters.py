"""How the graph of signatures is made and searched."""

from dataclasses import dataclass


@dataclass(frozen=True)
class HnswParameters:
    """How a graph is made and searched.

    Attributes
    ----------
    m : int
        To how many others a signature is linked, twice as many on the lowest layer; 2 to 100.
    ef_construction : int
        How many near ones are kept in mind while its links are chosen; 2 m to 1,000.
    ef_search : int
        How many are while a query looks; 1 to 1,000.
    """

    m: int = 16
    ef_construction: int = 200
    ef_search: int = 400
