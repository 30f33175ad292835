"""Objects are filtered by any predicate; what is selected is what later runs remove."""

from __future__ import annotations

from pathlib import Path

import pytest

import unveil_core as unveil
from unveil_core.base.errors import SelectionError, WorkspaceError


@pytest.fixture
def imported(street: Path, tmp_path: Path) -> unveil.Workspace:
    return unveil.run(street, tmp_path / "w", until="segment")


def test_a_choice_by_predicate(imported: unveil.Workspace) -> None:
    listed = imported.objects
    assert len(listed) == 1 and listed[0].cls == "car" and listed[0].id == 300 and listed[0].frames == 4
    assert listed[0].thumbnail is not None and listed[0].thumbnail.is_file() and listed[:1].ids == (300,)
    far = listed.filter(lambda o: o.distance is not None and o.distance > 1e6)
    assert len(far) == 0 and list(listed.filter(lambda o: o.cls == "car")) == list(listed)
    with pytest.raises(SelectionError, match="Nothing is selected"):
        far.select()
    assert imported.settings.instances == ()
    after = listed.select()
    assert after == imported.settings
    assert (after.instances, after.remove) == ((300,), ()) and imported.status()["choose"] == "done"
    assert far.select(remove=["car"]).remove == ("car",)


def test_before_they_are_listed_and_where_they_are_damaged(street: Path, tmp_path: Path) -> None:
    space = unveil.run(street, tmp_path / "w", until="import")
    with pytest.raises(WorkspaceError, match="Not listed yet.*unveil objects"):
        _ = space.objects
    for damaged in ('{"objects": [{"id": 3}]}', '{"objects": 3}', "{"):
        space.objects_json.write_text(damaged)
        with pytest.raises(WorkspaceError):
            _ = space.objects
