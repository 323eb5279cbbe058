"""Errors of archives, of their members and of requests about jobs."""

from service.errors import ServiceError


class JobNotFoundError(ServiceError):
    """No job has the id, or its record was deleted."""

    kind = "job-not-found"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job {job_id!r}")


class UnknownArchiveError(ServiceError):
    """The file is not an archive of a supported format."""

    kind = "unknown-archive"


class MalformedArchiveError(ServiceError):
    """The archive, or a part of it, cannot be read."""

    kind = "malformed-archive"


class ArchiveTooLargeError(ServiceError):
    """The archive exceeds the limits."""

    kind = "archive-too-large"


class MemberError(ServiceError):
    """A member of an archive is refused; the subclass gives the reason."""

    kind = "member-damaged"


class MemberDamagedError(MemberError):
    """The member cannot be unpacked completely."""


class MemberNameError(MemberError):
    """The name of the member leads out of the archive, or is not a valid name of a shape."""

    kind = "member-name"


class MemberRepeatedError(MemberError):
    """An earlier member has the same name."""

    kind = "member-repeated"


class MemberKindError(MemberError):
    """The member is a link, a device or a sparse file."""

    kind = "member-kind"


class MemberEncryptedError(MemberError):
    """The member is encrypted."""

    kind = "member-encrypted"


class MemberTooLargeError(MemberError):
    """The member exceeds the limits of size or compression ratio."""

    kind = "member-too-large"


class NestedArchiveError(MemberError):
    """The member is an archive."""

    kind = "nested-archive"
