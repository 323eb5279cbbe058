"""Duplicates in a source: a person who may see paths is told which files they are."""

import csv
import io
from pathlib import Path

import pytest

from core.io import read_mesh, write_mesh
from core.mesh.mesh import Mesh
from service.auth.keys import KeyRing, digest_of
from tests.service.engines import on_both
from tests.service.sources.support import Library, put
from tests.service.support import Running, small_file

pytestmark = on_both


def test_files_of_duplicates_are_told_to_keys_that_see_paths(
    running: Running, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = read_mesh(small_file(1), "off")
    turned = write_mesh(Mesh(mesh.vertices[:, [1, 2, 0]] + 1.0, mesh.faces), "off")
    put(root / "a" / "one.off", small_file(1))
    put(root / "b" / "equal.off", small_file(1))
    gone = put(root / "c" / "gone.off", small_file(1))
    put(root / "d" / "turned.off", turned)
    with Library.of(running, root) as library, monkeypatch.context() as patch:
        gone.unlink()
        library.rescan()
        running.store(turned.replace(b"OFF\n", b"OFF\n\n", 1), "uploaded.off")
        patch.setattr(running.container.gate, "_keys", KeyRing([digest_of("full")], [digest_of("read")]))

        def paths(key: str, **params: str) -> dict[str, list[str]]:
            answer = running.client.get("/duplicates", params=params, headers={"x-api-key": key})
            if "format" in params:
                rows = csv.DictReader(io.StringIO(answer.text, newline=""))
                return {row["name"]: row["paths"].splitlines() for row in rows}
            return {one["shape"]["name"]: one["paths"] for group in answer.json()["groups"] for one in group}

        files = {
            "one.off": [f"{library.root}/a/one.off", f"{library.root}/b/equal.off"],
            "turned.off": [f"{library.root}/d/turned.off"],
            "uploaded.off": [],
        }
        assert paths("full") == paths("full", format="csv") == files
        assert paths("read") == paths("read", format="csv") == {name: [] for name in files}
