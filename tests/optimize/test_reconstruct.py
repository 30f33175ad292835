"""A whole reconstruction of a small street: it takes what the scene needs, and what the user says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests import small_street
from tests.hard_drives import make_tiny_street
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives import open_drive
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.evaluate.held_out import evaluate_views
from unveil_core.optimize.adaptation.choices import CHOICES, AdaptSettings
from unveil_core.optimize.presets import MANY_FRAMES, PRESETS, ReconstructSettings
from unveil_core.optimize.reconstruct import Reconstruction, reconstruct
from unveil_core.optimize.start import StartSettings
from unveil_core.semantics.labels import choose_labels

SMALL = ReconstructSettings(
    iterations=240, sh_degree=1, start=StartSettings(budget=4000), budget=12_000, adapt=AdaptSettings(every=20)
)

PLACES = [float(i) for i in range(8)]


def plain(points: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """One matte colour for each class."""
    return np.array([(0.1 + 0.07 * (k % 11), 0.5, 0.7 - 0.04 * (k % 11)) for k in range(19)])[kind]


def rich(points: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """The same with a coarse and a fine pattern."""
    waves = np.sin(points * (5.0, 6.0, 7.0)).prod(axis=1) + 0.7 * np.sin(points * (17.0, 19.0, 13.0)).sum(axis=1) / 3
    return np.clip(plain(points, kind) + 0.25 * waves[:, None] * (kind != small_street.SKY)[:, None], 0, 1)


def reconstructed(folder: Path, settings: ReconstructSettings) -> tuple[Reconstruction, float]:
    """The scene of a drive and the PSNR of its own frames."""
    drive = localized(open_drive(folder))
    scene = choose_labels(drive)
    done = reconstruct(drive, scene, settings)
    told = evaluate_views(done.surfels, done.sky, list(drive.frames), scene, near=NEAR_M, far=FAR_M)
    return done, told["psnr"]


def tensors(done: Reconstruction) -> list[torch.Tensor]:
    s = done.surfels
    return [s.means, s.quats, s.log_scales, s.opacity_logits, s.sh, s.labels, done.sky.texture]


def test_a_plain_scene_comes_out_smaller_than_a_rich_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {}
    for shade in (plain, rich):
        monkeypatch.setattr(small_street, "shade", shade)
        path = make_tiny_street(tmp_path / shade.__name__, [1.5 * i for i in range(5)], rays=3000, shrink=1)
        found[shade.__name__] = reconstructed(path, SMALL)
    (one, plain_psnr), (other, rich_psnr) = found["plain"], found["rich"]
    assert plain_psnr > rich_psnr + 6
    assert len(one.surfels) < 0.7 * len(other.surfels)
    assert one.choices["budget"]["chosen"] < 0.7 * other.choices["budget"]["chosen"]
    json.dumps(one.choices)
    for name in CHOICES:
        assert "chosen" in one.choices[name], name
    assert one.choices["looks"] and all("psnr" in look for look in one.choices["looks"])


def test_the_user_decides_over_the_scene(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", PLACES)
    given = replace(
        SMALL, iterations=70, sh_degree=0, budget=3000, given=frozenset({"iterations", "sh_degree", "budget"})
    )
    done, _ = reconstructed(path, given)
    assert done.choices["given"] == ["budget", "iterations", "sh_degree"]
    assert abs(done.choices["iterations"]["chosen"] - 70) <= 1 and done.surfels.sh_degree == 0
    fixed, _ = reconstructed(path, replace(given, given=frozenset(CHOICES)))
    assert not fixed.choices["looks"], "nothing is hidden from a fixed recipe"


def test_the_same_again(tmp_path: Path) -> None:
    """What is chosen, and every bit of the scene."""
    path = make_tiny_street(tmp_path / "street", PLACES)
    (one, _), (other, _) = (reconstructed(path, replace(SMALL, iterations=120)) for _ in range(2))
    assert one.choices == other.choices and one.choices["looks"]
    for a, b in zip(tensors(one), tensors(other), strict=True):
        assert torch.equal(a, b)


def test_comparisons_run_through(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", PLACES)
    short = replace(SMALL, iterations=60, sh_degree=0)
    plain_done, plain_psnr = reconstructed(path, short)
    solid, psnr = reconstructed(path, replace(short, ellipsoids=True))
    assert solid.surfels.ellipsoids and abs(psnr - plain_psnr) < 2
    soft, psnr = reconstructed(path, replace(short, soft_labels=True))
    assert abs(psnr - plain_psnr) < 0.5 and not soft.surfels.labels.equal(plain_done.surfels.labels)
    thrown, psnr = reconstructed(path, replace(short, random_start=True))
    assert psnr < plain_psnr - 6, "points know more than nothing"


def test_long_drives_may_have_more() -> None:
    standard = PRESETS["standard"]
    assert standard.scaled(MANY_FRAMES // 2) == standard
    longer = standard.scaled(3 * MANY_FRAMES)
    assert longer.iterations == 3 * standard.iterations and longer.budget == 3 * standard.budget
    asked = replace(standard, given=frozenset({"iterations"})).scaled(3 * MANY_FRAMES)
    assert asked.iterations == standard.iterations


class Killed(Exception):
    pass


def test_an_interrupted_reconstruction_comes_to_the_same_end_bit_for_bit(tmp_path: Path) -> None:
    drive = localized(open_drive(make_tiny_street(tmp_path / "street", PLACES)))
    scene = choose_labels(drive)
    settings = replace(SMALL, iterations=200)
    whole = reconstruct(drive, scene, settings)
    kept = Kept(tmp_path / "kept", every_s=0.0)
    generator = np.random.default_rng(0)
    killed = 0
    for _ in range(12):
        left = int(generator.integers(3, 40))

        def countdown(*_: object, **__: float) -> None:
            nonlocal left
            left -= 1
            if left == 0:
                raise Killed

        try:
            again = reconstruct(drive, scene, settings, kept=kept, progress=countdown)
        except Killed:
            killed += 1
            continue
        break
    else:
        again = reconstruct(drive, scene, settings, kept=kept)
    assert killed >= 4
    assert all(torch.equal(a, b) for a, b in zip(tensors(whole), tensors(again), strict=True))
    assert whole.choices == again.choices
