"""Reliability of the intrinsic description: whether geodesics and eigenfunctions of a mesh tell its shape.

Geodesics and Laplace-Beltrami eigenfunctions describe the shape of a closed manifold surface of one piece.
On a polygon soup they follow the gaps and joints of the pieces, so two soups of one shape have different
spectra.
"""

from core.embedding import Facts

BOUNDARY_SHARE, NONMANIFOLD_SHARE = 0.02, 0.02
"""Shares of boundary edges and of nonmanifold edges, each of which halves the reliability."""

COMPONENT_WEIGHT = 0.5
"""Each component beyond the first counts as much as this share of such an amount."""


def intrinsic_reliability(facts: Facts) -> float:
    """In (0, 1]: 1 for a closed manifold mesh of one component, near 0 for a polygon soup.

    1 / (1 + b / 0.02 + m / 0.02 + (k - 1) / 2), with b and m the shares of edges that have one face and more
    than two faces, and k the number of components.

    Parameters
    ----------
    facts : Facts
    """
    edges = max(1.0, 1.5 * (facts.faces - facts.dropped_faces))
    faults = (
        facts.boundary_edges / edges / BOUNDARY_SHARE
        + facts.nonmanifold_edges / edges / NONMANIFOLD_SHARE
        + COMPONENT_WEIGHT * max(0, facts.components - 1)
    )
    return 1.0 / (1.0 + faults)
