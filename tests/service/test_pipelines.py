"""One archive under several pipelines, and many clients at a time."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.service.support import Running, assert_problem, query, serving, settings_in, small_file, upload


def test_shapes_of_another_pipeline_are_kept_but_not_compared(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, workers=1)) as running:
        first = running.store(small_file(0), name="first", tags="old")
        second = running.store(small_file(1), name="second")
        fingerprint = running.client.get("/version").json()["fingerprint"]
    with serving(settings_in(tmp_path, workers=1, pipeline="paper")) as running:
        client = running.client
        told = client.get("/version").json()
        assert told["pipeline"] == "paper"
        assert told["fingerprint"] != fingerprint
        for shape in (first, second):
            assert client.get(f"/shapes/{shape['id']}").json() == {**shape, "embedded": False}
            assert_problem(client.get(f"/shapes/{shape['id']}/embedding"), 409, "not-embedded")
        answer = query(client, small_file(0)).json()
        assert (answer["results"], answer["compared"], answer["stored"]) == ([], 0, 2)
        assert answer["pipeline"] == told["fingerprint"]
        assert_problem(client.post("/query", json={"shape_id": first["id"]}), 409, "not-embedded")
        pair = {"first": first["id"], "second": second["id"]}
        assert_problem(client.post("/compare", json=pair), 409, "not-embedded")

        again = upload(client, small_file(0), "x.off", name="first", tags="new")
        assert again.status_code == 200
        assert again.json() == {**first, "embedded": True}
        answer = query(client, small_file(0)).json()
        assert [result["shape"]["id"] for result in answer["results"]] == [first["id"]]
        assert (answer["compared"], answer["stored"]) == (1, 2)
    with serving(settings_in(tmp_path, workers=1)) as running:
        answer = query(running.client, small_file(0)).json()
        assert (answer["compared"], answer["stored"]) == (2, 2)
        assert answer["pipeline"] == fingerprint
        assert running.client.get(f"/shapes/{first['id']}").json() == first
        assert running.client.delete(f"/shapes/{first['id']}").status_code == 204
        with running.parts.database.read() as session:
            left = session.connection().exec_driver_sql("SELECT fingerprint FROM embeddings").scalars().all()
        assert left == [fingerprint]


def test_many_uploads_of_one_file_make_one_shape(service: Running) -> None:
    with ThreadPoolExecutor(8) as clients:
        answers = list(clients.map(lambda _: upload(service.client, small_file(0), "same.off"), range(8)))
    assert sorted(answer.status_code for answer in answers) == [200] * 7 + [201]
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert query(service.client, small_file(0)).json()["stored"] == 1


def test_uploads_queries_and_deletions_at_a_time_agree_in_the_end(service: Running) -> None:
    kept = [service.store(small_file(number), f"kept-{number}.off")["id"] for number in range(3)]

    def come_and_go(number: int) -> None:
        shape = service.store(small_file(number), f"{number}.off")
        assert service.client.delete(f"/shapes/{shape['id']}").status_code == 204

    def ask(_: int) -> None:
        answer = query(service.client, small_file(0), top_k=100, filter="")
        assert answer.status_code == 200, answer.text
        body = answer.json()
        assert set(kept) <= {result["shape"]["id"] for result in body["results"]}
        assert body["results"][0]["shape"]["id"] == kept[0]

    with ThreadPoolExecutor(6) as clients:
        coming = [clients.submit(come_and_go, number) for number in range(10, 22)]
        asking = [clients.submit(ask, i) for i in range(12)]
        for each in coming + asking:
            each.result()
    answer = query(service.client, small_file(0), top_k=100).json()
    assert {result["shape"]["id"] for result in answer["results"]} == set(kept)
    assert answer["compared"] == answer["stored"] == 3
