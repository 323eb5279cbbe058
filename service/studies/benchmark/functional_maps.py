"""Functional maps by pyfmaps, to compare with our matching."""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from core.mesh.mesh import Mesh

SPECTRUM = 200
"""Number of eigenvalues that pyfmaps computes by default."""


@dataclass(frozen=True)
class Peer:
    """A matching method in two steps.

    Attributes
    ----------
    spectrum : Mesh -> object
        Computes the spectrum of a mesh.
    match : (object, object) -> dict of str to float
        Matches two spectra in one direction; seconds by stage, whose sum is the total.
    """

    spectrum: Callable[[Mesh], Any]
    match: Callable[[Any, Any], dict[str, float]]


def functional_maps() -> Peer:
    """Pyfmaps: a map fitted to wave kernel signatures, and refined by ZoomOut.

    The options are the library's defaults, except that the Laplacian is the robust one: the plain Laplacian
    fails if a face has no area. The example of the library's README (30 eigenvalues and an orientation term,
    then 110 eigenvalues) is slower. The map is not converted to pairs of points.

    Raises
    ------
    ImportError
        Pyfmaps is not installed.
    """
    from pyFM.functional import FunctionalMapping  # noqa: PLC0415  optional
    from pyFM.mesh import TriMesh  # noqa: PLC0415  optional

    def spectrum(mesh: Mesh) -> Any:  # noqa: ANN401  the library's own
        surface = TriMesh(mesh.vertices.copy(), mesh.faces.copy(), area_normalize=True, center=True)
        return surface.process(SPECTRUM, robust=True)

    def match(first: Any, second: Any) -> dict[str, float]:  # noqa: ANN401  the library's own
        start = perf_counter()
        model = FunctionalMapping(first, second)
        model.preprocess(k_process=SPECTRUM)
        describe = perf_counter()
        model.fit()
        fitted = perf_counter()
        model.zoomout_refine()
        refined = perf_counter()
        return {"descriptors": describe - start, "fit": fitted - describe, "refine": refined - fitted}

    return Peer(spectrum, match)
