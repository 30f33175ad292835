"""Looking at a result: pictures compared, frames by doubt, paint from other frames, what leads on, menus and delivery."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from check_run import drawn


@pytest.fixture
def street_scene(scene, workspace: Path):  # type: ignore[no-untyped-def]
    """The scene with a finished workspace."""
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    return scene


def test_two_pictures_of_a_frame_are_compared(addon, street_scene, workspace: Path) -> None:
    import bpy

    compared, shown = addon.module("scene.overlays.compared"), street_scene.unveil_view
    assert compared.pictures_compared(street_scene) is None
    shown.compare = "WIPE"
    assert compared.kinds_compared(street_scene) == ("clean", "original")
    street_scene.frame_set(street_scene.frame_start + 2)
    one, other = compared.pictures_compared(street_scene)
    assert Path(one.filepath).read_bytes() == sorted((workspace / "frames/camera").glob("*.png"))[2].read_bytes()
    assert (
        Path(other.filepath).name
        == Path(addon.module("scene.images.plates").files_of(street_scene.camera, "original")[2]).name
    )
    street_scene.frame_set(street_scene.frame_end + 50)  # beyond the end the last picture stays
    assert Path(compared.pictures_compared(street_scene)[0].filepath).read_bytes() == (
        sorted((workspace / "frames/camera").glob("*.png"))[-1].read_bytes()
    )
    shown.compare = "ORIGIN"
    assert compared.kinds_compared(street_scene) == ("clean", "provenance")
    _, origins = compared.pictures_compared(street_scene)
    pixels = np.empty(origins.size[0] * origins.size[1] * 4, np.float32)
    origins.pixels.foreach_get(pixels)
    tones = {tuple(np.round(p * 255).astype(int)) for p in pixels.reshape(-1, 4)[:, :3]}
    colors = addon.module("formats.sequences").ORIGIN_COLORS
    assert len(tones) > 1 and tones <= {tuple(c) for c in colors}
    shown.compare = "NONE"
    assert compared.pictures_compared(street_scene) is None
    shown.compare, shown.compare_with = "DIFFERENCE", "preview"  # there is none
    assert compared.pictures_compared(street_scene) is None
    part = addon.module("scene.overlays.drawn_pictures").part_drawn
    assert part("WIPE", 0.3) == (0.3, 1.0) and part("DIFFERENCE", 0.3) == (0.0, 1.0)
    assert len([i for i in bpy.data.images if i.name.startswith("Unveil Compare")]) == 2


def test_versions_are_kept_side_by_side(addon, street_scene, workspace: Path) -> None:
    import bpy

    compared = addon.module("scene.overlays.compared")
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.unveil.compare_version()
    first = sorted((workspace / "frames/camera").glob("*.png"))
    before = first[1].read_bytes()
    assert bpy.ops.unveil.keep_version() == {"FINISHED"}
    first[1].write_bytes(first[0].read_bytes())  # another result
    bpy.ops.unveil.load_workspace()
    assert bpy.ops.unveil.keep_version() == {"FINISHED"}
    street_scene.frame_set(street_scene.frame_start + 1)
    for number, content in ((1, before), (2, first[0].read_bytes())):
        assert bpy.ops.unveil.compare_version(number=number) == {"FINISHED"}
        assert compared.kinds_compared(street_scene) == ("clean", "kept")
        now, kept = compared.pictures_compared(street_scene)
        assert Path(kept.filepath).read_bytes() == content
        assert Path(now.filepath).read_bytes() == first[0].read_bytes()
    with pytest.raises(RuntimeError, match="keeps no version 7"):
        bpy.ops.unveil.compare_version(number=7)
    said = drawn(addon.module("ui.panel_results").UNVEIL_PT_results)
    assert {"v1", "v2"} <= set(said)


def test_the_line_of_a_wipe_is_dragged(addon) -> None:
    wipe, frame = addon.module("scene.overlays.wipe_gizmo"), (100.0, 50.0, 300.0, 150.0)
    assert wipe.is_on_line((205, 60), frame, 0.5, 8) and not wipe.is_on_line((210, 60), frame, 0.5, 8)
    assert not wipe.is_on_line((200, 40), frame, 0.5, 8)  # above and below the picture there is no line
    assert [wipe.share_at(x, frame) for x in (0, 100, 250, 999)] == [0.0, 0.0, 0.75, 1.0]


def test_the_most_doubtful_frames_come_first(addon, street_scene, workspace: Path, capfd) -> None:
    import bpy

    names = [p.stem for p in sorted((workspace / "frames/camera").glob("*.png"))]
    doubts = [5, 0, 90, 40, 0, 0, 0, 0]
    document = json.loads((workspace / "metrics.json").read_text())
    document["per_frame"] = [
        {"camera": "camera", "frame": name, "unobserved_pixels": d, "removed_pixels": 100}
        for name, d in zip(names, doubts, strict=True)
    ]
    (workspace / "metrics.json").write_text(json.dumps(document))
    start, seen = street_scene.frame_start, []
    for _ in range(4):
        assert bpy.ops.unveil.next_doubtful() == {"FINISHED"}
        seen.append(street_scene.frame_current - start)
    assert seen == [2, 3, 0, 2]  # and from the start again
    assert "90 % of what was removed is made up" in capfd.readouterr().out
    bpy.ops.unveil.next_doubtful()
    bpy.ops.unveil.next_doubtful(again=True)
    assert street_scene.frame_current - start == 2
    (workspace / "metrics.json").write_text("{")
    with pytest.raises(RuntimeError, match=r"metrics\.json"):
        bpy.ops.unveil.next_doubtful()


def test_one_step_leads_to_the_next(addon, scene, workspace: Path, monkeypatch) -> None:
    import bpy

    next_step = addon.module("ui.next_step").next_step
    assert next_step(bpy.context).operator == "unveil.open_drive"
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert next_step(bpy.context).operator == "unveil.next_doubtful"
    collection = addon.module("scene.view").shown_drive(scene)
    bpy.ops.unveil.choose(which="NONE")
    step = next_step(bpy.context)
    assert (step.operator, step.options) == ("unveil.choose", {"which": "MOVABLE"})
    assert bpy.ops.unveil.choose(**step.options) == {"FINISHED"}
    bpy.ops.unveil.next_doubtful()
    assert next_step(bpy.context).operator == "unveil.plates"
    assert bpy.ops.unveil.plates() == {"FINISHED"}
    assert next_step(bpy.context).operator == "unveil.set_up_cg"
    assert bpy.ops.unveil.set_up_cg(shadows=False) == {"FINISHED"}
    assert next_step(bpy.context).operator == "render.render"
    # What is changed comes before all that; figures of a new run are looked at anew.
    scene.unveil_selection.objects[0].grow = 9
    step = next_step(bpy.context)
    assert step.operator == "unveil.run" and step.said.startswith("Changed Since")
    scene.unveil_selection.objects[0].grow = 0
    assert next_step(bpy.context).operator == "render.render"
    collection["unveil_figures"] = "another run"
    assert next_step(bpy.context).operator == "unveil.next_doubtful"
    # A Python is asked for where one is needed, and not before.
    monkeypatch.setattr(addon.module("ui.telling.python_state"), "is_missing", lambda context: True)
    assert next_step(bpy.context).operator == "unveil.next_doubtful"
    scene.unveil_selection.objects[0].grow = 9
    assert next_step(bpy.context).operator == "unveil.show_preferences"


def test_paint_is_taken_from_another_frame(addon, street_scene, workspace: Path) -> None:
    import bpy

    street_scene.frame_set(street_scene.frame_start + 1)
    assert bpy.ops.unveil.clone_from(offset=3, kind="clean") == {"FINISHED"}
    image = bpy.context.tool_settings.image_paint.clone_image
    assert Path(image.filepath).read_bytes() == sorted((workspace / "frames/camera").glob("*.png"))[4].read_bytes()
    assert bpy.ops.unveil.clone_from(offset=-1, kind="original") == {"FINISHED"}
    assert bpy.context.tool_settings.image_paint.clone_image == image and "Unveil Clone Source" in image.name


def test_results_are_files_at_one_click(addon, street_scene, workspace: Path) -> None:
    import bpy

    with pytest.raises(TypeError):
        bpy.ops.unveil.deliver(what="dwg")
    assert bpy.ops.unveil.deliver(what="glb") == {"FINISHED"}
    assert list((workspace / "exports/glb").rglob("*.glb"))
    assert bpy.ops.unveil.deliver(what="splat-ply") == {"FINISHED"}
    assert list((workspace / "exports/splat-ply").rglob("*.ply"))


def test_all_of_the_sidebar_is_in_the_menu(addon, street_scene) -> None:
    """Every operator of the panels, and each can be found: it has a label in Title Case and a tooltip."""
    import bpy

    classes = [cls for name in MODULES_WITH_PANELS for cls in addon.module(name).CLASSES]
    panels = [
        cls for cls in classes if issubclass(cls, bpy.types.Panel) and getattr(cls, "poll", lambda _: True)(bpy.context)
    ]
    assert len(panels) > 8
    there = {text for panel in panels for text in drawn(panel) if text.startswith("unveil.")}
    menus = {
        text for cls in addon.module("ui.entries.menu").CLASSES for text in drawn(cls) if text.startswith("unveil.")
    }
    rows = {  # of one row of a list or of a job, or of what is to be installed
        *("unveil.stage", "unveil.go_to_object", "unveil.toggle_object", "unveil.remove_mark", "unveil.look_through"),
        *("unveil.import_drive", "unveil.forget_fix", "unveil.go_to_fix", "unveil.cancel", "unveil.dismiss"),
    }
    assert there - rows <= menus and len(there) > 20
    small = {"a", "an", "and", "as", "by", "for", "from", "in", "of", "or", "the", "through", "to", "with", "without"}
    for name in sorted(there | menus):
        kind = getattr(bpy.ops.unveil, name.removeprefix("unveil.")).get_rna_type()
        assert kind.description, name
        words = [w for w in kind.name.replace("…", "").split() if w.isalpha() and w not in small]
        assert words and all(w[0].isupper() for w in words), kind.name


MODULES_WITH_PANELS = tuple(f"ui.panel_{name}" for name in ("run", "drive", "selection", "results", "fixes", "output"))


def test_keys_are_taken_back(addon, scene) -> None:
    """Without a window Blender has no add-on keymaps; what is proposed is well-formed."""
    import bpy

    for operator, key in addon.module("ui.entries.keymap").KEYS:
        assert hasattr(bpy.ops.unveil, operator.removeprefix("unveil."))
        assert key["type"] in bpy.types.KeyMapItem.bl_rna.properties["type"].enum_items
