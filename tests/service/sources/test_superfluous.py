"""Which of equal and merged files is kept, which others can go, and which are left in any case."""

import os
from pathlib import Path
from typing import Any

import pytest

from service.auth.keys import KeyRing, digest_of
from service.sources import superfluous
from tests.service.engines import on_both
from tests.service.jobs.support import pack
from tests.service.sources.support import Library, put
from tests.service.support import Running, assert_problem, small_file, wait_until

pytestmark = on_both

PATHS = "the library has this file by another path too"
ZIP = "it is in a zip"

ONE = small_file(1)
VARIANT, OTHER = ONE + b"\n", ONE + b"\n\n"


def groups(running: Running, **params: Any) -> list[dict[str, tuple[str, str | None]]]:
    """The role of each file, and the reason why it is left, by its path; group by group."""
    answer = running.client.get("/equal-files", params={"limit": 500, **params})
    assert answer.status_code == 200, answer.text
    page = answer.json()
    assert page["total"] == len(page["groups"]) or "limit" in params
    return [
        {file["path"]: (file["role"], file["left"]) for file in group["files"]} for group in page["groups"]
    ]


def merge(running: Running, kept: str, *others: str) -> str:
    """Merge shapes; the id of the merge."""
    body = {"shapes": [kept, *others], "keep": kept}
    answer = running.client.post("/duplicates/merge", json=body)
    assert answer.status_code == 200, answer.text
    return str(answer.json()["id"])


def test_the_first_path_is_kept_and_a_second_path_of_one_file_is_no_copy(
    running: Running, root: Path, tmp_path: Path
) -> None:
    """Hard links, links, folders in folders and zips are left; a lost file is neither kept nor removed."""
    put(root / "a.off", ONE)
    put(root / "copy.off", ONE)
    put(root / "inner" / "twice.off", ONE)
    os.link(root / "a.off", root / "hard.off")
    put(root / "lone.off", small_file(2))
    (root / "link to lone.off").symlink_to("lone.off")
    put(root / "0.zip", pack({"member.off": ONE}))
    put(root / "single.off", small_file(3))
    second = put(tmp_path / "second" / "a.off", ONE)
    put(tmp_path / "second" / "own.off", small_file(4))
    with (
        Library.of(running, root) as library,
        Library.of(running, tmp_path / "second") as elsewhere,
        Library.of(running, root / "inner"),
    ):
        at = library.root
        equal = {
            f"{at}/a.off": ("kept", None),
            f"{at}/0.zip/member.off": ("equal", ZIP),
            f"{at}/copy.off": ("equal", None),
            f"{at}/hard.off": ("equal", PATHS),
            f"{at}/inner/twice.off": ("equal", PATHS),
            f"{second}": ("equal", None),
        }
        linked = {f"{at}/link to lone.off": ("kept", None), f"{at}/lone.off": ("equal", PATHS)}
        assert sorted(groups(running), key=len) == [linked, equal]
        first = running.client.get("/equal-files", params={"limit": 1}).json()
        rest = {"limit": 1, "cursor": first["next_cursor"]}
        assert len(groups(running, limit=1)) == len(groups(running, **rest)) == 1
        assert groups(running, limit=1) + groups(running, **rest) == groups(running)

        # The owner removes what can go: nothing is missing, and the shape keeps its other paths.
        shape = library.shapes()["a.off"]
        (root / "copy.off").unlink()
        second.unlink()
        assert library.rescan()["counts"]["missing"] == elsewhere.rescan()["counts"]["missing"] == 0
        assert library.shapes()["a.off"] == shape
        assert all(left for group in groups(running) for role, left in group.values() if role != "kept")

        # A path that is gone is not kept.
        put(second, ONE)
        elsewhere.rescan()
        (root / "a.off").unlink()
        library.rescan()
        (equal,) = (group for group in groups(running) if f"{second}" in group)
        assert [path for path, (role, _) in equal.items() if role == "kept"] == [f"{at}/hard.off"]
        # Nor is any file of a source that is offline.
        root.rename(tmp_path / "away")
        assert library.rescan()["state"] == "offline"
        assert not any(f"{at}/hard.off" in group for group in groups(running))
        (tmp_path / "away").rename(root)


def test_a_file_that_another_collection_has_too_is_left(running: Running, root: Path) -> None:
    put(root / "a.off", ONE)
    put(root / "inner" / "b.off", ONE)
    assert running.client.put("/collections/other").status_code in {200, 201}
    with Library.of(running, root) as library:
        can_go = {f"{library.root}/a.off": ("kept", None), f"{library.root}/inner/b.off": ("equal", None)}
        assert groups(running) == [can_go]
        headers = {"isoshape-collection": "other"}
        body = {"path": str(root / "inner"), "name": "inner"}
        source = running.client.post("/sources", json=body, headers=headers).json()["id"]

        def is_ready() -> bool:
            answer = running.client.get(f"/sources/{source}", headers=headers)
            return bool(answer.json()["state"] == "ready")

        wait_until(is_ready, seconds=60)
        assert groups(running) == [can_go | {f"{library.root}/inner/b.off": ("equal", PATHS)}]
        assert running.client.get("/equal-files", headers=headers).json()["groups"] == []
        assert running.client.delete(f"/sources/{source}", headers=headers).status_code == 204


def test_merged_shapes_are_kept_by_the_last_one_while_their_merges_hold(running: Running, root: Path) -> None:
    client = running.client
    for path, data in {"s": VARIANT, "s2": VARIANT, "k": ONE, "t": OTHER, "x": small_file(2)}.items():
        put(root / f"{path}.off", data)
    with Library.of(running, root) as library:
        ids = {path.removesuffix(".off"): shape for path, shape in library.shapes().items()}
        at = {path: f"{library.root}/{path}.off" for path in ids}
        variants = {at["s"]: ("kept", None), at["s2"]: ("equal", None)}
        of_k = {at["k"]: ("kept", None), at["s"]: ("merged", None), at["s2"]: ("merged", None)}
        of_t = {**of_k, at["k"]: ("merged", None), at["t"]: ("kept", None)}
        assert groups(running) == groups(running, merged=True) == [variants]
        merge(running, ids["k"], ids["s"])
        assert (groups(running), groups(running, merged=True)) == ([variants], [of_k])
        later = merge(running, ids["t"], ids["k"])
        assert (groups(running), groups(running, merged=True)) == ([variants], [of_t])
        assert client.post(f"/duplicates/merges/{later}/undo").status_code == 200
        assert groups(running, merged=True) == [of_k]

        # A shape whose only file is gone keeps nothing.
        (root / "k.off").rename(root.parent / "k.off")
        assert library.rescan()["counts"]["missing"] == 1
        assert groups(running, merged=True) == [variants]
        (root.parent / "k.off").rename(root / "k.off")
        library.rescan()
        assert groups(running, merged=True) == [of_k]

        # Nobody has compared a file that came later.
        put(root / "k.off", small_file(5))
        assert library.rescan()["scan"]["changed"] == 1
        assert groups(running, merged=True) == [variants]

        # Restored, and deleted by hand: no merge counts.
        merge(running, ids["t"], ids["x"])
        of_x = {at["t"]: ("kept", None), at["x"]: ("merged", None)}
        assert of_x in groups(running, merged=True)
        assert client.post(f"/shapes/{ids['x']}/restore").status_code == 200
        assert groups(running, merged=True) == [variants]
        assert client.delete(f"/shapes/{ids['x']}").status_code == 204
        assert groups(running, merged=True) == [variants]
        # An erased shape is not known any more.
        assert client.post(f"/shapes/{ids['x']}/restore").status_code == 200
        merge(running, ids["t"], ids["x"])
        assert of_x in groups(running, merged=True)
        assert client.delete(f"/deleted/{ids['x']}").status_code == 204
        assert groups(running, merged=True) == [variants]


def test_a_merged_file_that_its_owner_removes_leaves_the_other_shape_its_file(
    running: Running, root: Path
) -> None:
    # No folder of another test has these bytes.
    for path, data in {"s": small_file(7) + b"\n", "k": small_file(7), "x": small_file(2)}.items():
        put(root / f"{path}.off", data)
    with Library.of(running, root) as library:
        ids = library.shapes()
        act = merge(running, ids["k.off"], ids["s.off"])
        (root / "s.off").rename(root.parent / "s.off")
        assert library.rescan()["state"] == "ready"
        states = {path: (file["state"], file["shape_id"]) for path, file in library.files().items()}
        assert states["k.off"] == ("present", ids["k.off"])
        assert states["s.off"] == ("missing", None)
        assert groups(running, merged=True) == []

        # The merge cannot be undone until the file is back.
        undo = f"/duplicates/merges/{act}/undo"
        assert_problem(running.client.post(undo), 409, "file-in-place")
        (root.parent / "s.off").rename(root / "s.off")
        assert library.rescan()["counts"]["missing"] == 0
        assert running.client.post(undo).status_code == 200
        assert library.shapes() == ids


def test_a_key_without_paths_gets_no_list(running: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(running.container.gate, "_keys", KeyRing([digest_of("full")], [digest_of("read")]))
        refused = running.client.get("/equal-files", headers={"x-api-key": "read"})
        assert "see no paths" in assert_problem(refused, 403, "forbidden")["detail"]
        assert running.client.get("/equal-files", headers={"x-api-key": "full"}).status_code == 200


def test_a_page_ends_with_the_group_that_reaches_its_number_of_files(
    running: Running, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cursors of such pages lead to every group once."""
    for number, data in enumerate((small_file(71), small_file(72), small_file(73), small_file(74))):
        for copy in range(2):
            put(root / f"{number}-{copy}.off", data)
    with Library.of(running, root):
        whole = groups(running)
        monkeypatch.setattr(superfluous, "FILES_OF_A_PAGE", 3)
        pages, cursor = [], None
        while cursor or not pages:
            params = {"limit": 500, **({"cursor": cursor} if cursor else {})}
            answer = running.client.get("/equal-files", params=params).json()
            pages.append([[file["path"] for file in group["files"]] for group in answer["groups"]])
            cursor = answer["next_cursor"]
    assert [len(page) for page in pages] == [2, 2]
    assert [group for page in pages for group in page] == [list(group) for group in whole]
