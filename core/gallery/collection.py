"""The classes of the gallery, and its shapes by class and pose."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from zlib import crc32

import numpy as np
from numpy.random import Generator, default_rng

from core.arrays import Floats
from core.errors import MeshError, ParameterError
from core.gallery.animals import bird, fish, octopus, quadruped, snake, spider
from core.gallery.objects import chair, cup, glasses, plane, pliers
from core.gallery.people import hand, person, teddy
from core.gallery.solids import Part, rotation
from core.gallery.surface import genus, surface
from core.mesh.mesh import Mesh

_FEWEST, _MOST = 900, 3800
"""Number of vertices asked for; the result has a few more or fewer."""

_ATTEMPTS = 25
"""Draws of one pose: about one in ten has limbs that touch, so that running out has no practical chance."""


@dataclass(frozen=True)
class Kind:
    """A class: `build` returns the parts of an individual in a pose, from random numbers.

    `draws` has the letters of these numbers (`core.gallery.posing`), and `rest` their values at rest
    (`BodyDraws`); `handles` is the genus of the surface when no limbs touch.
    """

    build: Callable[[Generator], list[Part]]
    draws: str
    handles: int = 0
    rest: Mapping[int, float] = field(default_factory=dict)


KINDS = {
    "bird": Kind(bird, "bbbpppp" + "bb" + "p" + "bbbpp" + "ppppm" + "ppppm"),
    "chair": Kind(chair, "bbbbb" + "p" + "bbb" + "p"),
    "cup": Kind(cup, "b" * 9, handles=1),
    "fish": Kind(fish, "bb" + "p" * 7 + "bb" + "p" + "bb"),
    "glasses": Kind(glasses, "bbbbb" + "p" + "pmm" + "pmm", handles=2),
    "hand": Kind(hand, "bb", rest={5: 0.0}),
    "octopus": Kind(octopus, "bb" + "pp" + "b" + "ppmppp" * 8),
    "person": Kind(person, "b" * 5),
    "plane": Kind(plane, "bbbbbb" + "p" + "b" * 5),
    "pliers": Kind(pliers, "p" + "b" * 5),
    "quadruped": Kind(quadruped, "bbb" + "pppp" + "b" + "pp" + "bb" + "p" * 12 + "b"),
    "snake": Kind(snake, "bb", rest={3: 0.0, 7: 0.0}),
    "spider": Kind(spider, "b" + "pp" + "bbbb"),
    "teddy": Kind(teddy, "bb" + "ppp" + "b" + "ppmppppmp" * 2),
}

CLASSES: tuple[str, ...] = tuple(KINDS)
"""The class names, in the order of the gallery."""


def make_shape(label: str, pose: int, *, seed: int = 0) -> Mesh:
    """Return one shape: watertight, in one piece, faces outward.

    Proportions, pose, number of vertices (about 900 to 3,800), place, size and orientation (any turn about
    the vertical z, a tilt of up to 30 degrees) are drawn from the three arguments alone: the same arguments
    give the same bytes.

    The label is one of `CLASSES`; each pose >= 0 is another individual in another pose, and each seed >= 0
    gives another gallery. Raise ParameterError for other arguments.
    """
    if label not in KINDS:
        raise ParameterError(f"unknown class {label!r}; the classes are {', '.join(CLASSES)}")
    if pose < 0 or seed < 0:
        raise ParameterError(f"pose and seed must be at least 0, not {pose} and {seed}")
    kind = KINDS[label]
    for attempt in range(_ATTEMPTS):
        # The class enters by its name, so that a class added later leaves the others as they are.
        rng = default_rng([seed, crc32(label.encode()), pose, attempt])
        target = int(np.exp(rng.uniform(np.log(_FEWEST), np.log(_MOST))))
        vertices, faces = surface(kind.build(rng), target)
        # Limbs that touch are a short cut for geodesics; they show as one more handle.
        if genus(faces) == kind.handles:
            return Mesh(placed(vertices, rng), faces)
    raise MeshError(f"no sound shape of class {label} in {_ATTEMPTS} draws")


def placed(vertices: Floats, rng: Generator) -> Floats:
    """Turn, scale by 0.1 to 100 and move by up to five units of the new scale."""
    turn = rotation("z", rng.uniform(0.0, 360.0))
    tilt = rotation("x", rng.uniform(-30.0, 30.0)) @ turn
    scale = float(np.exp(rng.uniform(np.log(0.1), np.log(100.0))))
    return scale * (vertices @ tilt.T + rng.uniform(-5.0, 5.0, size=3))
