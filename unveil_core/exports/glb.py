"""Binary glTF 2.0: arrays and images in one buffer, and the container around it."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.drive import Drive
from unveil_core.exports.coordinates import y_up

__all__ = ["FLOAT", "INDEX_DATA", "UINT", "USHORT", "GlbBuffer", "glb_bytes", "street_node"]

FLOAT, USHORT, UINT = 5126, 5123, 5125
VERTEX_DATA, INDEX_DATA = 34962, 34963


@dataclass
class GlbBuffer:
    """What a GLB's buffer holds, and how the document tells it."""

    parts: list[bytes] = field(default_factory=list)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    size: int = 0

    def add(self, values: NDArray[np.generic], component: int, target: int = VERTEX_DATA, **more: object) -> int:
        """The accessor of an array (N,) or (N, C) of 4 bytes a row at least."""
        view = self.add_bytes(np.ascontiguousarray(values).tobytes(), target=target)
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        entry = {
            "bufferView": view,
            "componentType": component,
            "count": len(values),
            "type": kind,
            **more,
        }
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def add_bytes(self, content: bytes, **more: object) -> int:
        """The view of some bytes, as of an image."""
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(content), **more})
        padded = content + bytes(-len(content) % 4)
        self.parts.append(padded)
        self.size += len(padded)
        return len(self.views) - 1


def glb_bytes(document: dict[str, Any], binary: bytes) -> bytes:
    """A GLB of one JSON chunk and, where there is any, one binary chunk."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def street_node(drive: Drive, name: str) -> dict[str, Any]:
    """The node of mesh 0, whose vertices are metres around the local origin, y up: it brings them to the drive's place."""
    frame = y_up(drive)
    node: dict[str, Any] = {
        "name": name,
        "mesh": 0,
        "translation": frame.from_local.translation.tolist(),
        "extras": {"to_world": drive.to_world.to_json(), "coordinates": frame.to_json(shifted=False)},
    }
    if frame.from_local.scale != 1:
        node["scale"] = [frame.from_local.scale] * 3
    return node
