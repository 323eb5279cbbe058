"""Maps between bodies and mirror images of their poses: which are turned, mirrored, or said to be mirrored.

    python -m tests.studies.mirrored DIR [--limit 14] [--bodies 2] [--vertices 1200] [--tosca COLLECTION]

Each body made by code is matched with another pose on another mesh, and with the mirror image of that pose.
By class, `mirrored.csv` has the shares of pairs of which `mirrored` is true, the share of maps nearer to
another symmetry of the class than to the truth, turned (which keep orientation) or exchanged (which reverse
it), the share said to be ambiguous, and the mean error of the vertices. With --tosca, poses of one body of a
collection with `.vts` files as well; such a body is nearly its own mirror image, so images are not matched.
Exits with status 1 if `mirrored` is right for less than 95 % of either kind, over classes that are not
symmetric to the eye.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from core.evaluation.correspondence_errors import (
    PreparedMesh,
    dense_map,
    drawn_pairs,
    surface_distances,
    truth_errors,
)
from core.gallery import CLASSES
from core.gallery.bodies import make_body, symmetries
from core.mesh.mesh import Mesh
from core.pipeline import Pipeline
from service.evaluation.template_truth import known_of, read_truth
from tests.studies.common import run, write

SYMMETRIC = ("hand", "octopus", "snake")
"""Classes whose bodies are their own mirror images to the eye."""

LEAST = 0.95
FINER = 1.2
PIPELINE = Pipeline()


class Told(NamedTuple):
    """The truth about the map of one pair, and what is said of it."""

    image: bool
    mirrored: bool
    ambiguous: bool
    turned: bool
    exchanged: bool
    error: float


def mirror_image(mesh: Mesh) -> Mesh:
    """Return the mirror image of a mesh, its faces outwards as before."""
    return Mesh(mesh.vertices * (1.0, 1.0, -1.0), mesh.faces[:, ::-1])


def made_pairs(label: str, bodies: int, vertices: int) -> Iterator[Told]:
    """Yield what is told of each body of a class with another pose, and with its mirror image."""
    reverses = np.linalg.det(symmetries(label)) < 0.0
    for number in range(bodies):
        one, other = (make_body(label, number, vertices=count) for count in (vertices, int(FINER * vertices)))
        truth, distances = one.partners(other), surface_distances(other)
        first, posed = PreparedMesh.of(one.posed(0), PIPELINE), other.posed(1)
        for image in (False, True):
            second = PreparedMesh.of(mirror_image(posed) if image else posed, PIPELINE)
            found, targets = dense_map(first, second, PIPELINE)
            errors = distances[targets, truth].mean(axis=1)
            nearest = int(errors.argmin())
            yield Told(
                image=image,
                mirrored=found.mirrored is True,
                ambiguous=found.fitting > 1,
                turned=nearest > 0 and not reverses[nearest],
                exchanged=bool(reverses[nearest]),
                error=float(errors[0]),
            )


def known_pairs(collection: Path, limit: int) -> Iterator[tuple[str, Told]]:
    """Yield the class of each of some pairs of poses, and what is told of it."""
    files = read_truth(collection)
    classes = [str(file.label) for file in files]
    same, _ = drawn_pairs(classes, [str(file.template) for file in files], limit, 0)
    for pair in same:
        first, second = (known_of(files[which].path, 0) for which in pair)
        found, targets = dense_map(first, second, PIPELINE)
        errors = truth_errors(first, second, targets)
        exchanged = errors.symmetric < errors.direct
        mirrored, ambiguous = found.mirrored is True, found.fitting > 1
        yield classes[pair[0]], Told(False, mirrored, ambiguous, False, exchanged, errors.direct)


def row(label: str, told: Sequence[Told]) -> dict[str, Any]:
    """Return the shares of one class."""
    images, poses = ([each.mirrored for each in told if each.image is kind] for kind in (True, False))
    shares = {
        name: np.mean([getattr(each, name) for each in told])
        for name in ("turned", "exchanged", "ambiguous", "error")
    }
    return {
        "class": label,
        "pairs": len(told),
        "images_mirrored": np.mean(images) if images else "",
        "poses_mirrored": np.mean(poses),
        **shares,
    }


def main(folder: Path, limit: int, bodies: int, vertices: int, tosca: Path | None) -> bool:
    """Match, and write the table."""
    made = {label: list(made_pairs(label, bodies, vertices)) for label in list(CLASSES)[:limit]}
    chiral = [each for label, told in made.items() if label not in SYMMETRIC for each in told]
    rows = [row(label, told) for label, told in made.items()] + [row("not symmetric", chiral)]
    if tosca is not None:
        by_class: dict[str, list[Told]] = {}
        for label, told in known_pairs(tosca, 4 * limit):
            by_class.setdefault(label, []).append(told)
        rows += [row(label, told) for label, told in by_class.items()]
    write(folder / "mirrored.csv", rows)
    return all(
        np.mean([each.mirrored is kind for each in chiral if each.image is kind]) >= LEAST
        for kind in (True, False)
    )


if __name__ == "__main__":
    run(main, __doc__, limit=len(CLASSES), bodies=2, vertices=1200, tosca=Path)
