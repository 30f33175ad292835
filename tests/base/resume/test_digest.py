"""Digests: the same of what is equal, another one of what is not."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.base.frame_cache import Frames
from unveil_core.base.resume.digest import digest_of


@dataclass(frozen=True, eq=False)
class Thing:
    name: str
    places: np.ndarray
    path: Path
    inner: Thing | None = None
    found: int = field(init=False, default=0)


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(max_size=4)
    | st.binary(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner, max_size=3),
    max_leaves=6,
)


@given(VALUES, VALUES)
def test_equal_values_have_equal_digests_and_others_have_not(a: object, b: object) -> None:
    assert (digest_of(a) == digest_of(b)) == (repr_of(a) == repr_of(b))
    assert digest_of(a, b) != digest_of([a], b)


def repr_of(value: object) -> str:
    if isinstance(value, dict):
        return repr({k: repr_of(value[k]) for k in sorted(value)})
    return f"[{','.join(map(repr_of, value))}]" if isinstance(value, list) else repr(value)


def test_arrays_count_by_content_shape_and_type() -> None:
    values = np.arange(6.0)
    same = [values, values.copy(), np.arange(12.0)[:6], torch.from_numpy(values)]
    assert len({digest_of(v) for v in same}) == 1
    others = [
        values.reshape(2, 3),
        values.reshape(3, 2),
        values.astype(np.float32),
        values[::-1],
        values[:0],
        values + 1,
    ]
    assert len({digest_of(v) for v in [values, *others]}) == 7
    assert digest_of(np.float64(2.5)) == digest_of(2.5)


def test_things_count_by_their_fields_and_files_by_their_content(tmp_path: Path) -> None:
    for name, text in (("a", "one"), ("b", "one"), ("c", "two")):
        (tmp_path / name).write_text(text)
    thing = Thing("x", np.eye(2), tmp_path / "a", Thing("y", np.zeros(1), tmp_path / "nowhere"))
    found = replace(thing, path=tmp_path / "b", inner=replace(thing.inner, path=tmp_path))
    object.__setattr__(found, "found", 3)
    assert digest_of(found) == digest_of(thing)
    changes = [
        {"name": "z"},
        {"places": np.eye(3)},
        {"path": tmp_path / "c"},
        {"path": tmp_path / "no"},
        {"inner": None},
    ]
    assert len({digest_of(replace(thing, **change)) for change in [{}, *changes]}) == 6
    read = Frames(2, lambda i: np.full(3, i))
    assert digest_of(read) == digest_of([np.zeros(3, int), np.ones(3, int)]) and digest_of({2, 1}) == digest_of({1, 2})
    with pytest.raises(TypeError, match="no digest of a function"):
        digest_of([thing, repr_of])
