"""The rules of style that ``make lint`` checks see what breaks them."""

from __future__ import annotations

from pathlib import Path

from lint.style import MOST_MODULES, crowded_folders, operators_elsewhere, units_told


def write(path: Path, text: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_what_breaks_a_rule_is_named(tmp_path: Path) -> None:
    for number in range(MOST_MODULES + 1):
        write(tmp_path / f"unveil_core/many/m{number}.py")
    write(tmp_path / "unveil_core/drives/formats/door.py", "def place(units_per_metre): ...\n")
    write(tmp_path / "unveil_core/inside.py", "def place(units_per_metre): ...\n")
    write(tmp_path / "blender_addon/work/buttons.py", 'class A:\n    bl_idname = "unveil.run"\n')
    assert list(crowded_folders(tmp_path)) == ["unveil_core/many: 15 modules, at most 14"]
    assert list(units_told(tmp_path)) == ["unveil_core/inside.py:1: units_per_metre: lengths are metres"]
    assert list(operators_elsewhere(tmp_path)) == ["blender_addon/work/buttons.py: operators stand in operators_*.py"]
