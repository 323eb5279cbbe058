"""What no user waits for gives way to what is at work."""

import asyncio

from service.compute.request_queue import ActivityGate


def test_it_waits_until_nothing_is_at_work() -> None:
    async def run() -> list[str]:
        at_work, seen = ActivityGate(), []

        async def giving_way() -> None:
            await at_work.until_idle()
            seen.append("went on")

        with at_work.running():
            waiting = asyncio.create_task(giving_way())
            with at_work.running():
                await asyncio.sleep(0)
            await asyncio.sleep(0)
            seen.append("one is left")
        await waiting
        await asyncio.wait_for(at_work.until_idle(), 1)
        return seen

    assert asyncio.run(run()) == ["one is left", "went on"]


def test_a_failed_task_is_no_longer_at_work() -> None:
    async def run() -> None:
        at_work = ActivityGate()
        try:
            with at_work.running():
                raise ValueError
        except ValueError:
            pass
        await asyncio.wait_for(at_work.until_idle(), 1)

    asyncio.run(run())
