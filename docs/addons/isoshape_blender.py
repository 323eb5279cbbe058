"""Find meshes like the active object in an Isoshape archive, and insert them: an add-on for Blender.

Install it under Edit, Preferences, Add-ons, and give the address of the service there. The panel is in the
sidebar (N) of the 3D view. Blender waits while the service searches.
"""

import json
import tempfile
import uuid
from collections.abc import Iterable
from http.client import HTTPException
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import quote
from urllib.request import HTTPRedirectHandler, Request, build_opener

import bpy

bl_info = {
    "name": "Isoshape",
    "description": "Find stored meshes like the active object, and insert them",
    "author": "Isoshape",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "View3D > Sidebar > Isoshape",
    "category": "Object",
}

SECONDS = 300.0
"""The longest wait for an answer."""

OWN_AXES = {"forward_axis": "Y", "up_axis": "Z"}
"""The axes of Blender: coordinates are read as they are written."""


class IsoshapePreferences(bpy.types.AddonPreferences):
    """The address of the service, and what it asks for."""

    bl_idname = __name__

    address: bpy.props.StringProperty(name="Address", default="http://127.0.0.1:8000")
    key: bpy.props.StringProperty(name="Key", subtype="PASSWORD")
    collection: bpy.props.StringProperty(name="Collection")

    def draw(self, context: bpy.types.Context) -> None:
        """Show the fields."""
        for name in ("address", "key", "collection"):
            self.layout.prop(self, name)


class IsoshapeResult(bpy.types.PropertyGroup):
    """A result of the latest search; `name` is that of the shape."""

    shape_id: bpy.props.StringProperty()
    likeness: bpy.props.StringProperty()
    probability: bpy.props.FloatProperty()


class ISOSHAPE_OT_find(bpy.types.Operator):  # noqa: N801
    """Find stored meshes like the active object."""

    bl_idname = "isoshape.find"
    bl_label = "Find similar"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object is a mesh."""
        return context.object is not None and context.object.type == "MESH"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Search with the object as its modifiers show it."""
        evaluated = context.object.evaluated_get(context.evaluated_depsgraph_get())
        mesh = evaluated.to_mesh()
        mesh.calc_loop_triangles()
        text = obj_text(
            (vertex.co for vertex in mesh.vertices), (each.vertices for each in mesh.loop_triangles)
        )
        evaluated.to_mesh_clear()
        fields = {"top_k": "10", "rank_by": "combined"}
        try:
            answer = answered(send(context, "/query", *form(fields, "selection.obj", text.encode())))
        except ServiceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        results = context.scene.isoshape_results
        results.clear()
        for found in answer["results"] + answer["parts"]:
            result = results.add()
            result.name, result.shape_id = found["shape"]["name"], found["shape"]["id"]
            result.likeness, result.probability = found["likeness"], found["combined"]
        self.report({"INFO"}, f"{len(results)} results of {answer['stored']} stored shapes")
        return {"FINISHED"}


class ISOSHAPE_OT_insert(bpy.types.Operator):  # noqa: N801
    """Insert a stored mesh into the scene."""

    bl_idname = "isoshape.insert"
    bl_label = "Insert"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    shape_id: bpy.props.StringProperty()
    shape_name: bpy.props.StringProperty(default="Isoshape")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read the mesh as an OBJ."""
        try:
            data = send(context, f"/shapes/{quote(self.shape_id, safe='')}/file?format=obj")
        except ServiceError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "isoshape.obj")
            path.write_bytes(data)
            bpy.ops.wm.obj_import(filepath=str(path), **OWN_AXES)
        context.object.name = self.shape_name
        return {"FINISHED"}


class ISOSHAPE_PT_results(bpy.types.Panel):  # noqa: N801
    """The button and the results."""

    bl_idname = "ISOSHAPE_PT_results"
    bl_label = "Isoshape"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Isoshape"

    def draw(self, context: bpy.types.Context) -> None:
        """Show a row for each result."""
        self.layout.operator(ISOSHAPE_OT_find.bl_idname)
        for result in context.scene.isoshape_results:
            row = self.layout.row()
            row.label(text=f"{result.name}: {result.likeness}, {result.probability:.2f}")
            insert = row.operator(ISOSHAPE_OT_insert.bl_idname, icon="IMPORT")
            insert.shape_id, insert.shape_name = result.shape_id, result.name


class ServiceError(Exception):
    """The service does not answer, or refuses; the message gives the reason."""


class NoRedirects(HTTPRedirectHandler):
    """Refuses redirects, which would carry the key to another server."""

    def http_error_302(self, _request: Any, answer: Any, code: int, _reason: str, headers: Any) -> None:  # noqa: ANN401
        """Raise HTTPError with the address that the server redirects to."""
        target = headers.get("Location", "nowhere")
        raise HTTPError("", code, f"the server redirects to {target}", headers, answer)

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302


def obj_text(points: Iterable[Iterable[float]], triangles: Iterable[Iterable[int]]) -> str:
    """Return a mesh as OBJ, with exact coordinates."""
    lines = ["v " + " ".join(repr(float(each)) for each in point) for point in points]
    lines += ["f " + " ".join(str(number + 1) for number in triangle) for triangle in triangles]
    return "\n".join([*lines, ""])


def form(fields: dict[str, str], name: str, data: bytes) -> tuple[bytes, str]:
    """Return a form with a file, as the bytes and the media type of a body."""
    boundary = uuid.uuid4().hex
    parts = [f'Content-Disposition: form-data; name="{key}"\r\n\r\n{text}' for key, text in fields.items()]
    parts.append(f'Content-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n')
    head = "".join(f"--{boundary}\r\n{part}\r\n" for part in parts).removesuffix("\r\n")
    return b"".join(
        [head.encode(), data, f"\r\n--{boundary}--\r\n".encode()]
    ), f"multipart/form-data; boundary={boundary}"


def send(context: bpy.types.Context, path: str, body: bytes | None = None, media_type: str = "") -> bytes:
    """Return the answer of the service that the preferences name.

    Raises
    ------
    ServiceError
        The service does not answer, or answers with a problem.
    """
    wanted = context.preferences.addons[__name__].preferences
    address = wanted.address.rstrip("/")
    if not address.startswith(("http://", "https://")):
        raise ServiceError("the address must begin with http:// or https://")
    headers = {"Content-Type": media_type} if body is not None else {}
    headers |= {"Authorization": f"Bearer {wanted.key}"} if wanted.key else {}
    headers |= {"Isoshape-Collection": wanted.collection} if wanted.collection else {}
    try:
        # An address or a key that cannot be sent is a ValueError.
        with build_opener(NoRedirects).open(Request(address + path, body, headers), None, SECONDS) as answer:
            return bytes(answer.read())
    except HTTPError as error:
        raise ServiceError(problem_of(error.read(), str(error))) from error
    except (OSError, HTTPException, ValueError) as error:
        raise ServiceError(f"{address} does not answer: {error}") from error


def answered(data: bytes) -> dict[str, Any]:
    """Return the answer to a query, or raise ServiceError if it is none: of another server, for example."""
    try:
        answer = json.loads(data)
        return {name: answer[name] for name in ("results", "parts", "stored")}
    except (ValueError, TypeError, KeyError) as error:
        raise ServiceError("the server at the address is not Isoshape") from error


def problem_of(document: bytes, otherwise: str) -> str:
    """Return what a problem document (RFC 9457) says."""
    try:
        problem = json.loads(document)
        return f"{problem['title']}: {problem['detail']}"
    except (ValueError, TypeError, KeyError):
        return otherwise


CLASSES = (IsoshapePreferences, IsoshapeResult, ISOSHAPE_OT_find, ISOSHAPE_OT_insert, ISOSHAPE_PT_results)


def register() -> None:
    """Add the panel, its operators and the results of a scene."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.isoshape_results = bpy.props.CollectionProperty(type=IsoshapeResult)


def unregister() -> None:
    """Take the panel, its operators and the results away."""
    del bpy.types.Scene.isoshape_results
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
