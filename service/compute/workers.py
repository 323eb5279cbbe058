"""What a service asks of its workers, wherever they are."""

from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
from numpy.typing import NDArray


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


class RemoteWorkers(Workers):
    """Workers of which each keeps something: a call is sent to where that is.

    Workers may serve others too: `user` is a number that tells what this service has them keep from that.
    """

    user: int

    @abstractmethod
    def owners(self, keys: NDArray[np.int64]) -> NDArray[np.str_]:
        """Which worker each key falls to, shape (n,): one that comes or goes moves no others' keys."""

    @abstractmethod
    def submit_to(self, owner: str, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:  # noqa: ANN401
        """Have `fn(*args)` called in a worker's own process, or in another's if it has gone."""
