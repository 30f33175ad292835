"""Settings of a run that the user decides. Numeric presets per quality are beside the code that they control."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from unveil_core.base.checks.fields import checked
from unveil_core.base.drive_options import ALL_SWEEPS, DriveOptions
from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import DEVICES
from unveil_core.inpaint.single_image.names import INPAINTERS, is_file
from unveil_core.pipeline.mechanisms import check_mechanisms

__all__ = ["MOVERS", "ORDERS", "POSES", "QUALITIES", "UPS", "RunSettings", "bytes_of"]

QUALITIES = ("draft", "standard", "high")
MOVERS = ("auto", "keep")
POSES = ("auto", "given")
ORDERS = ("reverse", "forward", "independent")
UPS = ("x", "y", "z", "-x", "-y", "-z")
"""Axes of a drive that may be up; the directions are ``drives.placement.UP_AXES``."""
LEAST_MEMORY = 64 << 20
"""Fewest bytes for the frames of a stage: a few of 1920x1280 with all that training asks of them."""
HEIGHTS_M = (0.05, 200.0)
"""Of cameras above the ground: from toys to drones."""
MOST_GROWN_PX = 200
"""By which an object's mask may be enlarged: a tenth of the width of full HD."""
OF_DRIVES = (
    "scene", "cameras", "frames", "sweeps", "model", "labels", "instance_maps", "label_classes", "mask_removes",
    "pose_convention",
)  # fmt: skip
"""Settings that tell which part of a drive is read, and how, see ``base.drive_options.DriveOptions``."""
UNITS = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


def bytes_of(size: str) -> int | None:
    """Bytes of a size as people write it, as 4G, 512M or 1.5g; None where it is none."""
    found = re.fullmatch(r"\s*(\d{1,12}(?:\.\d{1,6})?)\s*([KMGT]?)(?:i?B)?\s*", size, re.IGNORECASE)
    return None if found is None else int(float(found[1]) * UNITS.get(found[2].upper(), 1))


def _object_setting(entry: str) -> tuple[str, str, str]:
    """Id, name and value of an entry of ``RunSettings.per_object``."""
    number, _, told = entry.partition(":")
    key, _, value = told.partition("=")
    return number, key, value


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run, recorded in workspace.json.

    Attributes:
        remove: class names and groups to remove; empty = everything removable that occurs.
        instances: ids of single objects to remove.
        marked: path of a JSON file of objects that a person marked, with boxes or mattes (see ``drives.marked``); made
            absolute; None = none.
        quality: "draft", "standard" or "high".
        device: "auto", "cpu" or "cuda", see ``base.kernels.device``: of what is rendered and trained. Results are the same but for
            rounding, so stages stay up to date when it changes. Whether this machine has the device is checked when a run
            begins, for a workspace may go on on another machine.
        seed: of everything random.
        per_object: what differs for single objects: "ID:grow=PIXELS" enlarges the object's mask by pixels of the delivered frame,
            "ID:shadow=keep" leaves its shadow in the street.
        corrections: path of a JSON file of clean frames that a person mended (see ``corrections.files``); made absolute; None =
            none.
        scale: units of the drive's coordinates in a metre; None = as its files tell, else estimated.
        camera_height: of the cameras above the ground, metres, from which the scale follows; None = it does not.
        up: the axis of the drive that is up, one of ``UPS``; None likewise.
        poses: "auto" refines the cameras' poses against the photographs where these clearly disagree with them (see
            ``drives.importing.refined_poses``), "given" keeps them.
        work_side: longer image side that larger images are reduced to, pixels; None = the quality's own, see
            ``pipeline.steps.import_.WORKING_SIZE_PX``.
        scene, cameras, frames, sweeps, model: which part of a dataset is read, see ``base.drive_options.DriveOptions``.
        labels, instance_maps: paths of folders of label pictures and instance maps for the frames, likewise, made absolute; None =
            the drive's own.
        label_classes, mask_removes: what pictures of classes hold and which end of a mask is removed, likewise; None = as their
            values tell, and black.
        pose_convention: what the matrices of poses are, likewise; None = what is the format's habit.
        memory: how much the frames that a stage holds may take, as "4G" or "512M" (see ``base.frame_cache``); results do not depend
            on it.
        segmenter: path of an ONNX file that labels the frames (see ``labelling.segmenter``), made absolute; None = the labels
            that the drive has, or what follows from its boxes and labelled points.
        shadows: "auto" removes the shadows of removed objects too, "off" keeps them; "AZIMUTH,ELEVATION" in degrees gives the
            direction to the sun instead of estimating it from the shadows (see ``inpaint.light.sun.sun_towards``).
        iterations, splats: steps and largest number of surfels of the reconstruction; None = chosen while it runs, by held-out
            error against cost.
        sh_degree: of the spherical harmonics, 0 to 3; None = chosen while the scene is reconstructed, and 0 in the empty one, which
            leaves no ghosts of removed objects.
        adapt: False uses the limits of the quality instead of choosing.
        movers: "auto" finds dynamic objects, which are removed from all frames and never become part of the scene; "keep" treats
            everything as static.
        inpainter: single-image inpainter for holes that no frame shows and that are not ground: a name in ``INPAINTERS``, or
            the path of an ONNX file, which is made absolute.
        baselines: whether the report fills the frames by single-image inpainters, too, to stand beside ours; it counts only where
            a true empty street is known.
        without: names of mechanisms that do not work, see ``pipeline.mechanisms``: for experts, to see what each is worth.
        reference_inpainter: path of an ONNX file that paints by a reference, likewise; None = none.
        order: of the frames in which holes are filled, "reverse", "forward" or "independent".
        keyframes: frames in which unobserved content is invented for all others, by stem or number (see
            ``drives.selecting.named_frames``); none = chosen by how much each newly shows.
    """

    remove: tuple[str, ...] = ()
    instances: tuple[int, ...] = ()
    quality: str = "standard"
    device: str = "auto"
    seed: int = 0
    work_side: int | None = None
    poses: str = "auto"
    shadows: str = "auto"
    movers: str = "auto"
    inpainter: str = "exemplar"
    order: str = "reverse"
    keyframes: tuple[str, ...] = ()
    iterations: int | None = None
    sh_degree: int | None = None
    splats: int | None = None
    adapt: bool = True
    baselines: bool = False
    without: tuple[str, ...] = ()
    reference_inpainter: str | None = None
    marked: str | None = None
    corrections: str | None = None
    per_object: tuple[str, ...] = ()
    scale: float | None = None
    camera_height: float | None = None
    up: str | None = None
    scene: str | None = None
    cameras: tuple[str, ...] = ()
    frames: str | None = None
    sweeps: str = ALL_SWEEPS
    model: str | None = None
    labels: str | None = None
    instance_maps: str | None = None
    label_classes: str | None = None
    mask_removes: str | None = None
    pose_convention: str | None = None
    segmenter: str | None = None
    memory: str = "4G"

    def __post_init__(self) -> None:
        if self.reference_inpainter is not None and not is_file(self.reference_inpainter):
            raise SettingsError(f"Not a reference inpainter: {self.reference_inpainter}", mend="give FILE.onnx")
        if self.segmenter is not None and not is_file(self.segmenter):
            raise SettingsError(f"Not a segmenter: {self.segmenter}", mend="give FILE.onnx")
        _ = self.drive_options  # which are checked where they are made
        check_mechanisms(self.without)
        if self.labels is not None and self.segmenter is not None:
            raise SettingsError(
                "Given twice: labels, from a folder and from a network", mend="give --labels or --segmenter"
            )
        for name in ("marked", "corrections", "labels", "instance_maps"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, str(Path(given).expanduser().absolute()))
        for name, path in self.networks.items():  # a later call may come from another folder
            object.__setattr__(self, name, str(path.expanduser().absolute()))
        for name, value, known in (
            ("quality", self.quality, QUALITIES),
            ("device", self.device, DEVICES),
            ("inpainter", "FILE.onnx" if is_file(self.inpainter) else self.inpainter, (*INPAINTERS, "FILE.onnx")),
            ("order", self.order, ORDERS),
            ("movers", self.movers, MOVERS),
            ("poses", self.poses, POSES),
            ("up", self.up, (None, *UPS)),
        ):
            if value not in known:
                raise SettingsError(
                    f"Not a choice of {name}: {value!r}", mend=f"use one of {', '.join(k for k in known if k)}"
                )
        if self.shadows not in ("auto", "off") and self.sun is None:
            raise SettingsError(
                f"Not a choice of shadows: {self.shadows}",
                mend="use auto, off, or the sun's azimuth and elevation in degrees, as 135,40",
            )
        if self.keyframes and self.order == "independent":
            raise SettingsError(
                "Not used when each frame is filled for itself: keyframes",
                mend="leave them out, or use another order",
            )
        if self.scale is not None and not 1e-6 <= self.scale <= 1e6:
            raise SettingsError(
                f"Out of range: scale {self.scale:g}", mend="give the units in a metre, 0.000001 to 1,000,000"
            )
        if self.camera_height is not None and not HEIGHTS_M[0] <= self.camera_height <= HEIGHTS_M[1]:
            problem = f"Out of range: camera_height {self.camera_height:g}"
            raise SettingsError(problem, mend=f"give metres above the ground, {HEIGHTS_M[0]} to {HEIGHTS_M[1]:g}")
        if self.camera_height is not None and self.scale is not None:
            raise SettingsError("Given twice: the scale", mend="give --scale or --camera-height")
        if (bytes_of(self.memory) or 0) < LEAST_MEMORY:
            raise SettingsError(
                f"Not a size, or too little: memory {self.memory}", mend="use 64M or more, as 512M or 4G"
            )
        if self.work_side is not None and self.work_side < 32:
            raise SettingsError(f"Out of range: work_side {self.work_side}", mend="at least 32 pixels")
        for name, given, low, high in (
            ("iterations", self.iterations, 20, 1_000_000),
            ("sh_degree", self.sh_degree, 0, 3),
            ("splats", self.splats, 100, 20_000_000),
        ):
            if given is not None and not low <= given <= high:
                raise SettingsError(f"Out of range: {name} {given}", mend=f"use {low:,} to {high:,}")
        for entry in self.per_object:
            number, key, told = _object_setting(entry)
            grows = key == "grow" and told.isdigit() and int(told[:9]) <= MOST_GROWN_PX
            if not number.isdigit() or len(number) > 9 or not (grows or (key, told) == ("shadow", "keep")):
                raise SettingsError(
                    f"Not a setting of an object: {entry}",
                    mend=f"use ID:grow=PIXELS, up to {MOST_GROWN_PX}, or ID:shadow=keep",
                )
        if self.seed < 0:
            raise SettingsError(f"Out of range: seed {self.seed}", mend="use 0 or more")
        if self.seed >= 1 << 63:
            raise SettingsError(f"Out of range: seed {self.seed}", mend="use less than 2^63")

    @property
    def grown_px(self) -> dict[int, int]:
        """By object, pixels of the delivered frame by which its mask is enlarged."""
        told = [_object_setting(entry) for entry in self.per_object]
        return {int(number): int(value) for number, key, value in told if key == "grow" and int(value) > 0}

    @property
    def shadows_that_stay(self) -> frozenset[int]:
        """Removed objects whose shadows are left in the street."""
        told = [_object_setting(entry) for entry in self.per_object]
        return frozenset(int(number) for number, key, _ in told if key == "shadow")

    @property
    def sun(self) -> tuple[float, float] | None:
        """Azimuth and elevation of the sun, degrees, where ``shadows`` gives them."""
        try:
            azimuth, elevation = (float(part) for part in self.shadows.split(","))
        except ValueError:
            return None
        return (azimuth, elevation) if math.isfinite(azimuth) and 0 < elevation <= 90 else None

    @property
    def memory_bytes(self) -> int:
        """Bytes of ``memory``."""
        return bytes_of(self.memory) or LEAST_MEMORY

    @property
    def drive_options(self) -> DriveOptions:
        """Which part of the drive is read."""
        return DriveOptions(**{name: getattr(self, name) for name in OF_DRIVES})

    def without_drive_options(self) -> RunSettings:
        """The same for another drive, that is read whole and has its labels."""
        usual = RunSettings()
        return replace(self, **{name: getattr(usual, name) for name in (*OF_DRIVES, "segmenter")})

    @property
    def files(self) -> dict[str, Path]:
        """The files that settings name, by setting: of them the content counts."""
        named = {"marked": self.marked, "corrections": self.corrections}
        return {**self.networks, **{name: Path(path) for name, path in named.items() if path is not None}}

    @property
    def networks(self) -> dict[str, Path]:
        """The networks that settings name, by setting."""
        return {
            name: Path(value)
            for name, value in (
                ("inpainter", self.inpainter),
                ("reference_inpainter", self.reference_inpainter),
                ("segmenter", self.segmenter),
            )
            if value is not None and is_file(value)
        }

    def to_json(self) -> dict[str, object]:
        """A JSON-able dict."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}

    @staticmethod
    def from_json(data: dict) -> RunSettings:  # type: ignore[type-arg]
        """Inverse of :meth:`to_json`, of what a workspace records.

        Raises:
            SettingsError: a setting that this version does not have, or of another kind.
        """
        try:
            return checked(RunSettings, data)
        except (TypeError, ValueError) as error:
            raise SettingsError(
                f"the workspace records settings that this version does not have: {error}",
                mend="use the version of Unveil that made it, or begin a new workspace",
            ) from error
