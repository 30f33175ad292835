"""Extends poles, signs and trunks whose feet a removed object hides down to the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.clusters import connected_points
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["feet_of_poles", "hidden_and_through", "only_hidden"]

LOW_M, HIGH_M = 0.25, 2.6
"""Height over the ground above which a pole that begins there lacks its foot, and up to which poles are looked for, metres:
above a kerb, below most crowns and signs."""
HANGS_M = 2.0
"""Height above which something that begins there hangs, metres: cars hide nothing so high."""
NARROW_M, LINK_M, LEAST = 0.6, 0.2, 25
"""Greatest thickness of a pole or trunk, largest horizontal gap within it, metres, and its fewest surfels. Chosen on the two
sample streets."""
TREE_M = 2.0
"""Distance within which plants have one trunk, metres: the tufts of a low crown hang side by side, and none of them is one."""
SLIM_M = 0.3
"""Greatest thickness of a pole that another sign may stand on, metres."""
FRINGE_M, SLICE_M = 0.1, 0.4
"""Length above its lowest surfels that is left out, because its colours are mixed with what hid it, and length above that which
is repeated downwards, metres. Chosen on the two sample streets."""
BEHIND = 1.1
"""Ratio of the scene's depth to a place's from which on the view saw something else through the place: nothing stands there."""
LEAST_OWN = 4
"""Fewest surfels of a sign's own pole, seen under it, for that to be drawn on to the ground instead of another sign's."""
TUBE_M, RING_M, AROUND = 0.012, 0.03, 6
"""Radius of a plain pole's rings of surfels, metres, distance between these, and surfels of each. With their own extent they make
a tube of 60 to 100 mm; 60 mm are usual for a sign."""
FLOOR_M = 0.05
"""How far under the ground a repeated surfel may lie, metres."""


def feet_of_poles(
    standing: Surfels,
    ground: Ground,
    cameras: Sequence[Camera],
    depths: Sequence[NDArray[np.float32]],
    removed: Sequence[NDArray[np.bool_]],
    *,
    plates: Sequence[int] = (),
    poles: Sequence[int] = (),
) -> Surfels | None:
    """Surfels for the hidden lower ends of poles and trunks; None where none is hidden.

    Args:
        standing: surfels of plants, poles and signs.
        plates: labels of signs and lights, which stand on a pole that does not look like them; poles: labels of such poles.
        cameras, depths, removed: the views, depth (H, W) of the full scene and what is removed (H, W) bool.
    """
    path = ground.path
    means = standing.means.detach().double().numpy()
    street = path.to_street(means)
    height = ground.over(street)
    opaque = standing.opacity_logits.detach().numpy() > 0
    low = np.flatnonzero(opaque & (height > 0) & (height < HIGH_M))
    if len(low) < LEAST:
        return None
    across = (means[low] @ path.axes.T)[:, :2]
    group = connected_points(across, LINK_M)
    is_plate, is_pole = (np.isin(standing.labels.numpy()[low], kinds) for kinds in (plates, poles))
    parts, trunks, hung, post = [], [], [], None
    for g in np.unique(group):
        members = np.flatnonzero(group == g)
        if len(members) < LEAST:
            continue
        begins = float(np.percentile(height[low[members]], 3))
        # Higher up it may carry a crown.
        members = members[height[low[members]] < begins + (FRINGE_M + SLICE_M)]
        thick = np.ptp(np.percentile(across[members], [10, 90], axis=0), axis=0).max()
        plate = is_plate[members].mean() > 0.5
        # Where it stands: the middle of its surfels, on the ground.
        stands = (means[low[members]] - height[low[members], None] * path.axes[2]).mean(axis=0)
        if plate and begins > LOW_M:
            own = low[members[is_pole[members]]]
            if len(own) < LEAST_OWN:
                hung.append((stands, begins))
            else:
                parts.append(_drawn_down(standing, own, height[own], path.axes[2]))
        elif thick < NARROW_M and LOW_M < begins < HANGS_M and not plate:
            if is_pole[members].mean() > 0.5:
                parts += _repeated(standing, low[members], height[low[members]], begins, path.axes[2])
            else:
                trunks.append((members, begins, stands))
        elif (
            thick < SLIM_M
            and begins < LOW_M
            and is_pole[members].mean() > 0.5
            and (post is None or len(members) > len(post[0]))
        ):
            post = low[members], height[low[members]], stands
    taken: list[NDArray[np.float64]] = []
    for members, begins, stands in sorted(
        trunks, key=lambda trunk: trunk[1]
    ):  # tufts hang higher than the trunk reaches
        if all(np.linalg.norm(stands - other) > TREE_M for other in taken):
            taken.append(stands)
            parts += _repeated(standing, low[members], height[low[members]], begins, path.axes[2])
    if post is not None:
        parts += [_set_up(standing, *post, place=place, top=top, up=path.axes[2]) for place, top in hung]
    elif hung and (opaque & np.isin(standing.labels.numpy(), poles)).any():
        like = standing.select(torch.from_numpy(opaque & np.isin(standing.labels.numpy(), poles)))
        parts += [_tube(like, place, top, path.axes) for place, top in hung]
    if not parts:
        return None
    feet = concatenate(parts)
    feet = feet.select(torch.from_numpy(only_hidden(feet, cameras, depths, removed)))
    return feet if len(feet) else None


def _repeated(
    standing: Surfels, index: NDArray[np.int64], height: NDArray[np.float64], begins: float, up: NDArray[np.float64]
) -> list[Surfels]:
    """Copies of a pole's lowest slice, of surfels ``index`` at ``height`` over the ground, down to the ground."""
    start = begins + FRINGE_M
    chosen = (height >= start) & (height < start + SLICE_M)
    if chosen.sum() < LEAST / 5:
        return []
    part = _even_along(standing.select(torch.from_numpy(index[chosen])), height[chosen])
    return _downwards(part, height[chosen], SLICE_M, int(np.ceil(start / SLICE_M)), up)


def _even_along(part: Surfels, height: NDArray[np.float64]) -> Surfels:
    """A slice of a pole as bright at each height as on the whole: repeated, what is dark below and bright above would be a row of
    dashes. What differs beside each other, as bark does, stays."""
    level = np.floor((height - height.min()) / FRINGE_M).astype(int)
    sh = part.sh.clone()
    middle = sh.median(dim=0).values
    for k in np.unique(level):
        at = torch.from_numpy(level == k)
        sh[at] += middle - sh[at].median(dim=0).values
    return replace(part, sh=sh)


def _downwards(
    part: Surfels, height: NDArray[np.float64], step: float, times: int, up: NDArray[np.float64]
) -> list[Surfels]:
    """Copies of surfels at ``height`` over the ground, each ``step`` metres lower than the last, down to the ground."""
    copies = []
    for down in step * np.arange(1, times + 1):
        copy = part.select(torch.from_numpy(height - down > -FLOOR_M))
        copies.append(replace(copy, means=copy.means - down * torch.from_numpy(up).to(copy.means)))
    return copies


def _drawn_down(
    standing: Surfels, index: NDArray[np.int64], height: NDArray[np.float64], up: NDArray[np.float64]
) -> Surfels:
    """Copies, down to the ground, of a short piece of a pole, of surfels ``index`` at ``height`` over the ground, all of its median
    colour: what hides the rest has mixed with some of them."""
    part = standing.select(torch.from_numpy(index))
    part = _coloured(part, part)
    tall = max(FRINGE_M, float(np.ptp(height)))
    return concatenate(_downwards(part, height, tall, int(np.ceil(height.max() / tall)), up))


def _set_up(
    standing: Surfels,
    index: NDArray[np.int64],
    height: NDArray[np.float64],
    stands: NDArray[np.float64],
    *,
    place: NDArray[np.float64],
    top: float,
    up: NDArray[np.float64],
) -> Surfels:
    """A copy of a pole's foot, of surfels ``index`` at ``height`` over the ground, under a sign.

    Args:
        stands, place: (3,) where on the ground the pole stands and where its copy goes; top: its height, metres; up: (3,).
    """
    tall = max(SLICE_M, float(np.ptp(height)))
    part = standing.select(torch.from_numpy(index))
    copies = []
    for k in range(int(np.ceil((top + FRINGE_M) / tall))):
        copy = part.select(torch.from_numpy(height - height.min() + k * tall < top + FRINGE_M))
        shift = place - stands + (k * tall - height.min()) * up
        copies.append(replace(copy, means=copy.means + torch.from_numpy(shift).to(copy.means)))
    return concatenate(copies)


def _coloured(part: Surfels, like: Surfels) -> Surfels:
    """Surfels, all of the median colour of others."""
    return replace(part, sh=like.sh.median(dim=0, keepdim=True).values.expand_as(part.sh).contiguous())


def _tube(like: Surfels, place: NDArray[np.float64], top: float, axes: NDArray[np.float64]) -> Surfels:
    """A pole for a sign on a street where none is seen down to the ground: a tube of the colour of those that are seen higher up.

    Args:
        like: surfels of poles; place: (3,) where on the ground it stands; top: the sign's lower edge, metres; axes: (3, 3) rows
            east, north, up.
    """
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    outward = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
    heights = np.arange(RING_M / 2, top + FRINGE_M, RING_M)
    places = (place + TUBE_M * outward)[None] + heights[:, None, None] * axes[2]
    normals = np.broadcast_to(outward, places.shape).reshape(-1, 3)
    count = len(normals)
    tube = surfels_from_points(
        places.reshape(-1, 3),
        np.zeros((count, 3), np.uint8),
        np.full(count, int(like.labels.mode().values), dtype=np.int64),
        normals,
        np.full(count, RING_M),
        sh_degree=like.sh_degree,
        opacity=0.95,
        scale_factor=0.7,
    )
    return _coloured(tube, like)


def only_hidden(
    feet: Surfels,
    cameras: Sequence[Camera],
    depths: Sequence[NDArray[np.float32]],
    removed: Sequence[NDArray[np.bool_]],
) -> NDArray[np.bool_]:
    """(N,) bool, surfels that a removed object hides in some view, and through which no view saw anything farther away."""
    hidden, through = hidden_and_through(feet.means.detach().double().numpy(), cameras, depths, removed)
    return hidden & ~through


def hidden_and_through(
    places: NDArray[np.float64],
    cameras: Sequence[Camera],
    depths: Sequence[NDArray[np.float32]],
    removed: Sequence[NDArray[np.bool_]],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which places (N, 3) a removed object hides in some view, and through which some view saw what is farther away, (N,) each."""
    hidden, through = np.zeros(len(places), dtype=bool), np.zeros(len(places), dtype=bool)
    for camera, depth, gone in zip(cameras, depths, removed, strict=True):
        pixel, z = camera.project(places)
        inside = np.flatnonzero(camera.in_picture(pixel, z))
        x, y = pixel[inside].astype(np.int64).T
        hidden[inside[gone[y, x]]] = True
        # At the border of what is removed pixels are mixed.
        clear = ~grow(gone, border_px(camera.width, 1))[y, x]
        through[inside[clear & (depth[y, x] > BEHIND * z[inside])]] = True
    return hidden, through
