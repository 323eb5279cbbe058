"""What the core raises. A service turns each into an answer by its `kind`."""


class CoreError(Exception):
    """Base of every error the core raises on purpose.

    `kind` is a stable, hyphenated name that a program may branch on; the message is for a person.
    """

    kind = "core-error"


class MeshError(CoreError):
    """The mesh, or the file it should come from, cannot be used."""

    kind = "malformed-mesh"


class EmptyFileError(MeshError):
    """The file has no bytes."""

    kind = "empty-file"


class UnknownFormatError(MeshError):
    """The format is not one that is read."""

    kind = "unknown-format"


class MalformedMeshError(MeshError):
    """The file is not what its format promises: truncated, wrong counts, indices out of range."""

    kind = "malformed-mesh"


class NonFiniteCoordinatesError(MeshError):
    """A coordinate is NaN or infinite."""

    kind = "non-finite-coordinates"


class NoTrianglesError(MeshError):
    """There are points, perhaps, but no faces."""

    kind = "no-triangles"


class DegenerateMeshError(MeshError):
    """Every face has zero area."""

    kind = "degenerate-mesh"


class MeshTooComplexError(MeshError):
    """More vertices, faces or parts than the limit allows."""

    kind = "mesh-too-complex"


class ExternalReferenceError(MeshError):
    """The file refers to other files or addresses."""

    kind = "external-reference"


class ParameterError(CoreError):
    """A parameter is out of its range, or unknown."""

    kind = "bad-parameter"


class IncompatibleEmbeddingsError(CoreError):
    """Embeddings made with different parameters are never compared."""

    kind = "incompatible-embeddings"


class BadRecordError(CoreError):
    """Bytes that should hold an embedding do not."""

    kind = "bad-record"
