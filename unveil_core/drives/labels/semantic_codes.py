"""What a drive's pictures of classes hold: trainIds, labelIds, numbers of other data sets, or colours.

The numbers that occur exclude most readings; of those that are left the one is taken whose street has the sky above and the ground
below (``street_likeness``). Where none is clearly that, the user says it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.drive_options import LABEL_CLASSES
from unveil_core.base.errors import DriveError
from unveil_core.drives.cityscapes import CITYSCAPES, VOID
from unveil_core.drives.labels.codes import TRAIN_IDS, SemanticCode
from unveil_core.drives.labels.colours import COLOUR_ORDERS, train_ids_of_colours
from unveil_core.drives.labels.reading import colours_of, ids_of, stray_ids, train_ids
from unveil_core.drives.labels.samples import Sample
from unveil_core.drives.labels.street_likeness import SEEN_ON_STREETS, street_likeness

__all__ = ["ORDER_NAMES", "semantic_code"]

TRIED = ("cityscapes", "cityscapes-ids", "ade20k", "ade20k-from-1", "mapillary", "carla")
"""Orders that are recognized, where nobody names one."""
ORDER_NAMES = {
    "cityscapes": "Cityscapes trainIds",
    "cityscapes-ids": "Cityscapes labelIds",
    "cityscapes-colours": "colours of Cityscapes",
    "ade20k": "classes of ADE20K",
    "ade20k-from-1": "classes of ADE20K, counted from 1",
    "ade20k-colours": "colours of ADE20K",
    "mapillary": "classes of Mapillary Vistas",
    "carla": "tags of CARLA",
}
CLEARLY = 0.35
"""By so much the mean logarithm of the reading that is taken exceeds that of each other one."""
VERY_CLEARLY = 1.0
"""The same of a reading against trainIds, where the numbers could be these."""
FEWEST_CLASSES = 4
"""That such a reading must show, the road among them."""
PANOPTIC = 1000
"""Cityscapes, KITTI-360 and others write a class times this plus the number of an object."""
COLOURED, NEARLY_COLOURED = 0.9, 0.7
"""Share of the pixels that have a colour of a table, from which on it is taken: of exact pictures and of lossy ones."""
TURNED = 0.1
"""So much larger is that share with red and blue exchanged, where they are: roads, houses and poles look the same either way."""
FEW_STRAY, ONE_STRAY = 0.02, 0.25
"""Share of pixels with other numbers, or with one other number, that are void in pictures that otherwise are clearly trainIds: some
write 19 for void, and the vehicle's own bonnet has a quarter of a picture."""
MEND = (
    "labels are 8-bit PNGs of Cityscapes trainIds, 0 to 18 and 255 = void; name other classes by --label-classes: "
    + ", ".join(n for n in LABEL_CLASSES if n != TRAIN_IDS)
)


def semantic_code(samples: Sequence[Sample], given: str | None = None) -> tuple[SemanticCode, str | None]:
    """What pictures of classes hold.

    Args:
        samples: some of them.
        given: one of ``LABEL_CLASSES``, where the user names it.
    Returns:
        the code, and what a user should know of it, None where they are trainIds.
    Raises:
        DriveError: they hold nothing of what is known.
    """
    if not samples:
        return SemanticCode(given or TRAIN_IDS), None
    if given is not None:
        return _given(samples, given), f"labels are read as {ORDER_NAMES.get(given, given)}, as given"
    if all(s.ids is None for s in samples) or _palette_of_colours(samples):
        return _by_colours(samples)
    if any(s.ids is None for s in samples):
        odd = next(s for s in samples if s.ids is None)
        problem = "Colours here, and numbers in other label pictures"
        raise DriveError(problem, path=odd.path, mend="make all of one kind")
    if any(s.small.lossy for s in samples):
        odd = next(s for s in samples if s.small.lossy)
        problem = "holds numbers of classes in a lossy format, which changes them"
        raise DriveError(problem, path=odd.path, mend="export the labels again as PNG")
    return _by_numbers(samples)


def _given(samples: Sequence[Sample], order: str) -> SemanticCode:
    code = SemanticCode(order, by_palette=order in COLOUR_ORDERS)
    if code.in_colours:
        code, share = _best_turned(samples, order)
        if share < 0.5:
            problem = f"has {1 - share:.0%} pixels of other colours than {order}"
            raise DriveError(problem, path=samples[0].path, mend="name another one by --label-classes")
        return code
    found = _Reading.best_palette(samples, code)
    if found is None:
        strays = _strays(samples, code)
        problem = f"Not a picture of {order}: it holds " + (
            ", ".join(map(str, strays[:4])) if len(strays) else "colours"
        )
        raise DriveError(problem, path=samples[0].path, mend="name another one by --label-classes")
    return found.code


@dataclass(frozen=True, eq=False)
class _Reading:
    """One way to read the samples: ``pictures`` (H, W) of trainIds, and how much they look like a street."""

    code: SemanticCode
    pictures: list[NDArray[np.uint8]]
    likeness: float

    @staticmethod
    def of(samples: Sequence[Sample], code: SemanticCode) -> _Reading | None:
        """None where a number occurs that the code does not have."""
        if len(_strays(samples, code)):
            return None
        pictures = [train_ids(s.small, code, s.path) for s in samples]
        return _Reading(code, pictures, street_likeness(pictures))

    @staticmethod
    def best_palette(samples: Sequence[Sample], code: SemanticCode) -> _Reading | None:
        """Of a picture with a palette of greys, by its numbers or by its greys: what makes files small numbers them anew."""
        ways = [code]
        if all(s.shades is not None for s in samples):
            ways.append(replace(code, by_palette=True))
        found = [r for way in ways if (r := _Reading.of(samples, way)) is not None]
        return max(found, key=lambda r: r.likeness, default=None)

    @property
    def is_a_street(self) -> bool:
        """Whether it shows a street by itself, not only more of one than others."""
        present = set(np.unique(np.concatenate([p.ravel() for p in self.pictures])).tolist()) - {VOID}
        roads = {CITYSCAPES.index(n) for n in ("road", "sidewalk", "terrain")}
        return self.likeness >= SEEN_ON_STREETS and len(present) >= FEWEST_CLASSES and bool(present & roads)


def _numbers(sample: Sample, code: SemanticCode) -> NDArray[np.int64] | None:
    return sample.shades if code.by_palette else sample.ids


def _strays(samples: Sequence[Sample], code: SemanticCode) -> NDArray[np.int64]:
    found = [n for s in samples if (n := _numbers(s, code)) is not None]
    return stray_ids(np.concatenate(found), code) if found else np.zeros(0, np.int64)


def _by_numbers(samples: Sequence[Sample]) -> tuple[SemanticCode, str | None]:
    largest = max(int(s.ids.max(initial=0)) for s in samples if s.ids is not None)
    divisor = PANOPTIC if PANOPTIC <= largest < 0xFFFF or _many_above(samples, PANOPTIC) else 1
    readings = [_Reading.best_palette(samples, SemanticCode(order, divisor)) for order in TRIED]
    known = sorted((r for r in readings if r is not None), key=lambda r: -r.likeness)
    usual = next((r for r in known if r.code.order == TRAIN_IDS), None)
    if usual is not None:
        other = next((r for r in known if r is not usual), None)
        odd = other is not None and other.is_a_street and other.likeness > usual.likeness + VERY_CLEARLY
        clear = odd and all(other.likeness > r.likeness + CLEARLY for r in known if r not in (usual, other))  # type: ignore[union-attr]
        if not clear:
            return usual.code, _told(usual.code)
        assert other is not None
        return other.code, _told(other.code, "by their values, for as trainIds they show no street")
    if known and known[0].is_a_street and (len(known) == 1 or known[0].likeness > known[1].likeness + CLEARLY):
        return known[0].code, _told(known[0].code)
    strays = _strays(samples, SemanticCode(divisor=divisor))
    plain = SemanticCode(divisor=divisor, stray_is_void=True)
    pictures = [train_ids(s.small, plain, s.path) for s in samples]
    share = float(np.mean([np.isin(i, strays).mean() for s in samples if (i := ids_of(s.small)) is not None]))
    alone = _Reading(plain, pictures, street_likeness(pictures))
    others = max((r.likeness for r in known), default=-np.inf)
    if (
        share < (ONE_STRAY if len(strays) == 1 else FEW_STRAY)
        and alone.is_a_street
        and alone.likeness > others + CLEARLY
    ):
        listed = ", ".join(map(str, strays[:4]))
        return plain, f"labels hold {listed}, which are not trainIds, on {share:.1%} of the pixels: they count as void"
    problem = f"holds {', '.join(map(str, strays[:4]))}, which no Cityscapes class has as trainId"
    fitting = ", ".join(ORDER_NAMES[r.code.order] for r in known)
    raise DriveError(problem + (f" (they could be {fitting})" if fitting else ""), path=samples[0].path, mend=MEND)


def _many_above(samples: Sequence[Sample], least: int) -> bool:
    return any(((s.ids >= least) & (s.ids < 0xFFFF)).any() for s in samples if s.ids is not None)


def _told(code: SemanticCode, why: str = "by their values") -> str | None:
    if code.order == TRAIN_IDS and code.divisor == 1:
        return None
    objects = ", each times 1000 plus the number of an object" if code.divisor > 1 else ""
    return f"labels are taken for {ORDER_NAMES[code.order]}{objects}, {why}; --label-classes decides"


def _palette_of_colours(samples: Sequence[Sample]) -> bool:
    """Whether all are pictures with a palette whose colours are those of one table, not only a number's own."""
    if not all(s.small.palette is not None and s.shades is None for s in samples):
        return False
    codes = [SemanticCode(order, blue_first=turned) for order in COLOUR_ORDERS for turned in (False, True)]
    return any(all(_known_share(s, code) >= COLOURED for s in samples) for code in codes)


def _known_share(sample: Sample, code: SemanticCode) -> float:
    colours = colours_of(sample.small, blue_first=code.blue_first)
    return float(train_ids_of_colours(colours, code.order, lossy=sample.small.lossy)[1].mean())


def _best_turned(samples: Sequence[Sample], order: str) -> tuple[SemanticCode, float]:
    """The table's code, with red and blue exchanged if clearly more pixels have its colours so; and their share."""
    codes = [SemanticCode(order, by_palette=True, blue_first=turned) for turned in (False, True)]
    plain, turned = (float(np.mean([_known_share(s, code) for s in samples])) for code in codes)
    return (codes[1], turned) if turned > plain + TURNED and plain < COLOURED else (codes[0], plain)


def _by_colours(samples: Sequence[Sample]) -> tuple[SemanticCode, str | None]:
    found = {order: _best_turned(samples, order) for order in COLOUR_ORDERS}
    shares: dict[str, float] = {order: share for order, (_, share) in found.items()}
    order = max(shares, key=_of(shares))
    lossy = any(s.small.lossy for s in samples)
    code = found[order][0]
    # A grey photograph has many greys that a lossy table has, too.
    odd = lossy and street_likeness([train_ids(s.small, code, s.path) for s in samples]) < SEEN_ON_STREETS
    if odd or shares[order] < (NEARLY_COLOURED if lossy else COLOURED):
        which = ", ".join(
            f"{share:.0%} of {ORDER_NAMES[name].removeprefix('colours of ')}" for name, share in shares.items()
        )
        problem = f"Colours that mean no known classes (of its pixels {which})"
        raise DriveError(problem, path=samples[0].path, mend=MEND)
    turned = " with red and blue exchanged" if code.blue_first else ""
    return code, f"labels are taken for {ORDER_NAMES[order]}{turned}; --label-classes decides"


def _of(shares: dict[str, float]) -> Callable[[str], float]:
    return lambda name: shares[name]
