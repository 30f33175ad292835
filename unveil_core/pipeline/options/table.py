"""The table of settings: one row for each field of ``RunSettings``, which has the type and the default.

The options of the command, the properties of the add-on, the keywords of the API and the tables in docs/ follow from it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from typing import Any

from unveil_core.base.drive_options import LABEL_CLASSES, MASK_REMOVES, POSE_CONVENTIONS
from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import DEVICES
from unveil_core.pipeline.options.kinds import (
    FILE,
    FLAG,
    FOLDER,
    FRAMES,
    IDS,
    NAMES,
    NETWORK,
    NUMBER,
    OBJECTS,
    SIZE,
    SUN,
    TEXT,
    TEXTS,
    UP,
    WHOLE,
    Kind,
    choice,
)
from unveil_core.pipeline.settings import HEIGHTS_M, MOVERS, ORDERS, POSES, QUALITIES, RunSettings

__all__ = ["AUTO", "GROUPS", "SETTINGS", "TABLE", "Setting"]

AUTO = "auto"
"""The word that takes any setting back to its default."""

GROUPS = {
    "remove": "what to remove",
    "read": "what to read",
    "place": "scale and axes",
    "work": "quality and machine",
    "method": "method",
}
"""Groups of settings, each with its heading."""

DEFAULTS: dict[str, Any] = {f.name: f.default for f in fields(RunSettings)}
TYPES: dict[str, str] = {f.name: str(f.type) for f in fields(RunSettings)}


@dataclass(frozen=True)
class Setting:
    """A row of the table.

    Attributes:
        name: of the field of ``RunSettings``.
        kind: how it is written.
        group: one of ``GROUPS``.
        help: what it is, in a line without a final stop.
        usual: the default in words, where the value itself does not say it.
        metavar: what stands for its value in the help of the command.
        measure: unit of the number, as "m" or "px".
        expert: whether only ``--help-all`` and *Advanced* show it.
        label: in the sidebar of Blender.
        choices: by name, label and description in Blender; () where it is no choice.
        low, high: of a number.
        see: page and anchor with more, in docs/.
        back: further words that take it back.
        repeated: whether the option may be given several times, each adding to those before.
    """

    name: str
    kind: Kind
    group: str
    help: str
    label: str
    usual: str = ""
    metavar: str = ""
    measure: str = ""
    expert: bool = False
    choices: tuple[tuple[str, str, str], ...] = ()
    low: float | None = None
    high: float | None = None
    see: str = ""
    back: tuple[str, ...] = ()
    repeated: bool = False

    @property
    def default(self) -> Any:
        """The value that a run has where nothing is given."""
        return DEFAULTS[self.name]

    @property
    def type(self) -> str:
        """Of the value, as Python's annotations name it."""
        return TYPES[self.name]

    @property
    def option(self) -> str:
        """Of the command."""
        return "--adaptation" if self.name == "adapt" else f"--{self.name.replace('_', '-')}"

    @property
    def said_default(self) -> str:
        """The default in words."""
        return self.usual or ("on" if self.default is True else "off" if self.default is False else str(self.default))

    def parse(self, text: str) -> Any:
        """The value that a word of the command means.

        Raises:
            ValueError: none; one line.
        """
        if text.strip() in (AUTO, *self.back):
            return self.default
        try:
            return self.kind.parse(text)
        except ValueError:
            raise ValueError(f"not {self.kind.expects}, and not {AUTO}: {text!r}") from None

    def take(self, value: Any) -> Any:
        """The value to record for one of Python or TOML; None and "auto" are the default.

        Raises:
            SettingsError: it is of another kind.
        """
        if value is None:
            return self.default
        if isinstance(value, os.PathLike):
            value = os.fspath(value)
        try:
            return self.parse(value) if isinstance(value, str) else self.kind.take(value)
        except (TypeError, ValueError):
            problem = f"Not a value of {self.name}: {value!r}"
            raise SettingsError(problem, mend=f"give {self.kind.expects}") from None


TABLE: tuple[Setting, ...] = (
    # What to remove
    Setting(
        "remove", NAMES, "remove", "classes or groups, as vehicle,human",
        label="Remove", metavar="CLASSES", usual="all removable",
    ),
    Setting(
        "instances", IDS, "remove", "objects by id in objects.json, as 3,7",
        label="Objects", metavar="IDS", usual="none",
    ),
    Setting(
        "marked", FILE, "remove", "objects without labels, by unveil mask",
        label="Marked Objects", metavar="FILE.json", usual="none", see="input.md#marked-objects", back=("none",),
    ),
    Setting(
        "per_object", OBJECTS, "remove",
        "single objects: enlarge the mask by pixels of the delivered frame, or leave the shadow",
        label="Single Objects", metavar="ID:grow=PX,ID:shadow=keep", usual="none", expert=True, back=("none",),
    ),
    Setting(
        "corrections", FILE, "remove", "clean frames that a person mended, which all other frames follow",
        label="Corrections", metavar="FILE.json", usual="none", expert=True, see="input.md#corrections", back=("none",),
    ),
    Setting(
        "shadows", SUN, "remove",
        "remove shadows too, keep them, or give the sun in degrees: azimuth clockwise from +y, elevation",
        label="Shadows", metavar="auto|off|A,E",
        choices=(
            ("auto", "Automatic", "Shadows of removed objects are removed too; the sun's direction is estimated"),
            ("off", "Keep", "Shadows of removed objects stay in the pictures"),
            ("given", "Given Sun", "As Automatic, with the sun's direction from Azimuth and Elevation"),
        ),
    ),
    Setting(
        "movers", choice(*MOVERS), "remove", "remove dynamic objects, or take all as static",
        label="Dynamic Objects",
        choices=(
            ("auto", "Remove", "Objects that move during the drive are removed from every frame"),
            ("keep", "As Static", "They are treated as static objects"),
        ),
    ),
    # What to read
    Setting(
        "scene", TEXT, "read", "drive to take, of a folder with several",
        label="Scene", metavar="NAME", usual="the only one", see="datasets.md",
    ),
    Setting(
        "cameras", NAMES, "read", "cameras of a rig",
        label="Cameras", metavar="NAMES|all", usual="a dataset's front, else all",
    ),
    Setting(
        "frames", FRAMES, "read", "part of the drive, as 0:80:2 or 3:9,40:46",
        label="Frames", metavar="A:B:STEP", usual="all",
    ),
    Setting(
        "labels", FOLDER, "read", "label pictures, as CAMERA/STEM.png",
        label="Labels", metavar="FOLDER", usual="the drive's", see="datasets.md#labels-that-you-have",
        back=("none",),
    ),
    Setting(
        "segmenter", FILE, "read", "network that labels the frames",
        label="Segmenter", metavar="FILE.onnx", usual="labels of the drive",
        see="datasets.md#labels-by-a-network", back=("none",),
    ),
    Setting(
        "instance_maps", FOLDER, "read", "pictures of the ids of single objects, named as the label pictures",
        label="Instance Maps", metavar="FOLDER", usual="those of the drive", expert=True, back=("none",),
    ),
    Setting(
        "label_classes", choice(*LABEL_CLASSES), "read", "what label pictures hold",
        label="Label Classes", metavar="NAME", usual="found from their values", expert=True,
        see="datasets.md#labels-that-you-have",
    ),
    Setting(
        "mask_removes", choice(*MASK_REMOVES), "read", "which part of a mask is removed",
        label="Mask Removes", usual="black", expert=True,
    ),
    Setting(
        "sweeps", TEXT, "read", "LiDAR sweeps: all, those of annotated frames (and only such frames), or each N-th",
        label="LiDAR Sweeps", metavar="all|key|N", expert=True,
    ),
    Setting(
        "model", TEXT, "read", "of several COLMAP models: one by its folder's name, or those that share pictures, joined",
        label="COLMAP Model", metavar="N|N,N|all", usual="the largest", expert=True, see="input.md#colmap",
    ),
    Setting(
        "pose_convention", choice(*POSE_CONVENTIONS), "read",
        "what the matrices of poses are: opengl (camera to world, y up, z back), opencv (camera to world, y down, z forward), "
        "or world to camera with the axes of either",
        label="Pose Convention", metavar="NAME", usual="the format's habit", expert=True,
    ),
    # Scale and axes
    Setting(
        "scale", NUMBER, "place", "units in a metre",
        label="Units per Metre", metavar="UNITS", usual="from the file, else estimated", low=1e-6, high=1e6,
        see="input.md#scale",
    ),
    Setting(
        "camera_height", NUMBER, "place", "height of the cameras above the ground: gives the scale",
        label="Camera Height", metavar="METRES", usual="from the file, else 1.6 m", measure="m",
        low=HEIGHTS_M[0], high=HEIGHTS_M[1],
    ),
    Setting(
        "up", UP, "place", "axis that points up",
        label="Up Axis", usual="from the file, else estimated", see="input.md#up",
    ),
    Setting(
        "poses", choice(*POSES), "place",
        "refine the cameras where the photographs clearly disagree with them, or keep them",
        label="Poses", expert=True,
        choices=(
            ("auto", "Automatic", "Cameras are refined where the photographs clearly disagree with them"),
            ("given", "As Given", "Cameras stay as the drive has them"),
        ),
    ),
    # Quality and machine
    Setting(
        "quality", choice(*QUALITIES), "work", "working size, steps, surfels, voxels",
        label="Quality", metavar="LEVEL",
        choices=(
            ("draft", "Draft", "A first look, in minutes: smaller images, fewer steps"),
            ("standard", "Standard", "For most work; about three times as long as a draft"),
            ("high", "High", "Larger images, more steps, finer meshes"),
        ),
    ),
    Setting(
        "work_side", WHOLE, "work", "longer side of the scene's images; frames keep their size",
        label="Longer Side", metavar="PIXELS", usual="512, 768, 1600 by quality", measure="px", low=32,
    ),
    Setting(
        "device", choice(*DEVICES), "work", "an NVIDIA GPU where one can be used, the processor, the GPU",
        label="Device", see="command.md#gpu",
        choices=(
            ("auto", "Automatic", "An NVIDIA GPU where one can be used, else the processor; Check in the preferences tells"),
            ("cpu", "CPU", "The processor alone"),
            ("cuda", "GPU", "An NVIDIA GPU alone; a run is refused where none can be used"),
        ),
    ),
    Setting(
        "memory", SIZE, "work", "room for the frames that a stage holds; results do not depend on it",
        label="Memory", metavar="SIZE", expert=True,
    ),
    Setting("seed", WHOLE, "work", "seed of everything random", label="Seed", metavar="N", expert=True, low=0, high=2**63 - 1),
    # Method
    Setting(
        "iterations", WHOLE, "method", "steps of the reconstruction",
        label="Iterations", metavar="N", usual="chosen during the run", expert=True, low=20, high=1_000_000,
    ),
    Setting(
        "splats", WHOLE, "method", "surfels of the reconstruction at most",
        label="Surfels", metavar="N", usual="chosen during the run", expert=True, low=100, high=20_000_000,
    ),
    Setting(
        "sh_degree", WHOLE, "method", "degree of colour by direction, 0 to 3",
        label="Color Degree", metavar="L", usual="chosen; 0 in the empty scene", expert=True, low=0, high=3,
    ),
    Setting(
        "adapt", FLAG, "method", "choose steps and surfels by held-out error, or use all that the quality allows",
        label="Adapt", expert=True,
    ),
    Setting(
        "inpainter", NETWORK, "method",
        "fills holes that no frame shows and that are not ground: exemplar, telea, navier-stokes, shift-map, fsr, or a network",
        label="Inpainter", metavar="NAME|FILE.onnx", expert=True,
    ),
    Setting(
        "reference_inpainter", FILE, "method", "network that fills a frame from a frame that is already filled",
        label="Reference Inpainter", metavar="FILE.onnx", usual="none", expert=True, back=("none",),
    ),
    Setting(
        "order", choice(*ORDERS), "method", "order in which frames fill holes, for comparison",
        label="Fill Order", expert=True,
        choices=(
            ("reverse", "Last Frame First", "Holes are filled in the last frame first, which earlier ones take their fill from"),
            ("forward", "First Frame First", "The other way round, for comparison"),
            ("independent", "Each for Itself", "No frame takes another's fill, for comparison"),
        ),
    ),
    Setting(
        "keyframes", TEXTS, "method", "frames that fill holes for all others, by the number in their names, by place, or by stem",
        label="Keyframes", metavar="N,N,...", usual="chosen", expert=True,
    ),
    Setting(
        "baselines", FLAG, "method",
        "in the report of a drive with truth, fill the frames by single-image inpainters, too, for comparison: slow",
        label="Baselines", expert=True,
    ),
    Setting(
        "without", NAMES, "method", "mechanisms that do not work, to see what each is worth; may be given more than once",
        label="Without", metavar="NAME", usual="none", expert=True, see="command.md#without", back=("none",), repeated=True,
    ),
)  # fmt: skip
"""All settings, in the order in which they are shown."""

SETTINGS: dict[str, Setting] = {setting.name: setting for setting in TABLE}
"""The same by name."""
