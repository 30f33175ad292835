"""SPZ as readers by its description, and gsply, find it: each number within the stated quantization."""

from __future__ import annotations

import gzip
import json
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exports.conftest import Street
from tests.exports.readers.spz import MAGIC, read_spz
from unveil_core.app.cli import main
from unveil_core.exports.coordinates import y_up
from unveil_core.exports.splats.placed import placed
from unveil_core.exports.splats.spz import packed, packed_rotations
from unveil_core.surfels.surfels import Surfels, rotations, three_log_scales


def check(
    found: dict[str, np.ndarray], scene: Surfels, scales: np.ndarray, step: float = 2.0**-13, turned: float = 0.3
) -> None:
    """Each number is as near as the module's docstring states; ``turned``: by how much a rotation may be off, degrees."""
    np.testing.assert_allclose(found["positions"], scene.means, atol=step + 1e-6)
    np.testing.assert_allclose(found["alpha"], torch.sigmoid(scene.opacity_logits), atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(found["dc"], scene.sh[:, 0].clamp(-1 / 0.3, 1 / 0.3), atol=0.0131 + 1e-5)
    np.testing.assert_allclose(found["log_scales"], np.clip(scales, -10, 255 / 16 - 10), atol=1 / 32 + 1e-5)
    # A splat is the same where each of its axes lies on the same line.
    ours, theirs = rotations(scene.quats.double()), rotations(torch.from_numpy(found["quats"]))
    along = (ours * theirs).sum(dim=1).abs().clamp(max=1).numpy()
    assert np.degrees(np.arccos(along)).max(initial=0) < turned
    limits = np.repeat([0.0313, 0.0626, 0.0626], [3, 5, 7])[: found["sh"].shape[1], None]
    inside = scene.sh[:, 1:].clamp(-1, 0.99).numpy()
    assert (np.abs(found["sh"] - inside) <= limits + 4.0 / 128).all() and found["sh"].shape == inside.shape


def test_the_scene_comes_back_y_up_within_the_stated_quantization(street: Street) -> None:
    path, job = street.exported("spz"), street.job
    frame = y_up(job.drive)
    there = placed(job.scene, frame.shifted)
    found = read_spz(path.read_bytes())
    check(found, there, three_log_scales(there, frame.from_local.scale).numpy())
    told = json.loads(path.with_name(path.name + ".json").read_text())
    world = (found["positions"] + told["shift"]) @ np.array(told["rotation_to_drive"]).T
    np.testing.assert_allclose(world, job.drive.to_world.to_world(job.scene.means.double().numpy()), atol=2e-4)
    assert len(path.read_bytes()) < len(street.exported("splat-ply").read_bytes()) / 4


@pytest.mark.parametrize(("version", "turned"), [(2, 1.6), (3, 0.3), (4, 0.3)])
def test_each_version_is_read_by_those_who_know_it(version: int, turned: float, street: Street, tmp_path: Path) -> None:
    if version == 4:
        pytest.importorskip("zstandard")
    path, job = tmp_path / "street.spz", street.job
    assert main(["export", str(street.root), "--to", "spz", "--spz", str(version), "-o", str(path)]) == 0
    there = placed(job.scene, y_up(job.drive).shifted)
    found = read_spz(path.read_bytes(), knows=(version,))
    check(found, there, three_log_scales(there, y_up(job.drive).from_local.scale).numpy(), turned=turned)
    with pytest.raises(ValueError, match=f"unsupported version {version}"):
        read_spz(path.read_bytes(), knows=tuple({2, 3, 4} - {version}))
    assert path.stat().st_size < len(street.exported("splat-ply").read_bytes()) / 8


@pytest.mark.parametrize("version", [2, 3, 4])
def test_another_library_reads_the_same(version: int, street: Street, tmp_path: Path) -> None:
    gsply = pytest.importorskip("gsply")
    path = tmp_path / "street.spz"
    assert main(["export", str(street.root), "--to", "spz", "--spz", str(version), "-o", str(path)]) == 0
    ours, theirs = read_spz(path.read_bytes()), gsply.read_spz(str(path))
    np.testing.assert_allclose(theirs.means, ours["positions"], atol=1e-6)
    np.testing.assert_allclose(theirs.scales, ours["log_scales"], atol=1e-6)
    np.testing.assert_allclose(theirs.sh0, ours["dc"], atol=1e-5)
    np.testing.assert_allclose(theirs.shN, ours["sh"], atol=1e-6)
    np.testing.assert_allclose(np.abs((theirs.quats * ours["quats"]).sum(axis=1)), 1, atol=1e-5)


def test_a_version_that_cannot_be_written_is_one_line(
    street: Street, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(street.root), "--to", "spz", "-o", str(tmp_path / "out"), "--spz"]
    assert main([*command, "5"]) == 2
    assert "Not a version that is written: --spz 5 (use 2, 3 or 4)" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "zstandard", None)  # as Python finds what is not installed
    assert main([*command, "4"]) == 2
    error = capsys.readouterr().err
    assert "Not installed: zstandard, which SPZ 4 needs" in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


NUMBERS = st.integers(0, 10**6)


@settings(max_examples=25)
@given(
    seed=NUMBERS,
    count=st.integers(0, 40),
    degree=st.integers(0, 3),
    version=st.sampled_from([2, 3]),
    reach=st.sampled_from([1.0, 100.0, 2000.0, 30000.0]),
)
def test_any_splats_come_back_within_the_stated_quantization(
    seed: int, count: int, degree: int, version: int, reach: float
) -> None:
    rng = np.random.default_rng(seed)

    def some(*shape: int, scale: float = 1.0) -> torch.Tensor:
        return torch.from_numpy(rng.normal(0, scale, (count, *shape)).astype(np.float32))

    quats = torch.nn.functional.normalize(some(4), dim=1)
    means = torch.from_numpy(rng.uniform(-reach, reach, (count, 3)).astype(np.float32))
    sh = some((degree + 1) ** 2, 3, scale=0.5)
    scene = Surfels(means, quats, some(2, scale=3.0), some(scale=4.0), sh, torch.zeros(count, dtype=torch.int64))
    scales = three_log_scales(scene).numpy()
    content = packed(scene, scales, version)
    bits = gzip.decompress(content)[13]
    assert bits == 12 or reach > 2000
    found = read_spz(content)
    check(found, scene, scales, step=2.0 ** -(bits + 1) + reach * 2.0**-23, turned={2: 1.6, 3: 0.3}[version])


@given(quat=st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_no_component_of_a_rotation_is_off_by_more_than_half_a_step(quat: list[float]) -> None:
    unit = np.array(quat) / np.linalg.norm(quat)
    content = struct.pack("<IIIBBBB", MAGIC, 3, 1, 0, 12, 0, 0) + bytes(16) + packed_rotations(unit[None])
    found = read_spz(gzip.compress(content))["quats"][0]
    found = found if found @ unit > 0 else -found
    # Of equals, in the order x y z w, the first is left out and follows from the others.
    left_out = (int(np.abs(np.roll(unit, -1)).argmax()) + 1) % 4
    kept = np.delete(np.abs(found - unit), left_out)
    assert kept.max() <= np.sqrt(0.5) / 511 / 2 + 1e-9
