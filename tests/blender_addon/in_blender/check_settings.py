"""Settings parity: a workspace that the command made with every option, opened here and run again, repeats no stage."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from conftest import outside

OPTIONS = [
    "--remove=car", "--per-object=1:grow=4", "--shadows=135.123456789,40.5", "--movers=keep", "--frames=-6:", "--cameras=all",
    "--label-classes=cityscapes", "--mask-removes=white", "--sweeps=2", "--pose-convention=opengl", "--scale=1.0123456789",
    "--up=z", "--poses=given", "--quality=draft", "--work-side=96", "--device=cpu", "--memory=512M", "--seed=7",
    "--iterations=60", "--splats=3000", "--sh-degree=0", "--no-adaptation", "--inpainter=telea", "--order=forward", "--keyframes=3",
    "--baselines", "--without=quilting", "--without=layered_fill",
]  # fmt: skip
"""All that a drive of one scene and one model takes; labels, instance maps, marks and corrections are added below."""


@pytest.fixture
def imported(street: Path, tmp_path: Path) -> Path:
    """Imported by the command, as on a farm."""
    given = tmp_path / "given"
    (given / "ids").mkdir(parents=True)
    shutil.copytree(street.parent / "semantics", given / "labels")
    program = (
        "import sys, pathlib, cv2, numpy as np\n"
        "for p in pathlib.Path(sys.argv[1]).glob('*.png'):\n"
        "    cv2.imwrite(sys.argv[2] + '/' + p.name, np.where(cv2.imread(str(p), -1) == 13, 1, 0).astype(np.uint16))"
    )
    outside("-c", program, str(given / "labels"), str(given / "ids"))
    workspace = tmp_path / "farm"
    box = {"id": 1001, "class": "pole", "centre": [20.0, 3.0, 0.7], "size": [0.5, 0.5, 1.4], "yaw": 0.3}
    (given / "m.json").write_text(json.dumps([box]))
    (given / "c.json").write_text("[]")
    options = [f"--labels={given / 'labels'}", f"--instance-maps={given / 'ids'}", "--instances=1,1001"]
    options += [f"--marked={given / 'm.json'}", f"--corrections={given / 'c.json'}"]
    outside("-m", "unveil_core", "run", str(street), "-o", str(workspace), "--until", "choose", *OPTIONS, *options)
    return workspace


def events(workspace: Path) -> list[tuple[str, str]]:
    lines = (workspace / "events.jsonl").read_text().splitlines()
    return [(event["stage"], event["message"]) for event in map(json.loads, lines)]


def test_no_stage_repeats(addon, scene, imported: Path) -> None:  # type: ignore[no-untyped-def]
    import bpy

    made = json.loads((imported / "workspace.json").read_text())["settings"]
    usual = {"scene", "model", "segmenter", "camera_height", "reference_inpainter"}
    table = addon.module("formats.table.run_settings")
    assert {s.name for s in table.SHOWN if made[s.name] == s.default} <= usual
    bpy.ops.unveil.load_workspace(directory=str(imported))
    states = addon.module("work.stage_states").stage_states(scene).stages
    assert {states[name].state for name in ("import", "objects", "segment", "choose")} == {"done"}
    before = len(events(imported))
    for stage in ("import", "segment", "choose"):
        assert bpy.ops.unveil.stage(stage=stage) == {"FINISHED"}
    assert json.loads((imported / "workspace.json").read_text())["settings"] == made
    told = events(imported)[before:]
    assert [stage for stage, message in told if message == "started"] == []
    assert {stage for stage, message in told if message == "up to date"} == {"import", "objects", "segment", "choose"}
    scene.unveil_selection.objects[0].grow = 9  # what is changed counts
    assert "1:grow=9" in " ".join(addon.module("choice.selection").arguments(scene))
    scene.unveil.scale = 1.5
    assert addon.module("work.stage_states").stage_states(scene).stages["import"].changed == ("scale",)


def test_a_folder_that_is_typed_brings_its_settings(addon, scene, imported: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    settings = scene.unveil
    made = json.loads((imported / "workspace.json").read_text())
    settings.results_folder = str(tmp_path / "nothing")
    assert settings.workspace == settings.results_folder == str(tmp_path / "nothing") and settings.quality == "standard"
    settings.results_folder = str(imported)
    assert (settings.quality, settings.iterations, settings.drive) == ("draft", 60, made["drive"])
    states = addon.module("work.stage_states").stage_states(scene).stages
    assert states["import"].state == "done"  # what is chosen comes when the results are opened
    settings.quality = "high"
    settings.workspace = str(imported)  # by a script, as after a run: what was changed meanwhile stays
    assert settings.quality == "high"
    settings.drive = str(tmp_path)  # another drive
    settings.results_folder = str(imported)
    assert settings.quality == "high" and settings.drive == str(tmp_path)


def test_every_setting_is_a_property_and_shown(addon, scene) -> None:  # type: ignore[no-untyped-def]
    table = addon.module("formats.table.run_settings")
    for setting in table.SHOWN:
        assert getattr(scene.unveil, setting.name) == setting.start or setting.shape == "number", setting.name
        assert scene.unveil.bl_rna.properties[setting.name].description
    from check_run import drawn

    run, reading = (getattr(addon.module("ui.panel_run"), f"UNVEIL_PT_{name}") for name in ("run", "reading"))
    basic, advanced = ({s.name for s in settings} for settings in (table.BASIC, table.ADVANCED))
    shown = set(drawn(run)) | set(drawn(reading))
    assert basic <= shown and not advanced & shown
    scene.unveil.show_more = True
    assert advanced <= set(drawn(run))
    scene.unveil.sh_degree = 0
    arguments = addon.module("worker.run_arguments").settings_arguments(scene.unveil)
    assert "--sh-degree=0" in arguments and "--scale=auto" in arguments and "--adaptation" in arguments
