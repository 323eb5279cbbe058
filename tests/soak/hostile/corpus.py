"""All hostile files."""

from tests.soak.hostile import every_format, gltf, large, others, packages, polygons
from tests.soak.hostile.case import Hostile

CORPUS: list[Hostile] = [
    case for module in (every_format, polygons, gltf, packages, others, large) for case in module.cases()
]
