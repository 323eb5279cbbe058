"""Turns of clients at places of which there are few."""

import asyncio
from collections.abc import Callable
from contextvars import copy_context
from types import SimpleNamespace

import pytest

from service import turns as turns_module
from service.errors import BusyError
from service.turns import MOST_SECONDS, Pace, Place, Turns, current_client


def asked(turns: Turns, client: str) -> Place:
    """A place that a client asks for."""

    def ask() -> Place:
        current_client.set(client)
        return turns.ask()

    return copy_context().run(ask)


def on_a_loop(test: Callable[[], None]) -> Callable[[], None]:
    """Run a test in an event loop, which places belong to."""

    def run() -> None:
        async def body() -> None:
            test()

        asyncio.run(body())

    run.__name__, run.__doc__ = test.__name__, test.__doc__
    return run


@on_a_loop
def test_a_single_client_has_all_places_but_the_one_kept_for_others() -> None:
    turns = Turns(2)
    places = [asked(turns, "a") for _ in range(5)]
    assert [place.held for place in places] == [True, True, False, False, False]
    for done in range(3):
        turns.leave(places[done])
        assert [place.held for place in places[done + 1 :]] == [True, True, *[False] * (2 - done)]
    assert turns.inside == 2


@on_a_loop
def test_a_client_that_comes_has_a_place_at_once_and_the_next_waits_for_it() -> None:
    turns = Turns(2)
    flood = [asked(turns, "a") for _ in range(50)]
    first, second = asked(turns, "b"), asked(turns, "c")
    assert first.held
    assert not second.held
    turns.leave(first)
    assert second.held
    assert sum(place.held for place in flood) == 2


@on_a_loop
def test_all_places_but_one_are_kept_for_clients_that_left_lately() -> None:
    turns = Turns(3, kept_seconds=60.0)
    alone = asked(turns, "b")
    flood = [asked(turns, "a") for _ in range(9)]
    assert [place.held for place in flood[:3]] == [True, True, False]
    turns.leave(alone)
    assert not flood[2].held
    for client in "cde":
        came = asked(turns, client)
        assert came.held
        turns.leave(came)
    turns.leave(flood[0])
    turns.leave(flood[1])
    assert [place.held for place in flood[2:4]] == [True, False]
    again = asked(turns, "b")
    assert again.held


@on_a_loop
def test_a_place_kept_for_one_client_delays_no_other_that_holds_none() -> None:
    turns = Turns(2, kept_seconds=60.0)
    flood = [asked(turns, "a") for _ in range(9)]
    turns.leave(asked(turns, "b"))
    first, again = asked(turns, "c"), asked(turns, "b")
    assert [place.held for place in (*flood[:3], first, again)] == [True, True, False, True, False]
    turns.leave(flood[0])
    assert again.held


@on_a_loop
def test_no_place_is_kept_for_a_client_that_does_not_come_again() -> None:
    turns = Turns(3, kept_seconds=1e-9)
    turns.leave(asked(turns, "b"))
    assert [asked(turns, "a").held for _ in range(3)] == [True, True, True]
    for number in range(9):
        turns.leave(asked(turns, str(number)))
    assert len(turns._left) == 1


def test_a_place_is_given_once_it_is_kept_no_longer_though_nobody_comes_or_leaves() -> None:
    async def run() -> None:
        turns = Turns(2, kept_seconds=0.02)
        turns.leave(asked(turns, "b"))
        first, second = asked(turns, "a"), asked(turns, "a")
        assert [first.held, second.held] == [True, False]
        await asyncio.wait_for(second, 10.0)
        assert first.held

    asyncio.run(run())


@on_a_loop
def test_clients_that_wait_have_turns_however_many_waits_each_has() -> None:
    """Clients have 40, 3 and 1 requests, and the request that has its place for longest ends first."""
    turns = Turns(1)
    waits = [asked(turns, name) for name in "a" * 40 + "b" * 3 + "c"]
    at_work: list[Place] = []
    order = ""
    while turns.inside:
        at_work += [place for place in waits if place.held and place not in at_work]
        place = at_work.pop(0)
        waits.remove(place)
        turns.leave(place)
        order += place.client
    assert order == "abcabab" + "a" * 37


@on_a_loop
def test_in_a_full_room_the_newest_wait_of_the_client_with_the_most_gives_way() -> None:
    turns = Turns(1, room=6)
    flood = [asked(turns, "a") for _ in range(6)]
    with pytest.raises(BusyError):
        asked(turns, "a")
    # The first of the others is at the place that is kept.
    assert asked(turns, "b").held
    assert [place.done() for place in flood] == [True, False, False, False, False, True]
    others = [asked(turns, "b") for _ in range(2)]
    assert [place.done() for place in flood] == [True, False, False, True, True, True]
    assert all(isinstance(place.exception(), BusyError) for place in flood[3:])
    # Both wait for as many.
    for name in "ab":
        with pytest.raises(BusyError):
            asked(turns, name)
    assert not any(place.done() for place in [*flood[1:3], *others])
    assert turns.inside == 6


@on_a_loop
def test_a_room_of_single_waits_has_one_more_for_a_client_without_any() -> None:
    turns = Turns(1, room=3)
    places = [asked(turns, name) for name in "abcd"]
    assert turns.inside == 4
    for name in "abcde":
        with pytest.raises(BusyError):
            asked(turns, name)
    assert not any(place.done() for place in places[2:])


@on_a_loop
def test_a_wait_that_is_given_up_leaves_no_trace() -> None:
    turns = Turns(1)
    held, given_up, next_place = (asked(turns, "a") for _ in range(3))
    given_up.cancel()
    turns.leave(held)
    turns.leave(given_up)
    assert next_place.held
    turns.leave(next_place)
    assert turns.inside == 0
    assert not turns._held
    assert not turns._waiting


def test_a_turn_is_held_for_a_block_and_given_back_whatever_happens() -> None:
    async def run() -> None:
        turns = Turns(1)
        inside = asyncio.Event()

        async def work(error: Exception | None = None) -> None:
            async with turns.turn():
                inside.set()
                if error is not None:
                    raise error
                await asyncio.Event().wait()

        with pytest.raises(KeyError):
            await work(KeyError())
        assert turns.inside == 0
        inside.clear()
        tasks = [asyncio.create_task(work()) for _ in range(3)]
        await inside.wait()
        for task in reversed(tasks):
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        assert turns.inside == 0

    asyncio.run(run())


def test_what_a_client_asks_for_is_served_at_intervals_and_delays_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, slept = 100.0, []

    async def sleep(seconds: float) -> None:
        slept.append(seconds)

    # The names of this module alone: the loops of services in other threads have clocks, too.
    monkeypatch.setattr(turns_module, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(turns_module, "asyncio", SimpleNamespace(sleep=sleep))

    async def refuse(pace: Pace, clients: str) -> list[float]:
        slept.clear()
        for client in clients:
            await pace.wait(client)
        return slept

    pace, apart = Pace(20), 1 / 20
    assert asyncio.run(refuse(pace, "aab")) == [0, pytest.approx(apart), 0]
    assert asyncio.run(refuse(pace, "a" * 1000))[-1] == MOST_SECONDS
    now += MOST_SECONDS + 2 * apart
    assert asyncio.run(refuse(pace, "bac")) == [0, 0, 0]
    assert set(pace._next) == set("abc")
    now += 1
    assert asyncio.run(refuse(pace, "d")) == [0]
    assert set(pace._next) == {"d"}
    pace = Pace(20, at_once=10)
    assert asyncio.run(refuse(pace, "a" * 12)) == pytest.approx([0] * 10 + [apart, 2 * apart])
    assert asyncio.run(refuse(pace, "b")) == [0]
    assert asyncio.run(refuse(pace, "a" * 1000))[-1] == pytest.approx(MOST_SECONDS)
