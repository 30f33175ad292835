"""Pictures of classes are read as what they are, by their values; what they cannot be known by is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.drives.labels.files import as_order, as_palette, in_colours, saved, street_labels
from unveil_core.base.drive_options import LABEL_CLASSES
from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_values
from unveil_core.drives.labels.codes import SemanticCode
from unveil_core.drives.labels.colours import COLOUR_ORDERS, train_ids_of_colours
from unveil_core.drives.labels.orders import ORDERS
from unveil_core.drives.labels.reading import train_ids
from unveil_core.drives.labels.samples import samples_of
from unveil_core.drives.labels.semantic_codes import semantic_code

Label = NDArray[np.uint8]
OWN_COLOURS = np.random.default_rng(3).integers(1, 255, (256, 3)).astype(np.uint8)
CITY_COLOURS = np.concatenate([in_colours(np.arange(19, dtype=np.uint8)[None])[0], np.zeros((237, 3), np.uint8)])
GREYS = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)


def renumbered(label: Label) -> bytes:
    """As programs that make files small do: the grey levels that occur become a palette of few bits."""
    levels = np.unique(label)
    return as_palette(np.searchsorted(levels, label).astype(np.uint8), GREYS[levels], bits=4)


def in_red(label: Label) -> Label:
    """As CARLA's camera writes tags."""
    return np.dstack([as_order(label, "carla", 0), np.zeros((*label.shape, 2), np.uint8)])


def transparent(label: Label) -> Label:
    return np.dstack([in_colours(label), np.full(label.shape, 255, np.uint8)])


def with_bonnet(label: Label) -> Label:
    """19 for the vehicle's own bonnet."""
    changed = label.copy()
    changed[40:] = 19
    return changed


KINDS: dict[str, tuple[Callable[[Label], Label | bytes | np.ndarray], str, str]] = {
    "trainIds": (lambda x: x, ".png", "cityscapes"),
    "trainIds of 16 bits": (lambda x: x.astype(np.uint16), ".png", "cityscapes"),
    "trainIds, times 257": (lambda x: x.astype(np.uint16) * 257, ".png", "cityscapes"),
    "trainIds in all channels": (lambda x: np.dstack([x] * 3), ".png", "cityscapes"),
    "trainIds in a TIFF": (lambda x: x, ".tif", "cityscapes"),
    "trainIds in a BMP, in all channels": (lambda x: np.dstack([x] * 3), ".bmp", "cityscapes"),
    "a palette of own colours": (lambda x: as_palette(x, OWN_COLOURS), ".png", "cityscapes"),
    "a palette of Cityscapes' colours": (lambda x: as_palette(x, CITY_COLOURS), ".png", "cityscapes-colours"),
    "a palette of greys, renumbered": (renumbered, ".png", "cityscapes"),
    "labelIds": (lambda x: as_order(x, "cityscapes-ids", 0), ".png", "cityscapes-ids"),
    "labelIds with a palette": (
        lambda x: as_palette(as_order(x, "cityscapes-ids", 0), OWN_COLOURS),
        ".png",
        "cityscapes-ids",
    ),
    "labelIds times 1000": (
        lambda x: as_order(x, "cityscapes-ids", 0).astype(np.uint16) * 1000 + 3,
        ".png",
        "cityscapes-ids",
    ),
    "ADE20K": (lambda x: as_order(x, "ade20k"), ".png", "ade20k"),
    "ADE20K from 1": (lambda x: as_order(x, "ade20k-from-1", 0), ".png", "ade20k-from-1"),
    "Mapillary Vistas": (lambda x: as_order(x, "mapillary", 65), ".png", "mapillary"),
    "CARLA's tags in the red channel": (in_red, ".png", "carla"),
    "colours": (in_colours, ".png", "cityscapes-colours"),
    "colours with transparency": (transparent, ".png", "cityscapes-colours"),
    "colours of 16 bits": (lambda x: in_colours(x).astype(np.uint16) * 257, ".png", "cityscapes-colours"),
    "colours with red and blue exchanged": (lambda x: in_colours(x)[..., ::-1], ".png", "cityscapes-colours"),
    "a palette of colours with red and blue exchanged": (
        lambda x: as_palette(x, CITY_COLOURS[:, ::-1]),
        ".png",
        "cityscapes-colours",
    ),
    "19 for the bonnet": (with_bonnet, ".png", "cityscapes"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_they_become_train_ids(kind: str, tmp_path: Path) -> None:
    make, suffix, order = KINDS[kind]
    paths = [saved(tmp_path / f"{i}{suffix}", make(street_labels(i))) for i in range(4)]
    code, told = semantic_code(samples_of(paths))
    assert code.order == order
    assert (told is None) == (order == "cityscapes" and "19" not in kind)
    for i, path in enumerate(paths):
        wanted = street_labels(i)
        if "19" in kind:
            wanted[40:] = 255
        assert (train_ids(read_values(path), code, path, strict=True) == wanted).all()


def test_colours_in_a_jpeg_are_the_nearest_but_at_borders(tmp_path: Path) -> None:
    large = np.kron(street_labels(), np.ones((6, 6), np.uint8))
    path = saved(tmp_path / "0.jpg", in_colours(large))
    code, told = semantic_code(samples_of([path]))
    assert code.order == "cityscapes-colours" and told is not None
    found = train_ids(read_values(path), code, path, strict=True)
    assert (found == large).mean() > 0.9
    turned = saved(tmp_path / "turned.jpg", in_colours(large)[..., ::-1])
    assert semantic_code(samples_of([turned]))[0] == SemanticCode(code.order, by_palette=True, blue_first=True)
    edges = cv2.morphologyEx(large, cv2.MORPH_GRADIENT, np.ones((9, 9), np.uint8)) > 0
    assert (found == large)[~edges].all()


REFUSED: dict[str, tuple[Callable[[Label], Label | bytes], str, str]] = {
    "numbers of nothing known": (lambda x: x * 9 + 100, ".png", r"no Cityscapes class has as trainId.*--label-classes"),
    "numbers in a JPEG": (lambda x: x, ".jpg", "lossy format.*as PNG"),
    "colours of nothing known": (lambda x: OWN_COLOURS[x], ".png", r"mean no known classes.*--label-classes"),
    "a photograph": (
        lambda x: np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8),
        ".jpg",
        "mean no known classes",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_nothing_tells_is_one_line(kind: str, tmp_path: Path) -> None:
    make, suffix, line = REFUSED[kind]
    paths = [saved(tmp_path / f"{i}{suffix}", make(street_labels(i))) for i in range(3)]
    with pytest.raises(DriveError, match=line):
        semantic_code(samples_of(paths))


def test_pictures_of_two_kinds_are_one_line(tmp_path: Path) -> None:
    paths = [saved(tmp_path / "0.png", street_labels()), saved(tmp_path / "1.png", in_colours(street_labels()))]
    with pytest.raises(DriveError, match=r"1\.png: Colours here, and numbers in other label pictures"):
        semantic_code(samples_of(paths))


def test_what_the_user_names_is_taken_unless_it_cannot_be(tmp_path: Path) -> None:
    path = saved(tmp_path / "0.png", as_order(street_labels(), "waymo", 0))
    code, told = semantic_code(samples_of([path]), "waymo")
    assert code == SemanticCode("waymo") and told is not None and "as given" in told
    assert (train_ids(read_values(path), code, path) == street_labels()).mean() > 0.99
    with pytest.raises(DriveError, match="Not a picture of cityscapes: it holds"):
        semantic_code(samples_of([path]), "cityscapes")
    with pytest.raises(DriveError, match="other colours than ade20k-colours"):
        semantic_code(samples_of([saved(tmp_path / "c.png", OWN_COLOURS[street_labels()])]), "ade20k-colours")


def test_a_drive_of_few_classes_stays_as_it_was(tmp_path: Path) -> None:
    """Nothing is guessed of numbers that trainIds could be, unless they clearly are others of a whole street."""
    for value in (0, 7, 13, 18, 255):
        path = saved(tmp_path / f"{value}.png", np.full((24, 32), value, np.uint8))
        assert semantic_code(samples_of([path])) == (SemanticCode(), None)


def test_a_number_that_comes_later_is_one_line(tmp_path: Path) -> None:
    label = street_labels()
    label[0, 0] = 40
    path = saved(tmp_path / "late.png", label)
    with pytest.raises(DriveError, match=r"late\.png: holds 40, which no class of cityscapes has"):
        train_ids(read_values(path), SemanticCode(), path, strict=True)
    assert train_ids(read_values(path), SemanticCode(), path)[0, 0] == 255


def test_each_name_has_a_table_and_each_table_a_name() -> None:
    assert set(LABEL_CLASSES) == {*ORDERS, *COLOUR_ORDERS}


@pytest.mark.parametrize("order", COLOUR_ORDERS)
def test_each_colour_of_a_table_is_found_again_exactly_and_nearly(order: str) -> None:
    colours = np.array(list(COLOUR_ORDERS[order]), np.uint8)[None]
    exact, known = train_ids_of_colours(colours, order, lossy=False)
    nearly, near = train_ids_of_colours(colours, order, lossy=True)
    assert known.all() and near.all()
    assert (exact == nearly).mean() > 0.85  # some colours are as near to one another as a JPEG changes them


@pytest.mark.parametrize("order", COLOUR_ORDERS)
def test_few_of_all_colours_are_near_to_a_table(order: str) -> None:
    any_colours = np.random.default_rng(1).integers(0, 256, (200, 200, 3)).astype(np.uint8)
    found, near = train_ids_of_colours(any_colours, order, lossy=True)
    assert 0.02 < near.mean() < 0.3 and (found[~near] == 255).all()
    assert train_ids_of_colours(any_colours, order, lossy=False)[1].mean() < 0.01
