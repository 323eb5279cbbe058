"""Find shapes like the selection in an Isoshape archive, and insert them: a macro for FreeCAD.

Put the file into the folder of macros, and run it with an object selected. A shape stored as STEP is inserted
with its faces, any other as a mesh. FreeCAD waits while the service searches.
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

import FreeCAD

PREFERENCES = "User parameter:BaseApp/Preferences/Mod/Isoshape"

SECONDS = 300.0
"""The longest wait for an answer."""

DEVIATION = 1e-3
"""The distance of triangles from the surface, over the diagonal of the box."""

COLUMNS = ("name", "likeness", "probability")


class ServiceError(Exception):
    """The service does not answer, or refuses; the message gives the reason."""


class NoRedirects(HTTPRedirectHandler):
    """Refuses redirects, which would carry the key to another server."""

    def http_error_302(self, _request: Any, answer: Any, code: int, _reason: str, headers: Any) -> None:  # noqa: ANN401
        """Raise HTTPError with the address that the server redirects to."""
        target = headers.get("Location", "nowhere")
        raise HTTPError("", code, f"the server redirects to {target}", headers, answer)

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302


def find(selected: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    """Return the results of a search with an object that has a mesh or a shape."""
    if hasattr(selected, "Mesh"):
        points, triangles = selected.Mesh.Topology
    elif hasattr(selected, "Shape"):
        points, triangles = selected.Shape.tessellate(DEVIATION * selected.Shape.BoundBox.DiagonalLength)
    else:
        raise ServiceError(f"{selected.Label} has neither a mesh nor a shape")
    text = obj_text(points, triangles)
    fields = {"top_k": "10", "rank_by": "combined"}
    answer = answered(send("/query", *form(fields, "selection.obj", text.encode())))
    return list(answer["results"] + answer["parts"])


def insert(shape: dict[str, Any], document: Any) -> None:  # noqa: ANN401
    """Insert a stored shape into a document."""
    is_step = shape["format"] == "step"
    ending = "step" if is_step else "obj"
    path = f"/shapes/{quote(shape['id'], safe='')}/file"
    data = send(path if is_step else f"{path}?format=obj")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"isoshape.{ending}")
        file.write_bytes(data)
        if is_step:
            import Part  # noqa: PLC0415

            added = document.addObject("Part::Feature", "Isoshape")
            added.Shape = Part.read(str(file))
        else:
            import Mesh  # noqa: PLC0415

            added = document.addObject("Mesh::Feature", "Isoshape")
            added.Mesh = Mesh.Mesh(str(file))
    added.Label = shape["name"]
    document.recompute()


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
    body = b"".join([head.encode(), data, f"\r\n--{boundary}--\r\n".encode()])
    return body, f"multipart/form-data; boundary={boundary}"


def send(path: str, body: bytes | None = None, media_type: str = "") -> bytes:
    """Return the answer of the service that the preferences name.

    Raises
    ------
    ServiceError
        The service does not answer, or answers with a problem.
    """
    wanted = FreeCAD.ParamGet(PREFERENCES)
    address = wanted.GetString("Address", "http://127.0.0.1:8000").rstrip("/")
    key, collection = wanted.GetString("Key"), wanted.GetString("Collection")
    if not address.startswith(("http://", "https://")):
        raise ServiceError("the address must begin with http:// or https://")
    headers = {"Content-Type": media_type} if body is not None else {}
    headers |= {"Authorization": f"Bearer {key}"} if key else {}
    headers |= {"Isoshape-Collection": collection} if collection else {}
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


def show() -> None:
    """Ask for the service, search with the selection, and insert the results that are double-clicked."""
    import FreeCADGui  # noqa: PLC0415
    from PySide import QtGui  # noqa: PLC0415

    window = FreeCADGui.getMainWindow()
    wanted = FreeCAD.ParamGet(PREFERENCES)
    dialog = QtGui.QDialog(window)
    dialog.setWindowTitle("Isoshape")
    layout = QtGui.QFormLayout(dialog)
    for name in ("Address", "Key", "Collection"):
        field = QtGui.QLineEdit(wanted.GetString(name, "http://127.0.0.1:8000" if name == "Address" else ""))
        if name == "Key":
            field.setEchoMode(QtGui.QLineEdit.Password)
        field.textChanged.connect(lambda text, name=name: wanted.SetString(name, text))
        layout.addRow(name, field)
    button, table = QtGui.QPushButton("Find similar"), QtGui.QTableWidget(0, len(COLUMNS))
    table.setHorizontalHeaderLabels(COLUMNS)
    layout.addRow(button)
    layout.addRow(table)
    shapes: list[dict[str, Any]] = []

    def search() -> None:
        selection = FreeCADGui.Selection.getSelection()
        if len(selection) != 1:
            raise ServiceError("select one object")
        results = find(selection[0])
        shapes[:] = [result["shape"] for result in results]
        table.setRowCount(len(results))
        for row, result in enumerate(results):
            cells = result["shape"]["name"], result["likeness"], f"{result['combined']:.2f}"
            for column, text in enumerate(cells):
                table.setItem(row, column, QtGui.QTableWidgetItem(text))

    def told(work: Any, *arguments: Any) -> None:  # noqa: ANN401
        try:
            work(*arguments)
        except ServiceError as error:
            QtGui.QMessageBox.warning(dialog, "Isoshape", str(error))

    button.clicked.connect(lambda: told(search))
    table.cellDoubleClicked.connect(
        lambda row, _: told(insert, shapes[row], FreeCAD.ActiveDocument or FreeCAD.newDocument())
    )
    dialog.show()


if FreeCAD.GuiUp:
    show()
