"""Picking a drive: what cannot be imported is one line, what is asked reaches the command, what a workspace was made with stays."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from conftest import outside


class Layout:
    """Takes everything that is drawn."""

    def __init__(self, said: list[str]) -> None:
        self.said = said
        self.url = self.module = ""

    def __getattr__(self, name: str):  # type: ignore[no-untyped-def]
        def draw(*arguments: object, **words: object) -> Layout:
            self.said.append(str(words.get("text") or (arguments[-1] if arguments else "")))
            return self

        return draw


def drawn(addon, found) -> str:  # type: ignore[no-untyped-def]
    said: list[str] = []
    addon.module("work.opening.checked_drawing").draw_checked(Layout(said), found, "street")
    return "\n".join(said)


def checked(addon, drive: Path):  # type: ignore[no-untyped-def]
    import bpy

    done = bpy.ops.unveil.check_drive(filepath=str(drive))
    assert done == {"FINISHED"}
    return addon.module("work.opening.operators_open_drive")._checked


def test_a_drive_is_looked_at_in_the_workers_process(addon, scene, street: Path) -> None:
    found = checked(addon, street)
    assert (found.drive, found.error, found.asks) == (str(street), "", False)
    facts = dict(found.facts)
    assert facts["frames"] == "8" and facts["size"] == "128 × 80" and found.assumed
    assert Path(found.page).read_text().startswith("<!") and not (street.parent / "check_street.html").exists()
    said = drawn(addon, found)
    assert "128 × 80" in said and found.assumed[0][:30] in said


def test_options_of_the_command_are_called_as_the_dialogs_fields(addon) -> None:
    in_words = addon.module("work.opening.checked").in_words
    assert in_words("up is taken as z; --up decides") == "Up is taken as z; Up Axis decides"
    assert in_words("scale is a guess (give --scale 0.3)") == "Scale is a guess (give Units per Metre 0.3)"
    for line in ("/drives/a--scale.json: --other", "drive/x.json: Not found", ""):
        assert in_words(line) == line


def test_what_is_no_drive_is_one_line_that_the_dialog_shows(addon, scene, tmp_path: Path) -> None:
    import bpy

    (tmp_path / "transforms.json").write_text('{"frames": []}')
    with pytest.raises(RuntimeError, match=r"transforms\.json"):
        bpy.ops.unveil.check_drive(filepath=str(tmp_path / "transforms.json"))
    found = addon.module("work.opening.operators_open_drive")._checked
    assert found.error.count("\n") == 0 and "transforms.json" in found.error and not found.lacks_python
    assert found.error[:40] in drawn(addon, found).replace("\n", " ")


@pytest.mark.parametrize("operator", ["open_drive", "check_drive", "import_street", "import_drive"])
def test_what_is_not_there_is_one_line_and_no_traceback(addon, scene, tmp_path: Path, operator: str) -> None:
    import bpy

    with pytest.raises(RuntimeError) as told:
        getattr(bpy.ops.unveil, operator)(filepath=str(tmp_path / "nowhere/transforms.json"))
    assert str(told.value).strip().count("\n") == 0 and "Traceback" not in str(told.value)
    assert "nowhere" in str(told.value)


def test_without_a_python_the_dialog_leads_to_the_preferences(addon, scene, street: Path) -> None:
    import bpy

    chosen = addon.module("work.preferences").preferences(bpy.context)
    chosen.python = "/nowhere/python"
    try:
        with pytest.raises(RuntimeError, match="^Error: No Python with unveil was found"):
            bpy.ops.unveil.open_drive(filepath=str(street))
        opening = addon.module("work.opening.checked")
        state = addon.module("worker.job_state").JobState(status="failed", error="No Python with unveil was found")
        assert "Open the Preferences" in drawn(addon, opening.checked_of(street, state))
    finally:
        chosen.python = ""


def test_a_folder_in_which_nothing_is_picked_is_that_folder(addon, tmp_path: Path) -> None:
    """Blender proposes the .blend's name there."""
    drive_of = addon.module("work.opening.operators_open_drive").drive_of
    (tmp_path / "sparse/0").mkdir(parents=True)
    (tmp_path / "sparse/0/cameras.bin").touch()
    (tmp_path / "transforms.json").touch()
    assert drive_of(tmp_path / "street.blend") == tmp_path
    assert drive_of(tmp_path / "sparse/0/cameras.bin") == tmp_path
    assert drive_of(tmp_path / "transforms.json") == tmp_path / "transforms.json"
    assert drive_of(tmp_path / "nowhere/street.blend") == tmp_path / "nowhere/street.blend"


def test_what_the_dialog_asks_reaches_the_command(addon, scene, street: Path, tmp_path: Path) -> None:
    import bpy

    shutil.copytree(street.parent / "semantics", tmp_path / "labels")
    given = {"scale": 2.0, "up": "z", "labels": str(tmp_path / "labels"), "sweeps": "all", "every_nth": 2}
    place = tmp_path / "ws"
    assert bpy.ops.unveil.open_drive(filepath=str(street), workspace=str(place), **given) == {"FINISHED"}
    made = json.loads((place / "workspace.json").read_text())["settings"]
    assert (made["scale"], made["up"], made["frames"]) == (2.0, "z", "::2")
    assert made["labels"] == str(tmp_path / "labels")
    dialog = addon.module("work.opening.dialog_settings")
    asked = bpy.ops.unveil.import_street.get_rna_type().properties
    assert {"scene", "scale", "camera_height", "up", "sweeps", "labels", "segmenter"} <= set(dialog.ASKED)
    assert all(name in asked for name in dialog.ASKED if name != "frames")


def test_the_preferences_name_the_usual_segmenter(addon, scene, tmp_path: Path) -> None:
    import bpy

    chosen = addon.module("work.preferences").preferences(bpy.context)
    dialog = addon.module("work.opening.dialog_settings").DialogSettings
    chosen.segmenter = str(tmp_path / "streets.onnx")

    class Asked(dialog):  # type: ignore[misc, valid-type]
        every_nth, segmenter = 1, ""

        class properties:
            is_property_set = staticmethod(lambda name: False)

    try:
        asked = Asked()
        asked.fill(bpy.context, scene.unveil)
        assert asked.segmenter == chosen.segmenter
        scene.unveil.segmenter = "/of/the/scene.onnx"
        asked.fill(bpy.context, scene.unveil)
        assert asked.segmenter == "/of/the/scene.onnx"
    finally:
        chosen.segmenter = ""


def test_what_a_workspace_was_made_with_stays_when_its_drive_is_imported(
    addon, scene, street: Path, tmp_path: Path
) -> None:
    """Made elsewhere, say on a farm: the import finds it beside the drive, and no stage repeats."""
    import bpy

    drive = shutil.copytree(street.parent, tmp_path / "street") / "transforms.json"
    place = tmp_path / "street_unveiled"
    options = ["--scale=1.0123456789", f"--labels={drive.parent / 'semantics'}", "--up=z", "--quality=draft"]
    outside("-m", "unveil_core", "import", str(drive), "-o", str(place), *options)
    made = json.loads((place / "workspace.json").read_text())["settings"]
    before = len((place / "events.jsonl").read_text().splitlines())
    assert bpy.ops.unveil.open_drive(filepath=str(drive)) == {"FINISHED"}
    assert json.loads((place / "workspace.json").read_text())["settings"] == made
    told = [json.loads(line) for line in (place / "events.jsonl").read_text().splitlines()[before:]]
    assert not [event for event in told if event["message"] == "started"]
    assert scene.unveil.quality == "draft" and scene.unveil.up == "z"
    states = addon.module("work.stage_states").stage_states(scene).stages
    assert {states[name].state for name in ("import", "objects")} == {"done"}
