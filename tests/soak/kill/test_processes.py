"""A server process that is killed while clients write, on both engines."""

import signal
import threading
from pathlib import Path

import httpx

from tests.service.engines import on_both
from tests.service.processes import children, server
from tests.service.support import query, small_file, upload, wait_until


@on_both
def test_a_killed_service_has_all_that_it_had_acknowledged(tmp_path: Path) -> None:
    acknowledged: dict[str, str] = {}
    deleted: set[str] = set()
    stop = threading.Event()

    def send(client: httpx.Client, start: int) -> None:
        number = start
        while not stop.is_set():
            try:
                answer = upload(client, small_file(number), f"{number}.off", tags=str(number))
            except httpx.TransportError:
                return
            if answer.status_code == 201:
                acknowledged[answer.json()["id"]] = str(number)
                if number % 5 == 0:
                    gone = answer.json()["id"]
                    try:
                        if client.delete(f"/shapes/{gone}").status_code == 204:
                            deleted.add(gone)
                    except httpx.TransportError:
                        acknowledged.pop(gone)
                        return
            number += 3

    with server(tmp_path) as (process, client):
        threads = [threading.Thread(target=send, args=(client, start)) for start in range(3)]
        for thread in threads:
            thread.start()
        wait_until(lambda: len(acknowledged) >= 12, seconds=60)
        orphans = children(process.pid)
        assert len(orphans) >= 2
        process.send_signal(signal.SIGKILL)
        process.wait()
        stop.set()
        for thread in threads:
            thread.join()
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in orphans), seconds=30)
    expected = {shape_id: name for shape_id, name in acknowledged.items() if shape_id not in deleted}
    assert expected
    assert deleted
    with server(tmp_path) as (process, client):
        page = client.get("/shapes", params={"limit": 500}).json()
        stored = {shape["id"]: shape for shape in page["shapes"]}
        assert set(expected) <= set(stored)
        assert not deleted & set(stored)
        for shape_id, number in expected.items():
            assert stored[shape_id]["tags"] == [number]
            assert client.get(f"/shapes/{shape_id}/file").content == small_file(int(number))
        answer = query(client, small_file(int(number)), top_k=1).json()
        assert answer["compared"] == answer["stored"] == len(stored)
        assert answer["results"][0]["shape"]["id"] == shape_id
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) in {0, -signal.SIGTERM}
