"""The archive of a job, read as a file from its pieces in the database."""

from service.jobs import repository
from service.jobs.errors import JobNotFoundError
from service.jobs.records import JobRecord
from service.storage.database import Database

PIECE_BYTES = 4 * 1024 * 1024


class StoredArchive:
    """A read-only file on the pieces of an archive. It reads one piece at a time and caches the last.

    Methods raise `JobNotFoundError` if the archive was deleted: the job has ended, or was deleted.
    """

    def __init__(self, database: Database, job: JobRecord) -> None:
        self._database = database
        self._job = job
        self._position = 0
        self._piece: tuple[int, bytes] = (-1, b"")

    def tell(self) -> int:
        """The current position."""
        return self._position

    def seek(self, position: int, whence: int = 0) -> int:
        """Go to a position relative to the beginning, the current position or the end."""
        target = position + (0, self._position, self._job.size)[whence]
        if target < 0:
            raise OSError("the position is before the beginning of the file")
        self._position = target
        return target

    def read(self, size: int = -1) -> bytes:
        """Read `size` bytes, or fewer at the end."""
        left = max(0, self._job.size - self._position)
        size = left if size < 0 else min(size, left)
        got = bytearray()
        while len(got) < size:
            place, offset = divmod(self._position, PIECE_BYTES)
            part = self._at(place)[offset : offset + size - len(got)]
            got += part
            self._position += len(part)
        return bytes(got)

    def _at(self, place: int) -> bytes:
        if self._piece[0] != place:
            with self._database.read() as session:
                data = repository.piece(session, self._job.number, place)
            if data is None:
                raise JobNotFoundError(self._job.id)
            self._piece = (place, data)
        return self._piece[1]
