"""An asynchronous client that is called as the other one is, so that both can be tested alike."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any, Self

from service.client import AsyncClient


class Awaited:
    """Its methods are those of an `AsyncClient`, each waited for, on an event loop of its own."""

    def __init__(self, url: str, **options: Any) -> None:
        self._client = AsyncClient(url, **options)
        self._runner = asyncio.Runner()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._runner.run(self._client.close())
        self._runner.close()

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method = getattr(self._client, name)

        def waited_for(*given: Any, **options: Any) -> Any:
            answer = method(*given, **options)
            if isinstance(answer, AsyncIterator):
                return self._all_of(answer)
            return self._runner.run(answer)

        return waited_for

    def _all_of(self, items: AsyncIterator[Any]) -> Iterator[Any]:
        async def collected() -> list[Any]:
            return [item async for item in items]

        return iter(self._runner.run(collected()))
