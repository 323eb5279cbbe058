"""`python -m tests.soak.individuals DIR --seed 0`: write individuals whose proportions differ by 5 %.

Each person or quadruped is a class, and each pose has another mesh. `isoshape evaluate DIR --rank-by all`
shows how well the individuals are told apart.
"""

import argparse
from pathlib import Path

from numpy.random import default_rng

from core.gallery.bodies import make_body
from core.io import write_mesh

LABELS = ("person", "quadruped")
VARIATION = 0.05
LEAST_VERTICES, MOST_VERTICES = 1800, 3200


def main(folder: Path, *, seed: int, bodies: int, poses: int) -> None:
    """Write `bodies` individuals of each of `LABELS` in `poses` poses, as OFF, and labels.csv."""
    folder.mkdir(parents=True, exist_ok=True)
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
    print(f"{len(lines) - 1} meshes of {len(LABELS) * bodies} individuals in {folder}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tests.soak.individuals", description=__doc__)
    parser.add_argument("folder", metavar="DIR", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bodies", type=int, default=20)
    parser.add_argument("--poses", type=int, default=10)
    given = parser.parse_args()
    main(given.folder, seed=given.seed, bodies=given.bodies, poses=given.poses)
