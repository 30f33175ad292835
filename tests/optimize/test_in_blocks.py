"""A drive reconstructed in blocks: as good as in one piece, each surfel from its own block, and finished blocks stay finished."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.hard_drives import make_tiny_street
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.resume.parts import Parts
from unveil_core.drives import open_drive
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.evaluate.held_out import evaluate_views
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.optimize.adaptation.choices import CHOICES
from unveil_core.optimize.in_blocks import BlockwiseReconstruction, block_of_drive
from unveil_core.optimize.presets import ReconstructSettings
from unveil_core.optimize.reconstruct import Reconstruction
from unveil_core.optimize.start import StartSettings
from unveil_core.semantics.labels import SceneLabels, choose_labels

SETTINGS = ReconstructSettings(
    iterations=120, sh_degree=0, start=StartSettings(budget=4000), budget=6000, given=frozenset(CHOICES)
)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> tuple[Drive, SceneLabels]:
    path = make_tiny_street(tmp_path_factory.mktemp("blocks") / "street", [0.8 * i for i in range(12)])
    drive = localized(open_drive(path))
    return drive, choose_labels(drive)


def psnr(done: Reconstruction, drive: Drive, scene: SceneLabels) -> float:
    return float(evaluate_views(done.surfels, done.sky, list(drive.frames), scene, near=NEAR_M, far=FAR_M)["psnr"])


def test_two_blocks_are_as_good_as_one(street: tuple[Drive, SceneLabels]) -> None:
    drive, scene = street
    one, two = cut_into_blocks(drive), cut_into_blocks(drive, 4.5)
    assert len(one.blocks) == 1 and len(two.blocks) == 2
    whole = BlockwiseReconstruction(drive, scene, SETTINGS, one, Exposures()).whole()
    halves = BlockwiseReconstruction(drive, scene, SETTINGS, two, Exposures()).whole()
    assert psnr(halves, drive, scene) > psnr(whole, drive, scene) - 0.2
    owner = two.of_places(halves.surfels.means.double().numpy())
    assert set(np.unique(owner)) == {0, 1} and (np.diff(owner) >= 0).all()
    assert halves.choices["iterations"]["chosen"] == sum(c["iterations"]["chosen"] for c in halves.choices["blocks"])


def test_what_a_frame_of_the_block_sees_is_in_its_points(street: tuple[Drive, SceneLabels]) -> None:
    drive, _ = street
    for block in cut_into_blocks(drive, 3.0).blocks:
        part = block_of_drive(drive, block)
        kept = {p.tobytes() for p in part.points.positions}
        for frame in part.frames:
            pixel, depth = frame.camera.project(drive.points.positions)
            seen = frame.camera.in_picture(pixel, depth) & (depth < FAR_M)
            assert all(p.tobytes() in kept for p in drive.points.positions[seen])


class Killed(Exception):
    pass


def test_finished_blocks_are_not_made_again(street: tuple[Drive, SceneLabels], tmp_path: Path) -> None:
    drive, scene = street
    settings, blocks = replace(SETTINGS, iterations=24), cut_into_blocks(drive, 3.0)
    whole = BlockwiseReconstruction(drive, scene, settings, blocks, Exposures()).whole()
    begun: list[str] = []

    def kill(done: int, total: int, message: str = "", **_: float) -> None:
        if message.startswith("block 3 of 3, fine") and "fine" not in begun:
            begun.append("fine")
            raise Killed
        begun.append(message.split(",")[0])

    kept, parts = Kept(tmp_path / "kept"), Parts(tmp_path / "parts")
    work = BlockwiseReconstruction(drive, scene, settings, blocks, Exposures(), kept=kept, parts=parts, progress=kill)
    with pytest.raises(Killed):
        work.whole()
    before = len(begun)
    again = work.whole()
    assert set(begun[before:]) == {"block 3 of 3"}
    assert all(torch.equal(torch.from_numpy(a), getattr(again.surfels, n)) for n, a in whole.surfels.arrays().items())
    assert torch.equal(whole.sky.texture, again.sky.texture)


def test_a_change_makes_only_the_blocks_again_that_see_it(street: tuple[Drive, SceneLabels], tmp_path: Path) -> None:
    drive, scene = street
    settings, blocks = replace(SETTINGS, iterations=24), cut_into_blocks(drive, 3.0)
    begun: set[str] = set()

    def watch(done: int, total: int, message: str = "", **_: float) -> None:
        begun.add(message.split(" of ")[0])

    def made(drive: Drive, scene: SceneLabels = scene, code: str = "") -> set[str]:
        begun.clear()
        parts = Parts(tmp_path / "parts")
        work = BlockwiseReconstruction(
            drive, scene, settings, blocks, Exposures(), parts=parts, code=code, progress=watch
        )
        work.whole()
        parts.tidy()
        return set(begun)

    everything = {f"block {k + 1}" for k in range(len(blocks.blocks))}
    assert made(drive) == everything and made(drive) == set()
    # What was chosen to be removed is nothing to the scene.
    assert made(drive, replace(scene, removed=(), pixel_counts=tuple(2 * c for c in scene.pixel_counts))) == set()
    last = len(drive.frames) - 1
    sees_last = {f"block {b.number + 1}" for b in blocks.blocks if last in b.frames}
    assert sees_last != everything
    labels = read_label_image(drive.frames[last].semantic_path)
    road, car = (scene.labels.disk_ids[scene.labels.index(n)] for n in ("road", "car"))
    changed = tmp_path / "changed.png"
    write_image_atomic(changed, np.where(labels == car, road, labels).astype(np.uint8))
    assert (read_label_image(changed) != labels).any()
    frames = (*drive.frames[:last], replace(drive.frames[last], semantic_path=changed))
    assert made(replace(drive, frames=frames)) == sees_last
    assert made(replace(drive, frames=frames), code="another") == everything


def test_blocks_without_labels_choose_the_size_of_their_sky_apart(
    street: tuple[Drive, SceneLabels], tmp_path: Path
) -> None:
    drive, scene = street
    blocks, on_disk = cut_into_blocks(drive, 4.5), scene.labels.disk_ids
    sky, car = (on_disk[scene.labels.index(name)] for name in ("sky", "car"))
    frames = []
    for i, frame in enumerate(drive.frames):
        image, labels = read_image(frame.image_path), read_label_image(frame.semantic_path)
        if i in blocks.blocks[1].own:  # an edge of clouds that a coarse panorama blurs
            rays = frame.camera.rays()
            height = np.degrees(np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1])))
            clouds = np.where(height > 8, 255, 60).astype(np.uint8)
            image = np.where((labels == sky)[..., None], clouds[..., None], image)
        paths = tmp_path / f"{i}.png", tmp_path / f"{i}_mask.png"
        write_image_atomic(paths[0], image)
        write_image_atomic(paths[1], np.where(labels == car, 0, 255).astype(np.uint8))
        frames.append(replace(frame, image_path=paths[0], mask_path=paths[1], semantic_path=None))
    unlabelled = replace(drive, frames=tuple(frames))
    settings = replace(SETTINGS, iterations=24, given=frozenset(CHOICES) - {"sky"})
    done = BlockwiseReconstruction(unlabelled, choose_labels(unlabelled), settings, blocks, Exposures()).whole()
    rows = [choice["sky"]["chosen"] for choice in done.choices["blocks"]]
    assert len(set(rows)) == 2
    assert done.sky.texture.shape[1] == max(rows)
