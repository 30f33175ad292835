"""SPZ as a reader by its description, and gsply, find it: each number within the stated quantization."""

from __future__ import annotations

import gzip
import json
import struct

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exports.conftest import Street
from unveil_core.exports.coordinates import y_up
from unveil_core.exports.splats.placed import placed, three_log_scales
from unveil_core.exports.splats.spz import packed, packed_rotations
from unveil_core.surfels.surfels import Surfels


def read_spz(content: bytes) -> dict[str, np.ndarray]:
    """What an uncompressed SPZ 3 holds: quaternions are wxyz."""
    magic, version, count, degree, bits, flags, reserved = struct.unpack("<IIIBBBB", content[:16])
    assert (magic, version, flags, reserved) == (0x5053474E, 3, 0, 0)
    at = 16

    def take(width: int) -> np.ndarray:
        nonlocal at
        part = np.frombuffer(content, np.uint8, count * width, at).reshape(count, width)
        at += count * width
        return part.astype(np.int64)

    raw = take(9).reshape(count, 3, 3)
    fixed = raw[..., 0] | raw[..., 1] << 8 | raw[..., 2] << 16
    fixed = np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed)
    alpha, color, scale, rotation = take(1)[:, 0] / 255, take(3), take(3), take(4)
    coefficients = (degree + 1) ** 2 - 1
    sh = (take(3 * coefficients).reshape(count, coefficients, 3) - 128) / 128
    assert at == len(content)
    word = (rotation << np.array([0, 8, 16, 24])).sum(axis=1)
    largest, quats = word >> 30, np.zeros((count, 4))
    for row in range(count):
        rest = int(word[row])
        for i in (3, 2, 1, 0):
            if i != largest[row]:
                size = (rest & 511) / 511 * np.sqrt(0.5)
                quats[row, i] = -size if rest & 512 else size
                rest >>= 10
        quats[row, largest[row]] = np.sqrt(max(0.0, 1 - np.square(quats[row]).sum()))
    return {
        "positions": fixed / 2.0**bits,
        "alpha": alpha,
        "dc": (color / 255 - 0.5) / 0.15,
        "log_scales": scale / 16 - 10,
        "quats": np.roll(quats, 1, axis=1),
        "sh": sh,
    }


def check(found: dict[str, np.ndarray], scene: Surfels, scales: np.ndarray, step: float = 2.0**-13) -> None:
    """Each number is as near as the module's docstring states."""
    np.testing.assert_allclose(found["positions"], scene.means, atol=step + 1e-6)
    np.testing.assert_allclose(found["alpha"], torch.sigmoid(scene.opacity_logits), atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(found["dc"], scene.sh[:, 0].clamp(-1 / 0.3, 1 / 0.3), atol=0.0131 + 1e-5)
    np.testing.assert_allclose(found["log_scales"], np.clip(scales, -10, 255 / 16 - 10), atol=1 / 32 + 1e-5)
    same = np.abs((found["quats"] * scene.quats.double().numpy()).sum(axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(same, 1))).max(initial=0) < 0.3
    limits = np.repeat([0.0313, 0.0626, 0.0626], [3, 5, 7])[: found["sh"].shape[1], None]
    inside = scene.sh[:, 1:].clamp(-1, 0.99).numpy()
    assert (np.abs(found["sh"] - inside) <= limits + 4.0 / 128).all() and found["sh"].shape == inside.shape


def test_the_scene_comes_back_y_up_within_the_stated_quantization(street: Street) -> None:
    path, job = street.exported("spz"), street.job
    frame = y_up(job.drive)
    there = placed(job.scene, frame.shifted)
    found = read_spz(gzip.decompress(path.read_bytes()))
    check(found, there, three_log_scales(there, frame.from_local.scale).numpy())
    told = json.loads(path.with_name(path.name + ".json").read_text())
    world = (found["positions"] + told["shift"]) @ np.array(told["rotation_to_drive"]).T
    np.testing.assert_allclose(world, job.drive.to_world.to_world(job.scene.means.double().numpy()), atol=2e-4)
    assert len(path.read_bytes()) < len(street.exported("splat-ply").read_bytes()) / 4


def test_another_library_reads_the_same(street: Street) -> None:
    gsply = pytest.importorskip("gsply")
    path = street.exported("spz")
    ours, theirs = read_spz(gzip.decompress(path.read_bytes())), gsply.read_spz(str(path))
    np.testing.assert_allclose(theirs.means, ours["positions"], atol=1e-6)
    np.testing.assert_allclose(theirs.scales, ours["log_scales"], atol=1e-6)
    np.testing.assert_allclose(theirs.sh0, ours["dc"], atol=1e-5)
    np.testing.assert_allclose(theirs.shN, ours["sh"], atol=1e-6)
    np.testing.assert_allclose(np.abs((theirs.quats * ours["quats"]).sum(axis=1)), 1, atol=1e-5)


NUMBERS = st.integers(0, 10**6)


@settings(max_examples=25)
@given(
    seed=NUMBERS,
    count=st.integers(0, 40),
    degree=st.integers(0, 3),
    reach=st.sampled_from([1.0, 100.0, 2000.0, 30000.0]),
)
def test_any_splats_come_back_within_the_stated_quantization(seed: int, count: int, degree: int, reach: float) -> None:
    rng = np.random.default_rng(seed)

    def some(*shape: int, scale: float = 1.0) -> torch.Tensor:
        return torch.from_numpy(rng.normal(0, scale, (count, *shape)).astype(np.float32))

    quats = torch.nn.functional.normalize(some(4), dim=1)
    means = torch.from_numpy(rng.uniform(-reach, reach, (count, 3)).astype(np.float32))
    sh = some((degree + 1) ** 2, 3, scale=0.5)
    scene = Surfels(means, quats, some(2, scale=3.0), some(scale=4.0), sh, torch.zeros(count, dtype=torch.int64))
    scales = three_log_scales(scene).numpy()
    content = packed(scene, scales)
    bits = content[13]
    assert bits == 12 or reach > 2000
    found = read_spz(content)
    check(found, scene, scales, step=2.0 ** -(bits + 1) + reach * 2.0**-23)


@given(quat=st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_no_component_of_a_rotation_is_off_by_more_than_half_a_step(quat: list[float]) -> None:
    unit = np.array(quat) / np.linalg.norm(quat)
    content = struct.pack("<IIIBBBB", 0x5053474E, 3, 1, 0, 12, 0, 0) + bytes(16) + packed_rotations(unit[None])
    found = read_spz(content)["quats"][0]
    found = found if found @ unit > 0 else -found
    # Of equals, in the order x y z w, the first is left out and follows from the others.
    left_out = (int(np.abs(np.roll(unit, -1)).argmax()) + 1) % 4
    kept = np.delete(np.abs(found - unit), left_out)
    assert kept.max() <= np.sqrt(0.5) / 511 / 2 + 1e-9
