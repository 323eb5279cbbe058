"""The interface of workers: processes on this machine, or a cluster."""

from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Workers(Executor):
    """An executor that reports its state and can be stopped at once."""

    @abstractmethod
    def ready(self) -> bool:
        """Whether a worker is available."""

    @abstractmethod
    def pids(self) -> list[int]:
        """The process ids of the warm workers, each on its machine."""

    @abstractmethod
    def idle(self) -> int:
        """The number of tasks that could start at once."""

    @abstractmethod
    def busy(self) -> int:
        """The number of running tasks."""

    @abstractmethod
    def starting(self) -> int:
        """The number of workers that are not warm yet."""

    @abstractmethod
    def waiting(self) -> int:
        """The number of tasks that no worker has taken yet."""

    @abstractmethod
    def kill(self) -> None:
        """Shut down at once, without waiting for running tasks."""


class RemoteWorkers(Workers):
    """Workers that keep data between calls: a call goes to the worker that owns its data.

    Workers may serve several services; the number `user` marks the data of this service.
    """

    user: int

    @abstractmethod
    def owners(self, keys: NDArray[np.int64]) -> NDArray[np.str_]:
        """The worker that owns each key, shape (n,). A worker that comes or goes moves only its own keys."""

    @abstractmethod
    def submit_to(self, owner: str, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:  # noqa: ANN401
        """Call `fn(*args)` in the process of this worker, or of another worker if this one has left."""
