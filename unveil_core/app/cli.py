"""The ``unveil`` command: parses, calls stages, prints. Exit 0 done, 1 failed, 2 bad input or usage, 130 cancelled."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from unveil_core import __version__
from unveil_core.app.stdin_watch import end_with_stdin
from unveil_core.base.errors import Cancelled, DiskFullError, DriveError, SettingsError, UnveilError

__all__ = ["main"]

_VERBS = {
    "objects": "list the single objects that can be removed, before there is a scene",
    "segment": "find the labels that occur, and what moves",
    "choose": "say which classes and objects go",
    "reconstruct": "fit the semantic surfel scene with everything in it",
    "ground": "find the street's path and the ground, once for a scene",
    "instances": "find the listed objects among the scene's surfels",
    "remove": "take the chosen objects out and find what nobody ever saw",
    "inpaint": "fill frames in reversed time, the ground in street coordinates",
    "reoptimize": "teach the scene its empty state, write renders/ and frames/",
    "mesh": "fuse meshes before and after",
    "report": "measure and write the report page",
}


class _Parser(argparse.ArgumentParser):
    """Usage errors are one line and exit 2."""

    def error(self, message: str) -> Any:
        print(f"unveil: error: {message} (see {self.prog} --help)", file=sys.stderr)
        raise SystemExit(2)


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _ids(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in _names(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of numbers such as 3,7") from None


def _keyframes(text: str) -> tuple[str, ...]:
    names = () if text.strip() == "auto" else _names(text)
    if not names and text.strip() != "auto":
        raise argparse.ArgumentTypeError(f"{text!r} names no frames, as 3,7 would")
    return names


def _pixels(text: str) -> int | None:
    if text.strip() != "auto" and not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is no number of pixels, and not auto")
    return None if text.strip() == "auto" else int(text)


def _file_or_none(text: str) -> str | None:
    return None if text.strip() == "none" else text


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text!r} is no size such as 480x320")
    return int(width), int(height)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="unveil", description="The empty street from a drive.")
    parser.add_argument("--version", action="version", version=f"unveil {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, parser_class=_Parser, metavar="VERB")

    def common(p: argparse.ArgumentParser) -> None:
        p.add_argument("--json", action="store_true", help="JSON lines on standard output")
        p.add_argument("--debug", action="store_true", help="show tracebacks")
        p.add_argument("--end-with-stdin", action="store_true",
                       help="cancel when standard input closes: when the program that started this one ends")  # fmt: skip

    def networks(p: argparse.ArgumentParser, text: str, recorded: bool = False) -> None:
        p.add_argument(
            "--inpainter", default=argparse.SUPPRESS if recorded else "exemplar", metavar="NAME|FILE.onnx", help=text
        )
        p.add_argument("--reference-inpainter", default=argparse.SUPPRESS if recorded else None,
                       metavar="FILE.onnx|none", type=_file_or_none,
                       help="carries what was invented: image, mask and the frame that shows the place to image")  # fmt: skip

    def choices(p: argparse.ArgumentParser, recorded: bool = False) -> None:
        """The options of a run; on a workspace (``recorded``) what is not given stays as it was."""

        def add(name: str, default: Any, **options: Any) -> None:
            p.add_argument(name, default=argparse.SUPPRESS if recorded else default, **options)

        add("--remove", (), type=_names, metavar="CLASSES", help="classes or groups: vehicle,human,dynamic")
        add("--instances", (), type=_ids, metavar="IDS", help="single objects, as 3,7")
        add("--marked", None, metavar="FILE.json|none", type=_file_or_none,
            help="objects nobody labelled: a list of {id, class, centre, size, yaw} or {id, mattes: FOLDER}")  # fmt: skip
        add("--quality", "standard", choices=("draft", "standard", "high"))
        add("--device", "auto", choices=("auto", "cpu", "cuda"))
        add("--seed", 0, type=int)
        add("--max-side", None, type=_pixels, metavar="PIXELS|auto", help="reduce larger images to this side")
        add("--shadows", "auto", metavar="auto|off|AZIMUTH,ELEVATION",
            help="take shadows of what goes along, leave them, or say where the sun stands, in degrees")  # fmt: skip
        add("--movers", "auto", choices=("auto", "keep"),
            help="take what moves during the drive out of every frame, or treat it as if it stood")  # fmt: skip
        add("--iterations", None, type=int, metavar="N", help="steps of the reconstruction")
        add("--sh-degree", None, type=int, metavar="L", help="degree of colour by direction, 0 to 3")
        add("--splats", None, type=int, metavar="N", help="surfels at most")
        add("--no-adaptation", True, dest="adapt", action="store_false",
            help="take all that the quality allows, not only what the scene needs")  # fmt: skip
        networks(
            p,
            "for what is neither ground nor seen from anywhere: exemplar, telea, navier-stokes, shift-map, fsr, FILE.onnx",
            recorded,
        )
        add("--order", "reverse", choices=("reverse", "forward", "independent"),
            help="of the frames when holes are filled; for comparison")  # fmt: skip
        add("--keyframes", (), type=_keyframes, metavar="auto|N,N,...",
            help="frames that invent what nobody saw, by number or stem")  # fmt: skip

    p = verbs.add_parser("demo", help="unveil the sample street")
    p.add_argument("-o", "--output", type=Path, default=Path("demo_workspace"), metavar="WORKSPACE")
    choices(p)
    common(p)
    p = verbs.add_parser("run", help="from a drive to clean frames, meshes and a report")
    p.add_argument("drive", type=Path)
    p.add_argument("-o", "--output", type=Path, required=True, metavar="WORKSPACE")
    choices(p)
    common(p)
    p = verbs.add_parser("import", help="bring a drive into a workspace and list what could go")
    p.add_argument("drive", type=Path)
    p.add_argument("-o", "--output", type=Path, required=True, metavar="WORKSPACE")
    choices(p)
    common(p)
    for name, text in _VERBS.items():
        p = verbs.add_parser(name, help=text)
        p.add_argument("workspace", type=Path)
        choices(p, recorded=True)
        common(p)
    p = verbs.add_parser("status", help="which stages of a workspace are done, stale, or still to do")
    p.add_argument("workspace", type=Path)
    choices(p, recorded=True)
    common(p)
    p = verbs.add_parser("evaluate", help="compare a workspace with the true empty street, or with its own photographs")
    p.add_argument("workspace", type=Path)
    p.add_argument("--truth", type=Path, default=None, metavar="DIR")
    p.add_argument("--lpips", type=Path, default=None, metavar="FILE", help="your LPIPS network, TorchScript or ONNX")
    p.add_argument("--fid", type=Path, default=None, metavar="FILE", help="your network of features for FID, likewise")
    p.add_argument("--holdout-masks", action="store_true",
                   help="lay virtual cars over street that is seen, remove them, compare; takes a drive, too")  # fmt: skip
    p.add_argument("--cars", type=int, default=None, metavar="N", help="virtual cars (2)")
    p.add_argument("--quality", default=None, choices=("draft", "standard", "high"),
                   help="of the run with the virtual cars, by default the workspace's")  # fmt: skip
    p.add_argument("-o", "--output", type=Path, default=None, metavar="DIR",
                   help="of the run with the virtual cars, by default WORKSPACE_holdout")  # fmt: skip
    common(p)
    p = verbs.add_parser(
        "render", help="render the scene from free views: a path of cameras, or beside the drive's own"
    )
    p.add_argument("workspace", type=Path)
    p.add_argument("--state", default="empty", choices=("empty", "full"), help="the street without or with everything")
    p.add_argument("--path", type=Path, default=None, metavar="FILE",
                   help="cameras: transforms.json or nerfstudio's camera path; by default the drive's own")  # fmt: skip
    p.add_argument(
        "--beside", type=float, default=0.0, metavar="METRES", help="to the right of the path (left: negative)"
    )
    p.add_argument("--above", type=float, default=0.0, metavar="METRES", help="up from the path")
    p.add_argument("--planes", type=_names, default=("rgb",), metavar="PLANES", help="rgb,depth,normal,alpha,semantics")
    p.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    common(p)
    p = verbs.add_parser("export", help="write a mesh for another program: another format, fewer triangles")
    p.add_argument("workspace", type=Path)
    p.add_argument("--to", default=None, choices=("ply", "obj", "glb"), help="by default what FILE's suffix says")
    p.add_argument("--state", default="empty", choices=("empty", "full"), help="the street without or with everything")
    p.add_argument("--triangles", type=int, default=None, metavar="N", help="at most so many; all by default")
    p.add_argument("-o", "--output", type=Path, default=None, metavar="FILE", help="beside the meshes by default")
    common(p)
    p = verbs.add_parser("bench", help="measure the rasterizer, a training step, a reconstruction or whole runs")
    p.add_argument("what", choices=("raster", "step", "reconstruction", "pipeline"))
    p.add_argument("drive", type=Path, nargs="?", default=None, help="with a truth; the sample street by default")
    p.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    p.add_argument("--every", type=int, default=8, metavar="N", help="hold every n-th frame out (8)")
    p.add_argument(
        "--without", type=_names, default=(), metavar="LOSSES", help="losses to leave out, as normal,distortion"
    )
    p.add_argument(
        "--variant", default=None, metavar="NAME",
        help="fixed, soft_labels, ellipsoids, random_start, no_growth or no_pruning, for comparison",
    )  # fmt: skip
    p.add_argument("--salt", type=float, default=0.0, metavar="SHARE", help="wrong label pixels to put in, as 0.05")
    p.add_argument(
        "--rows", type=_names, default=(), metavar="NAMES", help="of the pipeline's baselines; all by default"
    )
    p.add_argument(
        "--scene", type=Path, default=None, metavar="WORKSPACE", help="where the rows' scene is, or is to be kept"
    )
    p.add_argument("--keep", type=Path, default=None, metavar="DIR", help="for the frames of each row")
    networks(p, "single-image inpainter of all rows")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("-o", "--output", type=Path, default=None, metavar="FILE", help="JSON; the plot goes beside it")
    p.add_argument(
        "--yardstick", type=Path, default=None, metavar="FOLDER", help="a C++ rasterizer to compile and compare"
    )
    p.add_argument("--quick", action="store_true", help="a small scene and few rounds, to see that it works")
    p.add_argument("--surfels", type=int, default=None, metavar="N", help="of the main table, or of the step")
    p.add_argument("--size", type=_size, default=None, metavar="WIDTHxHEIGHT")
    common(p)
    p = verbs.add_parser("doctor", help="what this machine has")
    common(p)
    return parser


def _settings(arguments: argparse.Namespace, recorded: Any = None) -> Any:
    """What the arguments say, over what is recorded or the defaults."""
    from unveil_core.pipeline.settings import RunSettings

    names = (
        "remove", "instances", "quality", "device", "seed", "max_side", "shadows", "inpainter", "order", "iterations",
        "sh_degree", "splats", "adapt", "keyframes", "movers", "reference_inpainter", "marked",
    )  # fmt: skip
    return replace(recorded or RunSettings(), **{n: getattr(arguments, n) for n in names if hasattr(arguments, n)})


def _sample_drive() -> Path:
    folder = Path(__file__).resolve().parents[2] / "sample_scenes" / "parked_street"
    if not (folder / "transforms.json").is_file():
        raise DriveError("the sample street is not there", path=folder, mend="run the demo from a source checkout")
    return folder


def _render(arguments: argparse.Namespace) -> int:
    import time

    from unveil_core.app.render_views import render_views
    from unveil_core.pipeline.console import reporting
    from unveil_core.workspace.workspace import Workspace

    with reporting(arguments.json) as reporter:

        def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
            reporter({
                "t": round(time.time(), 3), "stage": "render", "done": done, "total": total, "message": message,
                "level": "info", **metrics,
            })  # fmt: skip

        views = render_views(
            Workspace.open(arguments.workspace), arguments.output, state=arguments.state, path=arguments.path,
            beside=arguments.beside, above=arguments.above, planes=arguments.planes, progress=progress,
        )  # fmt: skip
    print(json.dumps({"folder": str(arguments.output), "views": views}) if arguments.json else arguments.output)
    return 0


def _run(arguments: argparse.Namespace) -> int:
    verb = arguments.verb
    if verb == "doctor":
        from unveil_core.app.doctor import examine

        found = examine()
        if arguments.json:
            print(json.dumps(found))
        else:
            for key, value in found.items():
                print(f"{key:<32} {value}")
        return 0 if found["ok"] else 1
    if verb == "bench":
        from unveil_core.bench.command import run_bench

        if arguments.what in ("reconstruction", "pipeline") and arguments.drive is None:
            arguments.drive = _sample_drive()
        return run_bench(arguments)
    from unveil_core.pipeline.console import reporting
    from unveil_core.pipeline.run import run, run_verb

    if verb in ("demo", "run", "import"):
        drive = _sample_drive() if verb == "demo" else arguments.drive
        settings = _settings(arguments)
        with reporting(arguments.json) as reporter:
            workspace = run(
                drive, arguments.output, settings, until="objects" if verb == "import" else None, reporter=reporter
            )
        if verb != "import":
            from unveil_core.report.summary import print_summary

            print_summary(workspace.root, sys.stderr if arguments.json else sys.stdout)
        return 0
    if verb == "evaluate" and arguments.holdout_masks:
        return _check_footage(arguments)
    if verb == "evaluate":
        for name in ("cars", "quality", "output"):
            if getattr(arguments, name) is not None:
                raise SettingsError(f"--{name} is for virtual cars only", mend="add --holdout-masks")
        from unveil_core.evaluate import run_evaluation
        from unveil_core.workspace.workspace import Workspace

        root = Workspace.open(arguments.workspace).root
        metrics = run_evaluation(root, arguments.truth, lpips=arguments.lpips, fid=arguments.fid)
        print(json.dumps(metrics, indent=1))
        return 0
    if verb == "render":
        return _render(arguments)
    if verb == "export":
        from unveil_core.app.export_mesh import export_mesh
        from unveil_core.workspace.workspace import Workspace

        path = export_mesh(
            Workspace.open(arguments.workspace), to=arguments.to, state=arguments.state, triangles=arguments.triangles,
            output=arguments.output,
        )  # fmt: skip
        print(json.dumps({"file": str(path)}) if arguments.json else path)
        return 0
    from unveil_core.pipeline.settings import RunSettings
    from unveil_core.workspace.workspace import Workspace

    settings = _settings(
        arguments, RunSettings.from_json(Workspace.open(arguments.workspace).state().get("settings", {}))
    )
    if verb == "status":
        return _status(arguments, settings)
    with reporting(arguments.json) as reporter:
        run_verb(verb, arguments.workspace, settings, reporter=reporter)
    return 0


def _status(arguments: argparse.Namespace, settings: Any) -> int:
    from unveil_core.pipeline.status import stage_states
    from unveil_core.workspace.workspace import Workspace

    states = stage_states(Workspace.open(arguments.workspace), settings)
    if arguments.json:
        print(json.dumps({"stages": states}))
    else:
        for name, state in states.items():
            print(f"{name:<12} {state}")
    return 0


def _check_footage(arguments: argparse.Namespace) -> int:
    from unveil_core.app.holdout_check import CARS, check_footage, holdout_lines
    from unveil_core.pipeline.console import reporting
    from unveil_core.pipeline.settings import RunSettings

    for name in ("truth", "lpips", "fid"):
        if getattr(arguments, name) is not None:
            raise SettingsError(f"--{name} is not used with --holdout-masks", mend="leave one of them out")
    with reporting(arguments.json) as reporter:
        found = check_footage(
            arguments.workspace, arguments.output, cars=CARS if arguments.cars is None else arguments.cars,
            settings=RunSettings(quality=arguments.quality or "standard"), quality=arguments.quality, reporter=reporter,
        )  # fmt: skip
    print(json.dumps({"holdout": found}) if arguments.json else "\n".join(holdout_lines(found)))
    return 0


def main(argv: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0) if isinstance(stop.code, int | None) else 2
    try:
        if arguments.end_with_stdin:
            end_with_stdin()
        return _run(arguments)
    except UnveilError as error:
        print(f"unveil: error: {error}", file=sys.stderr)
        return 2
    except DiskFullError as error:
        print(f"unveil: failed: {error}", file=sys.stderr)
        return 1
    except (Cancelled, KeyboardInterrupt):
        print("unveil: cancelled; run the same command again to go on", file=sys.stderr)
        return 130
    except Exception as error:
        if arguments.debug:
            raise
        where = "the traceback is in the workspace's events.jsonl; --debug shows it"
        print(f"unveil: failed: {type(error).__name__}: {error} ({where})", file=sys.stderr)
        return 1


if __name__ == "__main__":
    raise SystemExit(main())
