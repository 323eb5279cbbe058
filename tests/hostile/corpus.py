"""All hostile files."""

from tests.hostile import every_format, gltf, large, others, polygons
from tests.hostile.case import Hostile

CORPUS: list[Hostile] = [
    case for module in (every_format, polygons, gltf, others, large) for case in module.cases()
]
