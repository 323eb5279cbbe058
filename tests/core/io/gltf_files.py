"""A glTF made accessor by accessor, as a GLB or as a JSON that holds its buffer."""

import base64
import json

import numpy as np

from tests.core.io.files import CUBE, TRIANGLES, glb_bytes

_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_CODES = {"<i1": 5120, "<u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}


class Gltf:
    """A glTF of one buffer, added to accessor by accessor."""

    def __init__(self):
        self.binary = b""
        self.tree = {
            "asset": {"version": "2.0"},
            "accessors": [],
            "bufferViews": [],
            "meshes": [],
            "nodes": [],
        }

    def view(self, array, **more):
        self.binary += bytes(-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": array.nbytes, **more}
        self.tree["bufferViews"].append(view)
        self.binary += array.tobytes()
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, rows, dtype="<f4", **more):
        """The number of an accessor with the rows as they are."""
        array = np.atleast_2d(np.asarray(rows, dtype=dtype))
        about = {"componentType": _CODES[dtype], "type": _KINDS[array.shape[1]], "count": len(array)}
        if dtype == "<f4" and array.shape[1] == 3:
            about |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if "bufferView" not in more:
            about["bufferView"] = self.view(array)
        self.tree["accessors"].append({**about, **more})
        return len(self.tree["accessors"]) - 1

    def indices(self, corners, dtype="<u4"):
        return self.accessor(np.reshape(corners, (-1, 1)), dtype)

    def mesh(self, vertices=CUBE, faces=TRIANGLES, **more):
        attributes = {"POSITION": self.accessor(vertices), **more.pop("attributes", {})}
        dtype = "<u2" if len(vertices) < 65_535 else "<u4"
        primitive = {
            "attributes": attributes,
            "indices": self.indices(faces, dtype),
            **more.pop("primitive", {}),
        }
        return self.mesh_of([primitive], **more)

    def mesh_of(self, primitives, **more):
        self.tree["meshes"].append({"primitives": primitives, **more})
        return len(self.tree["meshes"]) - 1

    def node(self, **entry):
        self.tree["nodes"].append(entry)
        return len(self.tree["nodes"]) - 1

    def bound(self, joints, weights, count=8):
        """The attributes of a skin, for every vertex."""
        return {
            "JOINTS_0": self.accessor(np.tile(joints, (count, 1)), "<u1"),
            "WEIGHTS_0": self.accessor(np.tile(weights, (count, 1))),
        }

    def data(self):
        return glb_bytes({**self.tree, "buffers": [{"byteLength": len(self.binary)}]}, self.binary)

    def embedded(self):
        """The JSON with its buffer as a URI of data."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        return json.dumps({**self.tree, "buffers": [{"byteLength": len(self.binary), "uri": uri}]}).encode()
