"""Errors of the core; a service answers each by its `kind`."""


class CoreError(Exception):
    """Base class of every error that the core raises on purpose.

    `kind` is a stable, hyphenated name for programs; the message is for people.
    """

    kind = "core-error"


class MeshError(CoreError):
    """The mesh or its file cannot be used."""

    kind = "malformed-mesh"


class EmptyFileError(MeshError):
    """The file has no bytes."""

    kind = "empty-file"


class UnknownFormatError(MeshError):
    """The format is not supported."""

    kind = "unknown-format"


class MalformedMeshError(MeshError):
    """The file violates its format: it is truncated, a count is wrong, or an index is out of range."""

    kind = "malformed-mesh"


class NonFiniteCoordinatesError(MeshError):
    """A coordinate is NaN or infinite."""

    kind = "non-finite-coordinates"


class NoTrianglesError(MeshError):
    """The mesh has no faces; it may have points."""

    kind = "no-triangles"


class DegenerateMeshError(MeshError):
    """Every face has zero area."""

    kind = "degenerate-mesh"


class CannotBeEmbeddedError(MeshError):
    """The method fails on the mesh in a way that it does not expect; the cause is the error's `__cause__`."""

    kind = "cannot-be-embedded"


class MeshTooComplexError(MeshError):
    """The mesh has more vertices, faces or parts than the limit allows."""

    kind = "mesh-too-complex"


class ExternalReferenceError(MeshError):
    """The file refers to other files or addresses."""

    kind = "external-reference"


class ParameterError(CoreError):
    """A parameter is out of its range, or unknown."""

    kind = "bad-parameter"


class IncompatibleEmbeddingsError(CoreError):
    """Two embeddings have different parameters, so they cannot be compared."""

    kind = "incompatible-embeddings"


class BadRecordError(CoreError):
    """The bytes are not an embedding record."""

    kind = "bad-record"
