"""The command line's grammar. Importing it loads neither torch nor NumPy, so ``unveil --help`` answers at once."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from unveil_core import __version__
from unveil_core.app.grammar.common import (
    MESSAGES,
    add_common,
    add_device,
    add_footage,
    add_replace,
    add_settings,
    add_yes,
    metres,
    names_of,
    size_of,
)
from unveil_core.app.grammar.parsers import CommandParser, MainParser
from unveil_core.app.grammar.setting_options import add_setting
from unveil_core.app.mask.words import add_words
from unveil_core.pipeline.settings import QUALITIES

__all__ = ["BLOCK_STAGES", "EXPORTS", "STAGE_VERBS", "command_parser"]

STAGE_VERBS = {
    "objects": "list the classes and single objects that can be removed",
    "segment": "find the labels that occur and the dynamic objects",
    "choose": "choose the classes and objects to remove",
    "reconstruct": "fit the semantic surfel scene with everything in it",
    "ground": "fit the street's path, the ground and the terrain, once for a scene",
    "instances": "assign the listed objects to the scene's surfels",
    "remove": "select the surfels and pixels to remove, find what no frame shows",
    "inpaint": "fill what the removed objects hid, in every frame and as new surfels",
    "reoptimize": "optimize the empty scene near the removed objects, write renders/ and clean/",
    "deliver": "bring the clean frames to the size, lens and bit depth of the footage: frames/",
    "mesh": "fuse meshes of the full and the empty street",
    "report": "measure and write the report page",
}
"""The stages that have a verb of their own, each with its line of help, in the order of ``pipeline.graph.STAGES``. They are
named here again because importing the stages loads torch; a test compares the two lists."""


BLOCK_STAGES = ("reconstruct", "reoptimize")
"""The stages that are made in blocks, see ``pipeline.stage.Stage.run_block``; a test compares."""

EXPORTS = (
    "splat-ply", "spz", "splat-gltf", "usd-splats", "usd-points", "ply", "obj", "glb", "usd", "textured-glb", "textured-obj",
    "textured-usd", "nerfstudio", "colmap", "chan",
    "las", "laz", "objects-json", "png", "exr", "mattes", "mp4", "pandaset", "kitti", "nuscenes", "prores",
)  # fmt: skip
"""The formats of ``exports.registry.FORMATS``; likewise."""


STATE = "the street without or with everything, or as it was edited in Blender"
DRIVE = "a transforms.json, or the folder of a dataset"
CLIP = "; or a clip, with options of unveil solve (--help-all)"

_Verbs = Any
"""What ``add_subparsers`` returns; argparse gives it no public name."""


def command_parser() -> MainParser:
    """The parser of the ``unveil`` command."""
    parser = MainParser(prog="unveil", description="The empty street from a drive.")
    parser.add_argument("--version", action="version", version=f"unveil {__version__}")
    for name, (words, text) in MESSAGES.items():
        parser.add_argument(*words, dest=name, action="store_true", help=text)
    verbs = parser.add_subparsers(dest="verb", required=True, parser_class=CommandParser, metavar="VERB")
    _add_whole_runs(verbs)
    _add_solve(verbs)
    _add_check(verbs)
    _add_mask(verbs)
    _add_stages(verbs)
    _add_evaluate(verbs)
    _add_render(verbs)
    _add_export(verbs)
    _add_bench(verbs)
    _add_batch(verbs)
    add_common(verbs.add_parser("doctor", help="show what Unveil finds on this machine"))
    _add_completion(verbs)
    return parser


# Verbs


def _add_whole_runs(verbs: _Verbs) -> None:
    for name, text in (
        ("demo", "unveil the sample street"),
        ("run", "from a drive to clean frames, meshes and a report"),
        ("import", "import a drive into a workspace and list what can be removed"),
    ):
        p = verbs.add_parser(name, help=text)
        if name == "demo":
            p.add_argument("-o", "--output", type=Path, default=Path("demo_workspace"), metavar="WORKSPACE")
        else:
            p.add_argument("drive", type=Path, help=DRIVE + CLIP * (name == "run"))
            p.add_argument(
                "-o",
                "--output",
                type=Path,
                required=True,
                metavar="WORKSPACE",
                help="folder of the results, which keeps its settings",
            )
        if name == "run":
            p.add_argument(
                "--until", choices=tuple(STAGE_VERBS), default=None, metavar="STAGE", help="the last stage to run"
            )
        if name == "import":
            p.add_argument(
                "--preview", action="store_true", help="draw labels and objects over the frames: WORKSPACE/preview"
            )
        p.add_argument("--reset", action="store_true", help="take defaults, not the workspace's settings")
        p.add_argument("--dry-run", action="store_true", help="say what would run, why, and how long")
        if name != "demo":
            add_replace(p, "replace results of another drive")
            add_yes(p)
        add_settings(p)
        if name == "run":
            add_footage(p, hidden=True)
        add_common(p)


def _add_solve(verbs: _Verbs) -> None:
    p = verbs.add_parser("solve", help="make a drive of a clip or photographs: cameras and points out of the pictures")
    p.add_argument("footage", type=Path, nargs="+", metavar="CLIP|FOLDER", help="one a camera")
    p.add_argument("-o", "--output", type=Path, required=True, metavar="DRIVE")
    p.add_argument(
        "--frames",
        default=argparse.SUPPRESS,
        metavar="A:B:STEP",
        help="part of the footage, counted from 0 as in Python",
    )
    p.add_argument(
        "--labels", default=argparse.SUPPRESS, type=Path, metavar="FOLDER", help="PNGs of Cityscapes trainIds, by frame"
    )
    p.add_argument(
        "--masks",
        default=argparse.SUPPRESS,
        type=Path,
        metavar="FOLDER",
        help="masks, a PNG a frame, 0 = remove",
    )
    p.add_argument(
        "--segmenter", default=argparse.SUPPRESS, type=Path, metavar="FILE.onnx", help="network that labels the frames"
    )
    p.add_argument(
        "--camera-height",
        default=argparse.SUPPRESS,
        type=metres,
        metavar="METRES",
        help="height above the ground: gives the scale",
    )
    add_footage(p)
    add_replace(p, "write into a folder that no solve made")
    add_common(p)


def _add_check(verbs: _Verbs) -> None:
    p = verbs.add_parser("check", help="look at a drive before a run: what it is, what is assumed, what looks wrong")
    p.add_argument("drive", type=Path, help=DRIVE)
    p.add_argument(
        "-o",
        "--output",
        type=Path,
        default=None,
        metavar="FILE.html",
        help="the page, by default check_DRIVE.html here",
    )
    add_replace(p, "write over a page that no check made")
    add_yes(p)
    add_settings(p)
    add_common(p)


def _add_mask(verbs: _Verbs) -> None:
    p = verbs.add_parser(
        "mask", help="outline objects by a few clicks or strokes, in all frames, as mattes for --marked"
    )
    p.add_argument("source", type=Path, metavar="DRIVE|WORKSPACE")
    add_words(p)
    p.add_argument("--moving", action="store_true", help="find dynamic objects by their motion, without labels")
    p.add_argument("--prompt-encoder", type=Path, metavar="FILE.onnx", help="your promptable network: of pictures")
    p.add_argument("--prompt-decoder", type=Path, metavar="FILE.onnx", help="its other half: of clicks")
    p.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="of the mattes; a later call adds to it"
    )
    add_settings(p)
    add_common(p)


def _add_stages(verbs: _Verbs) -> None:
    status = {"status": "which stages of a workspace are done, stale, or still to do"}
    for name, text in {**STAGE_VERBS, **status}.items():
        p = verbs.add_parser(name, help=text)
        p.add_argument("workspace", type=Path, help="folder of the results")
        add_settings(p)
        add_common(p)
    p = verbs.add_parser("run-block", help="make one block of a long drive for a stage, as one of many machines")
    p.add_argument("workspace", type=Path, help="folder of the results")
    p.add_argument("stage", choices=BLOCK_STAGES)
    p.add_argument("block", type=int, help="its number, from 0")
    add_common(p)


def _add_evaluate(verbs: _Verbs) -> None:
    p = verbs.add_parser("evaluate", help="compare a workspace with the true empty street, or with its own photographs")
    p.add_argument("workspace", type=Path, help="folder of the results")
    p.add_argument(
        "--truth",
        type=Path,
        default=None,
        metavar="DIR",
        help="true empty street, by default the one that the drive names",
    )
    p.add_argument("--lpips", type=Path, default=None, metavar="FILE", help="your LPIPS network, TorchScript or ONNX")
    p.add_argument("--fid", type=Path, default=None, metavar="FILE", help="your network of features for FID")
    p.add_argument(
        "--holdout-masks",
        action="store_true",
        help="put virtual cars in front of visible street, remove them, compare; takes a drive, too",
    )
    p.add_argument("--cars", type=int, default=None, metavar="N", help="virtual cars (2)")
    p.add_argument(
        "--quality",
        default=None,
        choices=QUALITIES,
        help="of the run with the virtual cars, by default the workspace's",
    )
    p.add_argument(
        "-o",
        "--output",
        type=Path,
        default=None,
        metavar="DIR",
        help="of the folder holdout/ with all that is made, by default WORKSPACE_holdout",
    )
    add_device(p)
    add_common(p)


def _add_render(verbs: _Verbs) -> None:
    p = verbs.add_parser(
        "render", help="render the scene from free views: a path of cameras, or beside the drive's own"
    )
    p.add_argument("workspace", type=Path, help="folder of the results")
    p.add_argument("--state", default="empty", choices=("empty", "full", "edited"), help=STATE)
    p.add_argument(
        "--path",
        type=Path,
        default=None,
        metavar="FILE",
        help="cameras: transforms.json or nerfstudio's camera path; by default the drive's own",
    )
    p.add_argument(
        "--beside", type=float, default=0.0, metavar="METRES", help="to the right of the path (left: negative)"
    )
    p.add_argument("--above", type=float, default=0.0, metavar="METRES", help="up from the path")
    p.add_argument(
        "--planes", type=names_of, default=("rgb",), metavar="PLANES", help="rgb,depth,normal,alpha,semantics"
    )
    p.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    add_device(p)
    add_common(p)


def _add_export(verbs: _Verbs) -> None:
    p = verbs.add_parser("export", help="write results for other programs: splats, meshes, cameras, points, plates")
    p.add_argument("workspace", type=Path, help="folder of the results")
    p.add_argument(
        "--to",
        type=names_of,
        default=(),
        metavar="NAMES",
        help=f"{','.join(EXPORTS)}; by default the mesh that FILE's suffix says",
    )
    p.add_argument("--state", default="empty", choices=("empty", "full", "edited"), help=STATE)
    p.add_argument(
        "--triangles", type=int, metavar="N", help="of a mesh at most; all by default, 200,000 of one with textures"
    )
    p.add_argument("--lods", type=int, default=0, metavar="N", help="more levels of detail of a mesh with textures")
    p.add_argument("--texture", type=int, default=4096, metavar="PX", help="side of a page of textures (4096)")
    p.add_argument("--start-frame", type=int, default=1001, metavar="N", help="number of a camera's first plate (1001)")
    p.add_argument(
        "--epsg",
        default="",
        metavar="CODE",
        help="coordinate system of the drive's coordinates for LAS, as 25832 or with heights 25832+7837",
    )
    p.add_argument(
        "--undistorted",
        action="store_true",
        help="pinhole cameras and pictures in colmap and nerfstudio, without lenses",
    )
    p.add_argument("--spz", type=int, default=3, metavar="VERSION", help="of an SPZ file: 2, 3 or 4 (3)")
    p.add_argument(
        "-o",
        "--output",
        type=Path,
        default=None,
        metavar="DIR|FILE",
        help="a folder, or the file of a single format; a mesh goes beside the meshes by default",
    )
    add_replace(p, "write over a file that no export of the workspace made")
    add_device(p)
    add_common(p)


def _add_batch(verbs: _Verbs) -> None:
    batch = verbs.add_parser("batch", help="many drives, on many machines")
    parts = batch.add_subparsers(dest="part", required=True, parser_class=CommandParser, metavar="PART")
    p = parts.add_parser("plan", help="write the tasks of some drives")
    p.add_argument("drives", type=Path, nargs="+", metavar="DRIVE")
    p.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="of the batch and the workspaces")
    add_replace(p, "write over the batch.json of other drives, or of another program")
    add_yes(p)
    add_settings(p)
    add_common(p)
    for name, text in (
        ("run", "run the tasks that are not done, on a Dask cluster"),
        ("status", "how far it is, by its files"),
        ("merge", "put finished blocks together, and finish the drives, here"),
        ("template", "write the tasks for another farm"),
    ):
        p = parts.add_parser(name, help=text)
        p.add_argument("batch", type=Path, metavar="DIR")
        if name == "run":
            p.add_argument(
                "--scheduler",
                default=None,
                metavar="ADDRESS",
                help="address of a running Dask scheduler, as tcp://host:8786",
            )
            p.add_argument(
                "--workers", type=int, default=2, metavar="N", help="local processes, without a scheduler (2)"
            )
        if name == "template":
            p.add_argument("--to", required=True, choices=("openjd", "slurm", "flamenco"), help="which farm's")
            add_replace(p, "write over a file that no batch made")
        add_common(p)


def _add_completion(verbs: _Verbs) -> None:
    p = verbs.add_parser("completion", help="print the completion script of a shell")
    p.add_argument("shell", choices=("bash", "zsh", "tcsh"))
    add_common(p)


def _add_bench(verbs: _Verbs) -> None:
    p = verbs.add_parser("bench", help="measure the rasterizer, a training step, a reconstruction or whole runs")
    p.add_argument("what", choices=("raster", "step", "reconstruction", "pipeline", "run"))
    p.add_argument(
        "drive", type=Path, nargs="?", default=None, help="with a truth, but for run; the sample street by default"
    )
    p.add_argument("--quality", default="standard", choices=QUALITIES, help="of the runs (standard)")
    p.add_argument("--every", type=int, default=8, metavar="N", help="hold every n-th frame out (8)")
    p.add_argument(
        "--without", type=names_of, default=(), metavar="LOSSES", help="losses to leave out, as normal,distortion"
    )
    p.add_argument(
        "--variant",
        default=None,
        metavar="NAME",
        help="fixed, soft_labels, ellipsoids, random_start, no_growth, no_pruning or torch, for comparison",
    )
    p.add_argument("--salt", type=float, default=0.0, metavar="SHARE", help="wrong label pixels to put in, as 0.05")
    p.add_argument(
        "--rows", type=names_of, default=(), metavar="NAMES", help="of the pipeline's baselines; all by default"
    )
    p.add_argument(
        "--scene", type=Path, default=None, metavar="WORKSPACE", help="where the rows' scene is, or is to be kept"
    )
    p.add_argument("--keep", type=Path, default=None, metavar="DIR", help="for the frames of each row")
    p.add_argument(
        "--until",
        choices=tuple(STAGE_VERBS),
        default=None,
        metavar="STAGE",
        help="the last stage of a run; all by default",
    )
    for name in ("inpainter", "reference_inpainter"):  # of all rows
        add_setting(p, name)
    p.set_defaults(inpainter="exemplar", reference_inpainter=None)
    p.add_argument("--seed", type=int, default=0, help="of everything random (0)")
    p.add_argument("-o", "--output", type=Path, default=None, metavar="FILE", help="JSON; the plot goes beside it")
    add_replace(p, "write over files that no benchmark made")
    p.add_argument(
        "--yardstick", type=Path, default=None, metavar="FOLDER", help="a C++ rasterizer to compile and compare"
    )
    p.add_argument("--quick", action="store_true", help="a small scene and few rounds, to see that it works")
    p.add_argument("--surfels", type=int, default=None, metavar="N", help="of the main table, or of the step")
    p.add_argument("--size", type=size_of, default=None, metavar="WIDTHxHEIGHT", help="of the pictures")
    add_device(p)
    add_common(p)
