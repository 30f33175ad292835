"""Meshes on disk: binary PLY and OBJ at world coordinates, GLB for everything that opens glTF.

PLY: vertices in the world, which are the coordinates of the drive's files, as doubles where single precision would lose a tenth
of a millimetre, sRGB vertex colours.

OBJ: the same as text with six decimals, colours behind the positions. The local origin stands in a comment: programs that read
OBJ in single precision see far coordinates rounded to centimetres and more, and are better served by the GLB.

GLB: glTF 2.0 is y-up and single precision: vertices stay local and are turned so that up becomes +y. The turned world position
of the local origin is the translation of the node, which JSON carries in full precision, and the world's units per metre are its
scale; the whole similarity stands in the node's ``extras``. Vertex colours are linear 16-bit as the format asks
(``COLOR_0`` is a linear multiplier), under an unlit material: photographs already carry the light of their street.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import LARGEST_FILE, read_bytes
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_atomic, write_bytes_atomic
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.geometry.similarity import Similarity
from unveil_core.mesh.mesh import Mesh

__all__ = ["read_ply", "write_glb", "write_obj", "write_ply"]

T = TypeVar("T", bound=np.generic)

SINGLE_PRECISION_REACH = 1024.0
"""Largest coordinate for which a float is finer than 0.1 mm."""
LARGEST_MESH = 4 * LARGEST_FILE
"""Bytes: 200 million triangles."""
AT_ONCE = 1 << 17
"""Vertices or triangles that are written at once: a few megabytes."""
Z_TO_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From z up to glTF's y up, the usual (x, z, -y)."""


def write_ply(mesh: Mesh, path: Path, to_world: Similarity | None = None) -> None:
    """Write a binary little-endian PLY, atomically.

    Args:
        mesh: local vertices.
        path: where.
        to_world: from local coordinates to those of the file.
    """
    to_world = to_world or Similarity()
    double = any(np.abs(to_world.to_world(some)).max() > SINGLE_PRECISION_REACH for some in _pieces(mesh.vertices))
    name, code = ("double", "<f8") if double else ("float", "<f4")
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment unveil mesh, sRGB vertex colours",
        *(f"comment {line}" for line in to_world.comments()),
        f"element vertex {len(mesh.vertices)}",
        *(f"property {name} {axis}" for axis in ("x", "y", "z")),
        *(f"property uchar {c}" for c in ("red", "green", "blue")),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]

    def write(stream: BinaryIO) -> None:
        stream.write("\n".join(lines).encode())
        for vertices, colors in zip(_pieces(mesh.vertices), _pieces(mesh.colors), strict=True):
            rows = np.empty(len(vertices), dtype=[("position", code, 3), ("color", "u1", 3)])
            rows["position"], rows["color"] = to_world.to_world(vertices), colors
            stream.write(rows.tobytes())
        for faces in _pieces(mesh.faces):
            triangles = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
            triangles["count"], triangles["index"] = 3, faces
            stream.write(triangles.tobytes())

    write_atomic(path, write)


def read_ply(path: Path, to_world: Similarity | None = None) -> Mesh:
    """Read a mesh that :func:`write_ply` wrote, in local coordinates, by the ``to_world`` that it was written with.

    Raises:
        WorkspaceError: the file is missing, cut short, or not one of ours.
    """
    try:
        content = read_bytes(path, LARGEST_MESH, links=False)
    except OSError as error:
        raise WorkspaceError(f"cannot be read: {error.strerror}", path=path, mend="run `unveil mesh`") from error
    try:
        end = content.index(b"end_header\n") + len(b"end_header\n")
        header = content[:end].decode("ascii").split("\n")
        vertex_count, face_count = (_count(header, name) for name in ("vertex", "face"))
        code = "<f8" if "property double x" in header else "<f4"
        rows = np.frombuffer(content, [("position", code, 3), ("color", "u1", 3)], vertex_count, end)
        end += rows.nbytes
        triangles = np.frombuffer(content, [("count", "u1"), ("index", "<i4", 3)], face_count, end)
        if (triangles["count"] != 3).any() or end + triangles.nbytes != len(content):
            raise ValueError("it holds more than triangles")
        if not np.isfinite(rows["position"]).all():
            raise ValueError("a vertex is not finite")
        index = triangles["index"]
        if len(index) and not 0 <= index.min() <= index.max() < len(rows):
            raise ValueError("a triangle names a missing vertex")
    except (ValueError, LookupError) as error:
        raise WorkspaceError(
            f"Not a mesh that Unveil wrote: {error}", path=path, mend="run `unveil mesh` again"
        ) from error
    local = (to_world or Similarity()).to_local(rows["position"]).astype(np.float32)
    return Mesh(local, triangles["index"].copy(), rows["color"].copy())


def _count(header: list[str], name: str) -> int:
    """Rows of an element as a header tells them."""
    lines = [line.split() for line in header if line.startswith(f"element {name} ")]
    if len(lines) != 1 or len(lines[0]) != 3 or not re.fullmatch("[0-9]{1,12}", lines[0][2]):
        raise ValueError(f"it does not tell how many rows of {name} it has")
    return int(lines[0][2])


def write_obj(mesh: Mesh, path: Path, to_world: Similarity | None = None) -> None:
    """Write a Wavefront OBJ with vertex colours (``v x y z r g b``, sRGB in [0, 1]), atomically.

    Args:
        mesh: local vertices, at least one triangle.
        path: where.
        to_world: from local coordinates to those of the file.
    """
    import trimesh  # takes a second, which only this pays

    to_world = to_world or Similarity()
    world = trimesh.Trimesh(to_world.to_world(mesh.vertices), mesh.faces, vertex_colors=mesh.colors, process=False)
    header = "unveil mesh, sRGB vertex colours, " + ", ".join(to_world.comments())
    text = trimesh.exchange.obj.export_obj(  # type: ignore[no-untyped-call]
        world, include_normals=False, digits=6, header=header
    )
    write_bytes_atomic(path, text.encode() + b"\n")


def write_glb(mesh: Mesh, path: Path, to_world: Similarity | None = None, name: str = "street") -> None:
    """Write a binary glTF 2.0 file, atomically.

    Args:
        mesh: local vertices.
        path: where.
        to_world: from local coordinates to the drive's own; becomes the node's transform.
        name: name of the node.
    """
    to_world = to_world or Similarity()
    count = len(mesh.vertices)
    linear = np.round(linear_of_srgb(np.arange(256) / 255.0) * 65535).astype(np.uint16)

    def turned() -> Iterator[NDArray[np.float32]]:
        return (some @ Z_TO_Y.T.astype(np.float32) for some in _pieces(mesh.vertices))

    def parts() -> Iterator[bytes]:
        for vertices in turned():
            yield np.ascontiguousarray(vertices, dtype="<f4").tobytes()
        for some in _pieces(mesh.colors):
            colors = np.full((len(some), 4), 65535, dtype="<u2")
            colors[:, :3] = linear[some]
            yield colors.tobytes()
        for faces in _pieces(mesh.faces):
            yield faces.astype("<u4").tobytes()

    document: dict[str, object] = {
        "asset": {"version": "2.0", "generator": "unveil"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {
                "name": name,
                "translation": (Z_TO_Y @ to_world.directions_to_local(to_world.translation)).tolist(),
                **({} if to_world.scale == 1 else {"scale": [to_world.scale] * 3}),
                "extras": {"to_world": to_world.to_json()},
            }
        ],
        "materials": [
            {
                "name": f"{name} colours",
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
                "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0, "roughnessFactor": 1},
            }
        ],
    }
    binary = 0
    if len(mesh.faces):
        sizes = [12 * count, 8 * count, 4 * mesh.faces.size]
        binary = sum(sizes)
        document["nodes"][0]["mesh"] = 0  # type: ignore[index]
        document["meshes"] = [
            {
                "name": name,
                "primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0, "mode": 4}],
            }
        ]
        document["accessors"] = [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": count,
                "type": "VEC3",
                "min": np.min([some.min(axis=0) for some in turned()], axis=0).tolist(),
                "max": np.max([some.max(axis=0) for some in turned()], axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5123, "count": count, "type": "VEC4", "normalized": True},
            {"bufferView": 2, "componentType": 5125, "count": mesh.faces.size, "type": "SCALAR"},
        ]
        document["bufferViews"] = [
            {"buffer": 0, "byteOffset": sum(sizes[:k]), "byteLength": sizes[k], "target": target}
            for k, target in enumerate((34962, 34962, 34963))
        ]
        document["buffers"] = [{"byteLength": binary}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)

    def write(stream: BinaryIO) -> None:
        chunk = 8 + binary if binary else 0
        stream.write(struct.pack("<III", 0x46546C67, 2, 12 + 8 + len(text) + chunk))
        stream.write(struct.pack("<II", len(text), 0x4E4F534A) + text)
        if binary:
            stream.write(struct.pack("<II", binary, 0x004E4942))
            for part in parts():
                stream.write(part)

    write_atomic(path, write)


def _pieces(rows: NDArray[T]) -> Iterator[NDArray[T]]:
    """The rows of a table, some at a time: what is made of all of them at once would take several times the mesh."""
    return (rows[first : first + AT_ONCE] for first in range(0, len(rows), AT_ONCE))
