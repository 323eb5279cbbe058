"""One person in several poses, each with a mesh of its own; `make_shape` makes other individuals."""

from numpy.random import PCG64, Generator, SeedSequence, default_rng

from core.errors import MeshError, ParameterError
from core.gallery.people import person
from core.gallery.surface import genus, surface
from core.mesh.mesh import Mesh

PROPORTIONS = 5
"""Number of random numbers that `person` draws before those of the pose: build, limbs, hips, shoulders."""

VERTICES, ATTEMPTS = 2500, 25


class _BodyThenPose(Generator):
    """Random numbers: one stream for the proportions, and another one for the pose."""

    def __init__(self, body: SeedSequence, pose: SeedSequence) -> None:
        super().__init__(PCG64(pose))
        self._body = default_rng(body)
        self._left = PROPORTIONS

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:  # type: ignore[override]
        """Return the next number, uniform in [low, high)."""
        if self._left == 0:
            return super().uniform(low, high)
        self._left -= 1
        return self._body.uniform(low, high)


def make_person(body: int, pose: int) -> Mesh:
    """Return a person about 1.75 tall, of about 2,500 vertices: watertight, in one piece, faces outward.

    Parameters
    ----------
    body : int
        >= 0; the individual, with its own proportions.
    pose : int
        >= 0; the pose of the limbs. Every pose has its own mesh.

    Raises
    ------
    ParameterError
        The body or the pose is negative.
    """
    if body < 0 or pose < 0:
        raise ParameterError(f"body and pose must be at least 0, not {body} and {pose}")
    for attempt in range(ATTEMPTS):
        draws = _BodyThenPose(SeedSequence([body]), SeedSequence([body, pose, attempt]))
        vertices, faces = surface(person(draws), VERTICES)
        # Touching limbs shorten geodesics; they show as an additional handle.
        if genus(faces) == 0:
            return Mesh(vertices, faces)
    raise MeshError(f"no sound shape of body {body} in {ATTEMPTS} draws of pose {pose}")
