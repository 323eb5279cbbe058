"""Words of paths: they find shapes, follow the files, and are for keys that may see paths."""

import os
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select

from service.auth.keys import KeyRing, digest_of
from service.sources.service import forget_removed
from service.storage.tables import ShapeRow, ShapeWordRow, WordRow
from service.storage.words import words_of
from tests.service.engines import on_both
from tests.service.jobs.support import pack
from tests.service.sources.support import Library, put
from tests.service.support import Running, small_file

pytestmark = on_both


def found(running: Running, words: str) -> list[str]:
    """The ids of the shapes that words find, the most relevant first."""
    return [shape["id"] for shape in running.client.get("/shapes", params={"q": words}).json()["shapes"]]


def check(running: Running, files: dict[str, dict[str, Any]]) -> None:
    """The index has the words of the shapes and of the paths of their files, and no others."""
    paths: dict[str, list[str]] = {}
    for path, file in files.items():
        paths.setdefault(file["shape_id"], []).append(path)
    shapes = running.client.get("/shapes").json()["shapes"]
    expected = {
        shape["id"]: words_of(shape["name"], shape["tags"], shape["metadata"], paths.get(shape["id"], []))
        for shape in shapes
    }
    indexed: dict[str, dict[str, int]] = {}
    with running.container.database.read() as session:
        rows = select(ShapeRow.id, WordRow.word, ShapeWordRow.weight).select_from(ShapeWordRow)
        rows = rows.join(ShapeRow, ShapeRow.number == ShapeWordRow.shape_number)
        for shape, word, weight in session.execute(
            rows.join(WordRow, WordRow.number == ShapeWordRow.word_number)
        ):
            indexed.setdefault(shape, {})[word] = weight
    assert indexed == expected
    assert running.rows(WordRow) == len({word for words in expected.values() for word in words})


def test_the_words_of_paths_follow_the_files(running: Running, root: Path) -> None:
    uploaded = running.store(small_file(5), name="bowl.off")["id"]
    put(root / "Brackets" / "left" / "a.off", small_file(1))
    put(root / "kit.zip", pack({"Winkel/b.off": small_file(2)}))
    put(root / "Violin" / "c.off", small_file(3))
    put(root / "Zebra" / "bowl.off", small_file(5))
    with Library.of(running, root) as library:
        check(running, library.files())
        shapes = library.shapes()
        a, b, c = (shapes[path] for path in ("Brackets/left/a.off", "kit.zip/Winkel/b.off", "Violin/c.off"))
        assert shapes["Zebra/bowl.off"] == uploaded
        assert found(running, "bracket left") == [a]
        assert found(running, "winkel kit") == [b]
        assert found(running, "zebra") == [uploaded]

        # Moved; a copy; one moved over another, whose file is gone; another spelling of a path.
        (root / "Brackets").rename(root / "Shelves")
        put(root / "Copies" / "of c.off", small_file(3))
        library.rescan()
        check(running, library.files())
        assert (found(running, "brackets"), found(running, "shelves")) == ([], [a])
        assert found(running, "copies") == found(running, "violin") == [c]
        (root / "Copies" / "of c.off").unlink()
        os.replace(root / "Shelves" / "left" / "a.off", root / "Violin" / "c.off")
        library.rescan()
        check(running, library.files())
        assert found(running, "violin") == [a]
        put(root / "kit.zip", pack({"Hinge/b.off": small_file(2)}))
        library.rescan()
        assert (found(running, "winkel"), found(running, "hinge")) == ([], [b])
        (root / "Zebra" / "bowl.off").unlink()
        library.rescan()
        # A missing file is shown by its path.
        assert found(running, "zebra") == [uploaded]
        check(running, library.files())
    forget_removed(running.container.database, timedelta(0))
    assert found(running, "zebra") == []
    for shape in running.client.get("/deleted").json()["shapes"]:
        running.client.delete(f"/deleted/{shape['id']}")
    check(running, {})


def test_words_of_names_come_before_those_of_tags_metadata_and_paths(running: Running, root: Path) -> None:
    put(root / "lamp" / "d.off", small_file(4))
    expected = [
        running.store(small_file(1), name="Lamp.off")["id"],
        running.store(small_file(2), name="b.off", tags="lamp")["id"],
        running.store(small_file(3), name="c.off", metadata='{"for": "lamp"}')["id"],
    ]
    with Library.of(running, root) as library:
        assert found(running, "lamp") == [*expected, library.shapes()["lamp/d.off"]]


def test_a_key_that_sees_no_paths_finds_nothing_by_them(
    running: Running, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its answers are those to words that no shape has."""
    put(root / "Secretary" / "anvil.off", small_file(1))
    put(root / "plain" / "anvil 2.off", small_file(2))
    with Library.of(running, root):
        client, keys = running.client, KeyRing([digest_of("full")], [digest_of("read")])
        with monkeypatch.context() as patch:
            patch.setattr(running.container.gate, "_keys", keys)

            def answers(key: str, words: str) -> list[Any]:
                headers = {"x-api-key": key}
                given = [
                    client.get(path, params={"q": words}, headers=headers).json()
                    for path in ("/shapes", "/facets", "/duplicates", "/families", "/map")
                ]
                shape = client.get("/shapes", headers=headers).json()["shapes"][0]["id"]
                sent = {"shape_id": shape, "exclude_self": False, "q": words}
                given.append(client.post("/query", json=sent, headers=headers).json())
                for answer in given:
                    answer.pop("milliseconds", None)
                return given

            nothing = answers("read", "nowhere")
            for words in ("secretary", "secret", "secretery", "secretaryanvil", "anvil secretary"):
                assert answers("read", words) == nothing
                assert answers("full", words) != nothing
            assert answers("read", "anvil") == answers("full", "anvil")
