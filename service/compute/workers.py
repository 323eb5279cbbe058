"""What a service asks of its workers, wherever they are."""

from abc import abstractmethod
from concurrent.futures import Executor


class Workers(Executor):
    """An executor that can be asked how it is, and stopped at once."""

    @abstractmethod
    def ready(self) -> bool:
        """Whether a worker can be had."""

    @abstractmethod
    def pids(self) -> list[int]:
        """The process ids of the workers that are warm, each on its machine."""

    @abstractmethod
    def idle(self) -> int:
        """How many tasks more could be begun at once."""

    @abstractmethod
    def busy(self) -> int:
        """How many tasks are at work."""

    @abstractmethod
    def starting(self) -> int:
        """How many workers are not warm yet."""

    @abstractmethod
    def waiting(self) -> int:
        """How many tasks no worker has taken yet."""

    @abstractmethod
    def kill(self) -> None:
        """Shut down at once; nothing that was begun is waited for."""
