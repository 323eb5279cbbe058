"""What is wrong with an archive, with one of its members, or with what is asked of a job."""

from service.errors import ServiceError


class JobNotFoundError(ServiceError):
    """No job has this id, or its record is kept no longer."""

    kind = "job-not-found"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job {job_id!r}")


class UnknownArchiveError(ServiceError):
    """The file is of no archive format that is read."""

    kind = "unknown-archive"


class MalformedArchiveError(ServiceError):
    """The archive cannot be read, or not to its end."""

    kind = "malformed-archive"


class ArchiveTooLargeError(ServiceError):
    """The archive holds more than the limits allow."""

    kind = "archive-too-large"


class MemberError(ServiceError):
    """A member of an archive cannot be used; the subclass says why."""

    kind = "member-damaged"


class MemberDamagedError(MemberError):
    """Its bytes cannot be had whole."""


class MemberNameError(MemberError):
    """Its name leads out of the archive, or cannot be a shape's."""

    kind = "member-name"


class MemberRepeatedError(MemberError):
    """An earlier member has its name."""

    kind = "member-repeated"


class MemberKindError(MemberError):
    """It is a link, a device, or a file with holes."""

    kind = "member-kind"


class MemberEncryptedError(MemberError):
    """It is encrypted."""

    kind = "member-encrypted"


class MemberTooLargeError(MemberError):
    """It is larger than the limits allow, or so is what it unpacks to."""

    kind = "member-too-large"


class NestedArchiveError(MemberError):
    """It is an archive itself."""

    kind = "nested-archive"
