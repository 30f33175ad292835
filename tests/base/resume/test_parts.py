"""Parts of long work: made once for what they are made of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.resume.parts import Parts

Made = Callable[[Kept], dict[str, NDArray[np.int64]]]


def maker(made: list[int], value: int) -> Made:
    def make(kept: Kept) -> dict[str, NDArray[np.int64]]:
        kept.checkpoint("training").save({"half": np.arange(2)}, {})
        made.append(value)
        return {"value": np.array([value])}

    return make


def test_a_part_is_made_once_for_each_digest(tmp_path: Path) -> None:
    made: list[int] = []
    for _ in range(2):
        parts = Parts(tmp_path / "parts")
        for name, digest, value in (("one", "d1", 1), ("two", "d1", 2)):
            assert parts.once(name, digest, maker(made, value))["value"] == [value]
    assert made == [1, 2]
    again = Parts(tmp_path / "parts")
    assert again.once("one", "d1", maker(made, 9))["value"] == [1] and again.once("two", "d2", maker(made, 3))[
        "value"
    ] == [3]
    assert made == [1, 2, 3]
    again.tidy()
    left = sorted(str(p.relative_to(tmp_path / "parts")) for p in (tmp_path / "parts").rglob("*") if p.is_file())
    assert left == ["one/d1/part.npz", "two/d2/part.npz"]
    none = Parts(tmp_path / "parts")
    none.tidy()
    assert not list((tmp_path / "parts").iterdir())


def test_what_did_not_finish_goes_on_or_is_dropped(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "parts", every_s=0.0)

    def killed(kept: Kept) -> dict[str, NDArray[np.int64]]:
        checkpoint = kept.checkpoint("training")
        assert checkpoint.due()
        checkpoint.save({"half": np.arange(2)}, {"at": 1})
        raise KeyboardInterrupt

    def resumed(kept: Kept) -> dict[str, NDArray[np.int64]]:
        found = kept.checkpoint("training").load()
        return {"value": np.array([0 if found is None else found[1]["at"]])}

    for drops, expected in ((False, 1), (True, 0)):
        with pytest.raises(KeyboardInterrupt):
            parts.once("one", f"d{expected}", killed)
        if drops:
            parts.drop_unfinished()
        assert parts.once("one", f"d{expected}", resumed)["value"] == [expected]
    assert Parts().once("one", "d", maker([], 4))["value"] == [4]
    Parts().tidy()
