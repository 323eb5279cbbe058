"""All hostile files."""

from tests.hostile import breaking, every_format, gltf, large, others, packages, polygons
from tests.hostile.case import Hostile

CORPUS: list[Hostile] = [
    case
    for module in (every_format, polygons, gltf, packages, others, breaking, large)
    for case in module.cases()
]
