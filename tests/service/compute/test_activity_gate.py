"""Work that no user waits for gives way to running requests."""

import asyncio
from contextlib import suppress

from service.compute.request_queue import ActivityGate


def test_it_waits_until_nothing_is_at_work_even_after_a_failure() -> None:
    async def run() -> list[str]:
        at_work, seen = ActivityGate(), []

        async def giving_way() -> None:
            await at_work.until_idle()
            seen.append("went on")

        with suppress(ValueError), at_work.running():
            waiting = asyncio.create_task(giving_way())
            with at_work.running():
                await asyncio.sleep(0)
            await asyncio.sleep(0)
            seen.append("one is left")
            raise ValueError
        await asyncio.wait_for(waiting, 1)
        return seen

    assert asyncio.run(run()) == ["one is left", "went on"]
