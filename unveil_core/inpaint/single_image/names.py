"""How single-image inpainters are named; importing this loads none of them."""

from __future__ import annotations

from pathlib import Path

__all__ = ["INPAINTERS", "is_file"]

INPAINTERS = ("exemplar", "telea", "navier-stokes", "shift-map", "fsr")
"""The built-in ones; a network in an ONNX file is the other kind."""


def is_file(name: str) -> bool:
    """Whether an inpainter is named by a file, not built in."""
    return Path(name).suffix.lower() == ".onnx"
