"""Readers of the text files of a workspace, of a farm and of this machine, each with small sound files."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.drives.tiny_drive import make_tiny_drive
from tests.fuzz.reader import Opened, Reader, Wrong
from tests.fuzz.sound import sound_drive, sound_names
from unveil_core.drives.exposure import Exposure, Exposures, read_exposures, write_exposures
from unveil_core.drives.formats.transforms_json import read_transforms_json
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive, localized
from unveil_core.evaluate.detail.objects import read_object_names
from unveil_core.farm.manifest import Batch, BatchDrive, Task, read_batch
from unveil_core.farm.state import TaskState, note_state, seen_state
from unveil_core.farm.template import TEMPLATES
from unveil_core.forecast.machine import Machine, this_machine
from unveil_core.labelling.networks.settings import read_settings
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.status import stage_states
from unveil_core.pipeline.up_to_date import Digests
from unveil_core.report.summary import print_summary
from unveil_core.semantics.classes import LabelSet
from unveil_core.semantics.labels import SceneLabels
from unveil_core.workspace.assumptions import recorded_assumptions
from unveil_core.workspace.files import known_objects, load_labels, load_selection
from unveil_core.workspace.journal import PARTIAL, recover
from unveil_core.workspace.movers import read_moving
from unveil_core.workspace.workspace import Workspace

__all__ = ["METRICS", "READERS", "state_of_a_run"]

HASH = "5f0c7127af4d86e1b6d0d0ea2d9a9a3c"
METRICS: dict[str, Any] = {
    "truth": {
        "frames": 4,
        "regions": {
            "removed": {
                "methods": {
                    "ours": {"psnr": 31.5, "ssim": 0.95, "frames": 4, "gradient": 0.9, "residue": 0.01},
                    "telea": {"psnr": 25.0, "ssim": 0.9, "frames": 4},
                }
            },
            "unseen": {"methods": {"ours": {"psnr": None, "ssim": None}}},
        },
        "residue_by_object": [{"id": 3, "class": "car", "left": 5, "residue": 0.01}],
        "unobserved_mask_iou": 0.8,
    },
    "free_views": {"regions": {"free_removed": {"psnr": 30.0, "ssim": 0.9}}, "tracks": {}},
    "flicker": {"methods": {"ours": {"absolute": 1.5}}},
    "coverage": {"removed": 0.1, "unobserved_of_removed": 0.3},
    "untouched": {"max": 0},
    "certainty": {"certain": 0.8, "certain_right": 0.97},
    "per_frame": [{"camera": "camera", "frame": "00", "removed_pixels": 12, "ours": 31.0}],
}


def state_of_a_run() -> dict[str, Any]:
    """A workspace.json."""
    held = {"name": "rigid", "holds": True, "found": "0.1 m", "instead": "less"}
    done = {"status": "done", "seconds": 1.5, "peak_memory_mb": 300, "input_hash": HASH, "follows": {"import": HASH}}
    stages = {
        "import": {"status": "done", "seconds": 0.2, "input_hash": HASH, "assumptions": [held]},
        "segment": {**done, "movers": 2},
        "choose": {**done, "settings": {"remove": ["car"]}},
        "remove": {**done, "status": "failed", "attempt": {"settings": {"seed": 1}}},
    }
    settings = RunSettings(remove=("car",)).to_json()
    return {"format": 1, "drive": "/nowhere/drive", "settings": settings, "versions": {"unveil": "1"}, "stages": stages}


def written(path: Path, content: object) -> Path:
    """A JSON file; its folder is made if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    return path


def _state(folder: Path) -> Opened:
    path = written(folder / "workspace.json", state_of_a_run())
    workspace = Workspace(folder)

    def read(_: Path) -> None:
        recorded_assumptions(workspace.state().get("stages", {}))
        stage_states(workspace)

    return Opened((path,), read)


def _selection(folder: Path) -> Opened:
    scene = SceneLabels(LabelSet.cityscapes((0, 10, 13)), "semantics", ("car",), (3,), (5, 6, 7))
    labels = written(folder / "labels.json", scene.labels_json())
    chosen = written(folder / "selection.json", scene.selection_json())
    workspace = Workspace(folder)

    def read(_: Path) -> None:
        for found in (load_labels(workspace), load_selection(workspace)):
            found.labels.compact(np.zeros((2, 2), np.uint8))
            if not len(found.labels.names) == len(found.labels.disk_ids) == len(found.pixel_counts):
                raise Wrong("labels of other numbers than names are taken")
            if not all(isinstance(n, str) for n in (*found.labels.names, *found.removed)):
                raise Wrong("a name that is no text is taken")

    return Opened((labels, chosen), read)


def _objects(folder: Path) -> Opened:
    one = {"id": 3, "class": "car", "source": "images", "removed": True}
    listed = written(folder / "objects.json", {"classes": [], "objects": [one, {**one, "id": 4}]})
    found = written(folder / "instances.json", [{**one, "thumbnail": "thumbnails/3.png"}, {"id": 5}])
    moving = written(folder / "movers/movers.json", [{"number": 1, "class": "car", "id": 3, "frames": []}])
    workspace = Workspace(folder)

    def read(_: Path) -> None:
        known_objects(workspace)
        read_object_names(folder)
        read_moving(folder)

    return Opened((listed, found, moving), read)


def _exposure(folder: Path) -> Opened:
    path = folder / "exposure.json"
    write_exposures(Exposures({("front", "0"): Exposure(np.full(3, 1.1), np.full(3, 0.02))}, {"gain": 0.1}), path)

    def read(file: Path) -> None:
        for exposure in read_exposures(file).known.values():
            if not np.isfinite([exposure.gain, exposure.bias]).all() or exposure.gain.min() <= 0:
                raise Wrong("an exposure that is none is taken")

    return Opened((path,), read)


def _imported(folder: Path) -> Opened:
    import_drive(localized(read_transforms_json(make_tiny_drive(folder / "source"))), folder / "drive")
    path = folder / "drive/cameras.json"
    content = json.loads(path.read_text())
    box = {"id": 3, "class": "car", "centre": [5.0, 1.0, 0.5], "size": [4.0, 2.0, 1.5], "yaw": 0.2}
    lens = {"model": "OPENCV", "coefficients": [0.1, 0, 0, 0, 0, 0, 0, 0]}
    footage = {"image": "footage/a.png", "width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 32, "cy": 24}
    content["frames"] = content["frames"][:2]
    content["frames"][0] |= {"boxes": [box], "footage": {**footage, "distortion": lens}, "timestamp": 0.5}
    written(path, content)

    def read(_: Path) -> None:
        drive = sound_drive(read_imported(folder / "drive", points=False))
        sound_names(drive, folder / "drive")

    return Opened((path,), read)


def _journal(folder: Path) -> Opened:
    """The folder has what must stay: ``kept`` beside the workspace, and in it."""
    root = folder / "workspace"
    path = root / ".journal.json"
    record = {"status": "done", "input_hash": HASH}
    entry = {"stage": "mesh", "partial": f"{PARTIAL}mesh", "outputs": ["meshes", "a/b.json"], "record": record}
    state = state_of_a_run()
    kept = [written(place / "kept.json", 1) for place in (folder, root)]
    workspace = Workspace(root)
    written(path, entry)
    written(workspace.workspace_json, state)

    def read(file: Path) -> None:
        for name in ("meshes/new.ply", "a/b.json"):
            written(root / f"{PARTIAL}mesh" / name, 2)
        written(workspace.workspace_json, state)
        recover(workspace)
        if not all(p.is_file() for p in kept):
            raise Wrong("a file that no stage wrote is removed")

    return Opened((path,), read)


def _log(folder: Path) -> Opened:
    workspace = Workspace(folder)
    folder.mkdir(parents=True)
    for k in range(3):
        workspace.log("mesh", f"step {k}", done=k, total=3, loss=0.5)
    path = written(folder / ".digests.json", {"a.json": [1, 2, 3, 4, HASH], "b": [3, 4, 5, 6, HASH]})
    (folder / "a.json").write_text("1")

    def read(_: Path) -> None:
        if not all(isinstance(event, dict) for event in workspace.events()):
            raise Wrong("an event that is none is taken")
        digests = Digests(workspace)
        digests.of(folder / "a.json")
        digests.save()

    return Opened((workspace.events_jsonl, path), read)


def _batch(folder: Path) -> Opened:
    drives = (BatchDrive("one", "/nowhere/one", str(folder / "one"), 9, 2, 500, 60),)
    first = Task("one.prepare", "one", "prepare", None, ("run", "/nowhere/one", "--until", "import"), ())
    block = Task("one.inpaint.0000", "one", "inpaint", 0, ("run-block", "one", "inpaint", "0"), (first.id,))
    batch = Batch(folder, drives, (first, block))
    batch.save()
    note_state(batch, first, TaskState("done", 1, 2.5, "done", "host", 12))
    note_state(batch, block, TaskState("running", 2))
    state = written(folder / "one/workspace.json", state_of_a_run())

    def read(_: Path) -> None:
        found = read_batch(folder)
        for task in found.tasks:
            noted = seen_state(found, task)
            if not isinstance(noted.status, str) or not isinstance(noted.tries, int):
                raise Wrong("a state of a task that is none is taken")
        for _, text in TEMPLATES.values():
            text(found)

    tasks = [folder / "tasks" / f"{t.id}.json" for t in batch.tasks]
    return Opened((folder / "batch.json", *tasks, state), read)


def _timings(folder: Path) -> Opened:
    folder.mkdir(parents=True)
    machine = this_machine(folder)
    Machine(machine.name, machine.path, 1.5, {"draft.mesh": [1.0, 1.2], "draft.import": [0.9]}).save()

    def read(_: Path) -> None:
        found = this_machine(folder)
        if not 0 < found.multiple("draft", "mesh") < 1000:
            raise Wrong("a speed that is none is taken")
        found.save()

    assert machine.path is not None
    return Opened((machine.path,), read)


def _network(folder: Path) -> Opened:
    folder.mkdir(parents=True)
    path = folder / "network.toml"
    path.write_text(
        'kind = "logits"\noutput = "out"\nclasses = ["road", "car"]\nwhite = 255.0\nmean = [0.4, 0.4, 0.4]\n'
        'std = [0.2, 0.2, 0.2]\nchannels = "BGR"\nwindow = [512, 1024]\nshort_side = 512\nscore = 0.2\n'
        '[map]\n"auto" = "car"\n'
    )
    return Opened((path,), lambda p: read_settings(p.with_suffix(".onnx")))


def _summary(folder: Path) -> Opened:
    metrics = written(folder / "metrics.json", METRICS)
    state = written(folder / "workspace.json", state_of_a_run())
    return Opened((metrics, state), lambda _: print_summary(folder, io.StringIO()))


READERS = (
    Reader("workspace.json", "text", _state),
    Reader("labels.json, selection.json", "text", _selection),
    Reader("objects.json, instances.json, movers.json", "text", _objects),
    Reader("exposure.json", "text", _exposure),
    Reader("cameras.json", "text", _imported),
    Reader("journal of a stage", "text", _journal),
    Reader("events.jsonl, digests", "text", _log),
    Reader("batch and tasks of a farm", "text", _batch),
    Reader("timings of the machine", "text", _timings),
    Reader("settings of a network", "text", _network),
    Reader("figures of a run (closing lines)", "text", _summary),
)
