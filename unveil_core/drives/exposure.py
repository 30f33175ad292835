"""Exposure and white balance of each photograph: conversion between its colours and the scene's canonical ones.

A camera with automatic exposure and white balance shows one wall in many colours. The scene has one *canonical* colour for
it; each photograph is an affine function of that, per channel of sRGB: ``photograph = gain * canonical + bias``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import read_own_json, write_json_atomic
from unveil_core.base.pictures.decoding import read_levels
from unveil_core.base.pictures.levels import as_words
from unveil_core.base.types import Float32, Float64, Levels
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

    def canonical(self, photograph: Levels) -> Levels:
        """A photograph (H, W, 3) in the scene's colours, which may lie outside of 0 and 255: a dark photograph shows highlights
        that are brighter than white is in others."""
        return photograph if self.is_identity else _mapped(photograph, 1 / self.gain, -self.bias / self.gain)

    def photographed(self, canonical: Levels) -> Levels:
        """(H, W, 3) as this photograph would show it, likewise; the inverse of :meth:`canonical`."""
        return canonical if self.is_identity else _mapped(canonical, self.gain, self.bias)


def _mapped(levels: Levels, gain: Float64, bias: Float64) -> Float32:
    """Levels (H, W, 3) times ``gain`` (3,), and ``bias`` (3,), in [0, 1], added."""
    mapped = levels * gain.astype(np.float32)
    mapped += (255 * bias).astype(np.float32)
    return mapped


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

    def read(self, frame: Frame) -> Levels:
        """The door in: a frame's photograph (H, W, 3) in canonical colours.

        Raises:
            DriveError: missing, unreadable or cut short.
        """
        return self.of(frame).canonical(read_levels(frame.image_path))

    @cached_property
    def _widest(self) -> Exposure:
        """In which all that any of the photographs shows lies between black and white."""
        ends = [(end - e.bias) / e.gain for e in (IDENTITY, *self.known.values()) for end in (0, 1)]
        low, high = float(np.min(ends)), float(np.max(ends))
        return Exposure(np.full(3, 1 / (high - low)), np.full(3, -low / (high - low)))

    def packed(self, canonical: Levels) -> NDArray[np.uint16]:
        """A picture (H, W, 3) in canonical colours for a file that a later stage goes on from: with 16 bits, and in an exposure in
        which all that any of the photographs shows lies between black and white."""
        return as_words(self._widest.photographed(canonical))

    def read_packed(self, path: Path) -> Levels:
        """The inverse of :meth:`packed`.

        Raises:
            DriveError: missing, unreadable or cut short.
        """
        return self._widest.canonical(read_levels(path))

    def delivered(self, frame: Frame, canonical: Levels) -> Levels:
        """The door out: a picture (H, W, 3) in canonical colours as the frame's own photograph would show it."""
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
