"""The keywords of the API: each setting with the values of Python that it takes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias, TypedDict

__all__ = ["ObjectKeywords", "SettingKeywords"]

File: TypeAlias = "str | os.PathLike[str] | None"
Frames: TypeAlias = "str | int | slice | range | Sequence[str | int | slice | range] | None"


class ObjectKeywords(TypedDict, total=False):
    """What differs for a single object: its mask enlarged by pixels of the delivered frame, its shadow kept."""

    grow: int
    shadow: Literal["keep"]


class SettingKeywords(TypedDict, total=False):
    """Settings of a run; ``None`` is the default of each. ``docs/command.md`` says what they are."""

    remove: Sequence[str] | None
    instances: Sequence[int] | None
    marked: File
    per_object: Mapping[int, ObjectKeywords] | None
    corrections: File
    shadows: bool | tuple[float, float] | None
    movers: Literal["auto", "keep"] | None
    scene: str | None
    cameras: Sequence[str] | None
    frames: Frames
    labels: File
    segmenter: File
    instance_maps: File
    label_classes: str | None
    mask_removes: Literal["black", "white"] | None
    sweeps: Literal["all", "key"] | int | None
    model: str | int | Sequence[str | int] | None
    pose_convention: str | None
    scale: float | None
    camera_height: float | None
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None
    poses: Literal["auto", "given"] | None
    quality: Literal["draft", "standard", "high"] | None
    work_side: int | None
    device: Literal["auto", "cpu", "cuda"] | None
    memory: int | str | None
    seed: int | None
    iterations: int | None
    splats: int | None
    sh_degree: int | None
    adapt: bool | None
    inpainter: str | os.PathLike[str] | None
    reference_inpainter: File
    order: Literal["reverse", "forward", "independent"] | None
    keyframes: Sequence[int | str] | None
    baselines: bool | None
    without: Sequence[str] | None
