"""Write individuals whose proportions differ by 5 %, in several poses, as a collection.

    python -m tests.studies.individuals DIR [--seed 0] [--bodies 20] [--poses 10]

Each person or quadruped is a class, and each pose has another mesh. `isoshape evaluate DIR --rank-by all`
shows how well the individuals are told apart.
"""

from pathlib import Path

from numpy.random import default_rng

from core.gallery.bodies import make_body
from core.io import write_mesh
from tests.studies.common import run

LABELS = ("person", "quadruped")
VARIATION = 0.05
LEAST_VERTICES, MOST_VERTICES = 1800, 3200


def main(folder: Path, seed: int, bodies: int, poses: int) -> None:
    """Write `bodies` individuals of each of `LABELS` in `poses` poses, as OFF, and labels.csv."""
    lines = ["file,class"]
    for label in LABELS:
        for number in range(bodies):
            for pose in range(poses):
                vertices = int(default_rng([seed, number, pose]).integers(LEAST_VERTICES, MOST_VERTICES))
                body = make_body(label, 1000 * seed + number, vertices=vertices, variation=VARIATION)
                name = f"{label}-{number}-{pose}.off"
                (folder / name).write_bytes(write_mesh(body.posed(pose), "off"))
                lines.append(f"{name},{label}-{number}")
    (folder / "labels.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main, __doc__, seed=0, bodies=20, poses=10)
