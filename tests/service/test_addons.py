"""The add-ons for Blender and FreeCAD, on a stub of either program and a real service.

Both programs are too large to install for a test; the stubs have what the add-ons call, and no more.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from core.io import read_mesh
from core.mesh.mesh import Mesh
from tests.service.support import Running, small_file

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "addons"


def loaded(name: str) -> Any:
    spec = spec_from_file_location(name, FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Results(list[Any]):
    """A collection of properties, as a scene of Blender has it."""

    def add(self) -> Any:
        self.append(SimpleNamespace())
        return self[-1]


@contextmanager
def redirecting(code: int, target: str) -> Iterator[tuple[str, list[str]]]:
    """A server that redirects every request to a path; its address, and the paths that it was asked for."""
    asked: list[str] = []

    class Redirecting(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            self.send_response(code)
            self.send_header("Location", target)
            self.end_headers()

        do_POST = do_GET  # noqa: N815

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Redirecting) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()
            thread.join()


def assert_not_redirected(ask: Callable[[str], str]) -> None:
    """Assert that an add-on follows no redirect, and says to where; `ask` returns what it says."""
    for code in (301, 302, 303, 307, 308):
        with redirecting(code, "http://elsewhere.example/") as (address, asked):
            assert ask(address) == f"HTTP Error {code}: the server redirects to http://elsewhere.example/"
            assert asked == ["/query"]


def assert_equal_meshes(data: bytes, mesh: Mesh) -> None:
    read = read_mesh(data, "obj")
    assert np.array_equal(read.vertices, mesh.vertices)
    assert np.array_equal(read.faces, mesh.faces)


def test_the_blender_addon_finds_what_is_like_the_object_and_inserts_it(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    ids = [service.store(small_file(number), name=f"{number}.off")["id"] for number in range(2)]
    mesh = read_mesh(small_file(1), "off")
    imported: list[bytes] = []
    registered: list[Any] = []

    def obj_import(filepath: str, **axes: str) -> None:
        # Blender's own axes: coordinates stay as they are.
        assert axes == {"forward_axis": "Y", "up_axis": "Z"}
        imported.append(Path(filepath).read_bytes())

    bpy: Any = ModuleType("bpy")
    kinds = ("AddonPreferences", "PropertyGroup", "Operator", "Panel", "Context", "Scene")
    bpy.types = SimpleNamespace(**{kind: type(kind, (), {}) for kind in kinds})
    names = ("StringProperty", "FloatProperty", "CollectionProperty")
    bpy.props = SimpleNamespace(**{name: lambda **about: about for name in names})
    bpy.utils = SimpleNamespace(register_class=registered.append, unregister_class=registered.remove)
    bpy.ops = SimpleNamespace(wm=SimpleNamespace(obj_import=obj_import))
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    addon = loaded("isoshape_blender")
    addon.register()
    assert registered
    assert bpy.types.Scene.isoshape_results == {"type": addon.IsoshapeResult}

    shown = SimpleNamespace(
        vertices=[SimpleNamespace(co=tuple(point)) for point in mesh.vertices],
        loop_triangles=[SimpleNamespace(vertices=tuple(face)) for face in mesh.faces],
        calc_loop_triangles=lambda: None,
    )
    evaluated = SimpleNamespace(to_mesh=lambda: shown, to_mesh_clear=lambda: None)
    wanted = SimpleNamespace(address=f"{service.client.base_url}/", key="", collection="")
    context: Any = SimpleNamespace(
        object=SimpleNamespace(type="MESH", name="", evaluated_get=lambda _: evaluated),
        evaluated_depsgraph_get=lambda: None,
        scene=SimpleNamespace(isoshape_results=Results()),
        preferences=SimpleNamespace(addons={"isoshape_blender": SimpleNamespace(preferences=wanted)}),
    )
    reports: list[tuple[set[str], str]] = []
    find, insert = addon.ISOSHAPE_OT_find(), addon.ISOSHAPE_OT_insert()
    find.report = insert.report = lambda kind, text: reports.append((kind, text))
    assert find.poll(context)
    assert find.execute(context) == {"FINISHED"}
    first = context.scene.isoshape_results[0]
    assert (first.name, first.shape_id, first.likeness) == ("1.off", ids[1], "same")
    insert.shape_id, insert.shape_name = first.shape_id, first.name
    assert insert.execute(context) == {"FINISHED"}
    assert context.object.name == "1.off"
    assert_equal_meshes(imported[0], mesh)

    insert.shape_id = "none"
    wanted.address = wanted.address.removesuffix("/")
    assert insert.execute(context) == {"CANCELLED"}
    assert reports[-1][0] == {"ERROR"}
    assert "no such shape" in reports[-1][1]
    wanted.key = "€"
    assert find.execute(context) == {"CANCELLED"}
    wanted.key = ""
    for address in ("file:///etc", "http://[", "http://127.0.0.1:port"):
        wanted.address = address
        assert find.execute(context) == {"CANCELLED"}

    def said(address: str) -> str:
        wanted.address, wanted.key = address, "secret"
        assert find.execute(context) == {"CANCELLED"}
        return reports[-1][1]

    assert_not_redirected(said)
    for data in (b"<html>", b"[]", b"{}"):
        with pytest.raises(addon.ServiceError, match="not Isoshape"):
            addon.answered(data)
    addon.unregister()
    assert registered == []


def test_the_freecad_macro_finds_what_is_like_the_selection_and_inserts_it(
    service: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(2):
        service.store(small_file(number), name=f"{number}.off")
    mesh = read_mesh(small_file(1), "off")
    wanted = {"Address": str(service.client.base_url)}
    freecad: Any = ModuleType("FreeCAD")
    freecad.GuiUp = False
    freecad.ParamGet = lambda _: SimpleNamespace(GetString=lambda name, other="": wanted.get(name, other))
    meshes: Any = ModuleType("Mesh")
    meshes.Mesh = lambda path: Path(path).read_bytes()
    parts: Any = ModuleType("Part")
    parts.read = lambda path: (Path(path).suffix, Path(path).read_bytes())
    for module in (freecad, meshes, parts):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    macro = loaded("isoshape_freecad")

    topology = mesh.vertices.tolist(), mesh.faces.tolist()
    objects = [
        SimpleNamespace(Mesh=SimpleNamespace(Topology=topology)),
        SimpleNamespace(
            Shape=SimpleNamespace(tessellate=lambda _: topology, BoundBox=SimpleNamespace(DiagonalLength=1.0))
        ),
    ]
    for each in objects:
        first = macro.find(each)[0]
        assert (first["shape"]["name"], first["likeness"]) == ("1.off", "same")
    added = Results()
    document = SimpleNamespace(addObject=lambda *_: added.add(), recompute=lambda: None)
    macro.insert(first["shape"], document)
    assert added[0].Label == "1.off"
    assert_equal_meshes(added[0].Mesh, mesh)
    # A STEP keeps its faces: its own bytes are read.
    macro.insert({**first["shape"], "format": "step"}, document)
    assert added[1].Shape == (".step", small_file(1))

    with pytest.raises(macro.ServiceError, match="neither"):
        macro.find(SimpleNamespace(Label="light"))
    wanted["Collection"] = "none"
    with pytest.raises(macro.ServiceError, match="none"):
        macro.find(objects[0])
    for address in ("http://127.0.0.1:1", "http://[", "http://127.0.0.1:port"):
        wanted["Address"] = address
        with pytest.raises(macro.ServiceError, match="does not answer"):
            macro.find(objects[0])

    def said(address: str) -> str:
        wanted.update(Address=address, Collection="", Key="secret")
        with pytest.raises(macro.ServiceError) as caught:
            macro.find(objects[0])
        return str(caught.value)

    assert_not_redirected(said)
    for data in (b"<html>", b"[]", b"{}"):
        with pytest.raises(macro.ServiceError, match="not Isoshape"):
            macro.answered(data)
