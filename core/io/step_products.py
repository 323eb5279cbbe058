"""The instances of products in a STEP file, counted before OpenCASCADE expands them."""

import re
from graphlib import CycleError, TopologicalSorter

from core.errors import MalformedMeshError, MeshTooComplexError
from core.io.checks import Limits

_PLACES_PER_PART = 16
# An instance: its id, name and description, of at most 1,024 characters each; the product that contains it,
# and the product that it is an instance of. The quantifiers do not backtrack, so the time is linear.
_INSTANCE = re.compile(
    rb"\b(?:NEXT_ASSEMBLY_USAGE_OCCURRENCE|NAUO)\s{0,64}+\((?:'[^']{0,1024}+'|[^'#;)]){0,256}+"
    rb"#(\d{1,18}+)\s{0,64}+,\s{0,64}+#(\d{1,18}+)",
    re.IGNORECASE,
)


def check_products(data: bytes, limits: Limits) -> None:
    """Refuse assemblies that OpenCASCADE would expand without end, or into too many instances.

    The cost is that of one pass over the text, whatever the depth of the assemblies. Entities with comments
    inside, or with a text of more than 1,024 characters, are not counted; the limits of the process bound
    those.

    Raises
    ------
    MalformedMeshError
        A product contains itself.
    MeshTooComplexError
        The assemblies place more than 16 instances, assemblies included, for each part of the limit.
    """
    graph: dict[int, list[int]] = {}
    for found in _INSTANCE.finditer(data):
        graph.setdefault(int(found[1]), []).append(int(found[2]))
    most = _PLACES_PER_PART * limits.parts
    try:
        order = list(TopologicalSorter(graph).static_order())
    except CycleError:
        raise MalformedMeshError("a product of the STEP is a part of itself") from None
    inside: dict[int, int] = {}
    for product in order:
        inside[product] = sum(1 + inside[part] for part in graph.get(product, ()))
        if inside[product] > most:
            raise MeshTooComplexError(
                f"the STEP has more than {most} instances of parts and assemblies, the limit"
            )
