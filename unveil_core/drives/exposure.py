"""Exposure and white balance of each photograph: conversion between its colours and the scene's canonical ones.

A camera with automatic exposure and white balance shows one wall in many colours. The scene has one *canonical* colour for
it; each photograph is an affine function of that, per channel of sRGB: ``photograph = gain * canonical + bias``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import read_own_json, write_json_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.drive import Frame

__all__ = [
    "IDENTITY",
    "Exposure",
    "Exposures",
    "exposures_json",
    "exposures_of_json",
    "read_exposures",
    "write_exposures",
]

LEVELS = np.arange(256)[:, None] / 255.0


def _mapped(image: NDArray[np.uint8], table: NDArray[np.float64]) -> NDArray[np.uint8]:
    """An image (H, W, 3) through a table (256, 3) of values in [0, 1]."""
    levels = np.clip(np.round(table * 255), 0, 255).astype(np.uint8)
    return np.stack([levels[image[..., c], c] for c in range(3)], axis=-1)


@dataclass(frozen=True, eq=False)
class Exposure:
    """One photograph's exposure and white balance.

    Attributes:
        gain: (3,) > 0; bias: (3,), of sRGB values in [0, 1].
    """

    gain: NDArray[np.float64] = field(default_factory=lambda: np.ones(3))
    bias: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    @property
    def is_identity(self) -> bool:
        """True where photograph and canonical colours are the same."""
        return bool((self.gain == 1).all() and (self.bias == 0).all())

    def canonical(self, photograph: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 in the scene's colours; what lies outside [0, 255] there is clipped."""
        return photograph if self.is_identity else _mapped(photograph, (LEVELS - self.bias) / self.gain)

    def photographed(self, canonical: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 as this photograph would show it; inverse of :meth:`canonical` up to rounding and clipping."""
        return canonical if self.is_identity else _mapped(canonical, LEVELS * self.gain + self.bias)


IDENTITY = Exposure()


@dataclass(frozen=True, eq=False)
class Exposures:
    """The exposures of a drive's photographs.

    Attributes:
        known: by camera and frame name; frames that are not there have the identity.
        figures: how they were chosen (see ``optimize.exposure``), JSON-able.
    """

    known: Mapping[tuple[str, str], Exposure] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_identity(self) -> bool:
        """True where no photograph needs mapping."""
        return all(e.is_identity for e in self.known.values())

    def of(self, frame: Frame) -> Exposure:
        """The exposure of a frame."""
        return self.known.get((frame.camera_name, frame.name), IDENTITY)

    def read(self, frame: Frame) -> NDArray[np.uint8]:
        """The door in: a frame's photograph (H, W, 3) uint8 in canonical colours.

        Raises:
            DriveError: missing, unreadable or cut short.
        """
        return self.of(frame).canonical(read_image(frame.image_path))

    def delivered(self, frame: Frame, canonical: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The door out: a picture (H, W, 3) uint8 in canonical colours as the frame's own photograph would show it."""
        return self.of(frame).photographed(canonical)


def exposures_json(exposures: Exposures) -> dict[str, Any]:
    """The figures, and gain and bias of each frame that has them."""
    frames = [
        {"camera": camera, "name": name, "gain": e.gain.tolist(), "bias": e.bias.tolist()}
        for (camera, name), e in exposures.known.items()
    ]
    return {"figures": dict(exposures.figures), "frames": frames}


def exposures_of_json(data: Any) -> Exposures:
    """Inverse of :func:`exposures_json`; what is not of that form raises a ValueError, KeyError, TypeError or OverflowError."""
    known = {
        (str(f["camera"]), str(f["name"])): Exposure(
            np.array(f["gain"], dtype=np.float64).reshape(3), np.array(f["bias"], dtype=np.float64).reshape(3)
        )
        for f in data["frames"]
    }
    for (camera, name), exposure in known.items():
        if not (np.isfinite([exposure.gain, exposure.bias]).all() and exposure.gain.min() > 0):
            raise ValueError(f"the exposure of {camera} {name} is not finite, or its gain not above 0")
    if not isinstance(data["figures"], dict):
        raise ValueError("not an object: figures")
    return Exposures(known, data["figures"])


def write_exposures(exposures: Exposures, path: Path) -> None:
    """Write as JSON, see :func:`exposures_json`."""
    write_json_atomic(path, exposures_json(exposures))


def read_exposures(path: Path) -> Exposures:
    """Read what :func:`write_exposures` wrote; without the file all exposures are the identity.

    Raises:
        WorkspaceError: the file is damaged.
    """
    if not path.is_file():
        return Exposures()
    try:
        return exposures_of_json(read_own_json(path))
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise WorkspaceError(f"cannot be read: {error}", path=path, mend="run `unveil reconstruct` again") from error
