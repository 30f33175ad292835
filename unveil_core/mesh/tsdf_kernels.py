"""The compiled loops of TSDF fusion: block allocation, integration, surface extraction.

A block holds 8x8x8 voxels; block coordinates are packed into one int64 key, blocks are sorted by key, so that the
result does not depend on the order of insertion or on the number of threads. A voxel (i, j, k) sits at (i, j, k) times
the voxel size.

Depth maps come as inverse depth w = 1/z, 0 where there is none: on a plane w is linear in the pixel coordinates, so
that bilinear interpolation is exact there, and its gradient gives the normal n = (fx w_x, fy w_y, w - (x - cx) w_x -
(y - cy) w_y) in camera coordinates, with n . ray = w. The distance of a point to the tangent plane of its pixel is
then (z_seen - z) * w / |n|.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.kernels.hashing import slot_of
from unveil_core.base.parallel import EXACT, in_parallel
from unveil_core.base.types import Float32, Float64

Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

__all__ = [
    "BLOCK",
    "HALF_KEYS",
    "SMALLEST_COSINE",
    "allocate",
    "count_quads",
    "flattest_factor",
    "integrate",
    "inverse_depth_slopes",
    "mark_cells",
    "place_vertices",
    "rehash",
    "write_quads",
]

BLOCK = 8
VOXELS = BLOCK**3
HALF_KEYS = 1 << 20
SMALLEST_COSINE = 0.05
"""Surfaces seen at a flatter angle are treated as if at this one: their normals are noise."""
JUMP = 1.1
"""Neighbouring pixels whose depths differ by more than this factor lie on different surfaces."""
ROWS, BLOCKS = 16, 64
"""Rows of a picture, and blocks of voxels, that a thread takes at a time: some tenths of a millisecond of work."""


@njit(cache=True, inline="always")
def _one_sided(w, y, x, dy, dx, sign):
    """Derivative of w along (dy, dx) from two pixels on one side, and how much it bends there; inf over a jump."""
    height, width = w.shape
    here = w[y, x]
    y1, x1, y2, x2 = y + sign * dy, x + sign * dx, y + 2 * sign * dy, x + 2 * sign * dx
    if not (0 <= y2 < height and 0 <= x2 < width):
        return 0.0, np.inf
    near, far = w[y1, x1], w[y2, x2]
    if near <= 0 or far <= 0 or max(here, near) > JUMP * min(here, near) or max(near, far) > JUMP * min(near, far):
        return 0.0, np.inf
    first, second = near - here, far - near
    return 0.5 * sign * (first + second), np.float64(abs(first - second))


@njit(cache=True)
def _slope(w, y, x, dy, dx):
    """Derivative of w along (dy, dx), from the side on which w is straight: the other may cross a crease or a jump."""
    before, bend_before = _one_sided(w, y, x, dy, dx, -1)
    after, bend_after = _one_sided(w, y, x, dy, dx, 1)
    if bend_before == np.inf and bend_after == np.inf:
        return 0.0
    # Both sides equally straight: their mean is less noisy.
    noise = 1e-5 * w[y, x]
    if bend_after > 4 * bend_before + noise:
        return before
    if bend_before > 4 * bend_after + noise:
        return after
    return 0.5 * (before + after)


def inverse_depth_slopes(w: Float32, fx: float, fy: float, cx: float, cy: float) -> tuple[Float32, Float32]:
    """Normals in camera coordinates (H, W, 3) float32, unit, facing the camera; and cosine-like factor w/|n| (H, W)."""
    normals = np.zeros((*w.shape, 3), np.float32)
    factor = np.zeros(w.shape, np.float32)
    in_parallel(_slopes, len(w), ROWS, w, fx, fy, cx, cy, normals, factor)
    return normals, factor


def flattest_factor(w: Float32, factor: Float32) -> Float32:
    """(H, W) the factor of :func:`inverse_depth_slopes` of each pixel or of a flatter neighbour, see :func:`_flattest`."""
    flattest = factor.copy()
    in_parallel(_flattest, len(w), ROWS, w, factor, flattest)
    return flattest


@njit(**EXACT)
def _slopes(start, stop, w, fx, fy, cx, cy, normals, factor):
    width = w.shape[1]
    for y in range(start, stop):
        for x in range(width):
            if w[y, x] <= 0:
                continue
            wx, wy = _slope(w, y, x, 0, 1), _slope(w, y, x, 1, 0)
            nx, ny = fx * wx, fy * wy
            nz = w[y, x] - (x + 0.5 - cx) * wx - (y + 0.5 - cy) * wy
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            # n . ray = w > 0 means that n points away from the camera.
            normals[y, x, 0], normals[y, x, 1], normals[y, x, 2] = -nx / length, -ny / length, -nz / length
            ray_x, ray_y = (x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy
            lowest = SMALLEST_COSINE * np.sqrt(1 + ray_x * ray_x + ray_y * ray_y)
            factor[y, x] = max(w[y, x] / length, lowest)


@njit(**EXACT)
def _flattest(start, stop, w, factor, flattest):
    """The smallest factor of each pixel and its neighbours on the same surface, into ``flattest`` (H, W) float32.

    At a flat angle the noise of a depth tilts its normal towards the camera sooner than away from it. Such a pixel would say of
    space just above the road that it is free, and that with more weight than all pixels that know better: holes.
    """
    height, width = w.shape
    for y in range(start, stop):
        for x in range(width):
            if w[y, x] <= 0:
                continue
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    if w[y, x] < JUMP * w[v, u] and w[v, u] < JUMP * w[y, x]:
                        flattest[y, x] = min(flattest[y, x], factor[v, u])


# ----------------------------------------------------------------------------------------------------------- allocation


@njit(cache=True, inline="always")
def _key(bx, by, bz):
    return ((bx + HALF_KEYS) << 42) | ((by + HALF_KEYS) << 21) | (bz + HALF_KEYS)


@njit(cache=True, inline="always")
def _insert(table, key):
    """Open addressing in a power-of-two table of -1 for free slots; 1 where the key is new."""
    mask = table.size - 1
    slot = slot_of(key, table.size)
    while True:
        found = table[slot]
        if found == key:
            return 0
        if found == -1:
            table[slot] = key
            return 1
        slot = (slot + 1) & mask


@njit(cache=True)
def rehash(table, size):
    """The same keys in a table of ``size`` slots."""
    larger = np.full(size, -1, np.int64)
    for key in table:
        if key != -1:
            _insert(larger, key)
    return larger


@njit(cache=True)
def allocate(w, normals, factor, fx, fy, cx, cy, to_world, voxel, truncation, furthest, low, high, table, count):
    """Insert the blocks within the truncation distance of the seen surface.

    Each pixel is sampled as finely as its footprint on the surface asks for, so that road seen at a flat angle gets
    all its blocks. Returns the number of keys, or -1 when the table became too full (call again with a larger one).
    """
    height, width = w.shape
    block = voxel * BLOCK
    limit = table.size // 2
    last = np.int64(-1)
    for y in range(height):
        for x in range(width):
            if w[y, x] <= 0:
                continue
            inverse = np.float64(w[y, x])
            footprint = 1.0 / (inverse * min(fx, fy) * factor[y, x])
            # Close by, a pixel says nothing that its neighbour on the same surface did not say already.
            if footprint * 8 < block and (
                (x & 1 and w[y, x - 1] < JUMP * w[y, x] and w[y, x] < JUMP * w[y, x - 1])
                or (y & 1 and w[y - 1, x] < JUMP * w[y, x] and w[y, x] < JUMP * w[y - 1, x])
            ):
                continue
            wx = -(normals[y, x, 0] / fx)
            wy = -(normals[y, x, 1] / fy)
            ray_x, ray_y = (x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy
            # The slopes of w belong to the unit normal scaled so that n . ray = w.
            scale = -(normals[y, x, 0] * ray_x + normals[y, x, 1] * ray_y + normals[y, x, 2])
            if scale <= 1e-9:
                continue
            wx, wy = wx * inverse / scale, wy * inverse / scale
            samples = min(8, max(1, int(np.ceil(footprint / (0.5 * block)))))
            for sy in range(samples):
                for sx in range(samples):
                    ox, oy = (sx + 0.5) / samples - 0.5, (sy + 0.5) / samples - 0.5
                    sub = inverse + ox * wx + oy * wy
                    if sub * furthest < 1 or sub > 2 * inverse:
                        continue
                    z = 1.0 / sub
                    px, py = (ray_x + ox / fx) * z, (ray_y + oy / fy) * z
                    for step in range(-1, 2):
                        t = step * truncation
                        qx, qy, qz = px + t * normals[y, x, 0], py + t * normals[y, x, 1], z + t * normals[y, x, 2]
                        gx = to_world[0, 0] * qx + to_world[0, 1] * qy + to_world[0, 2] * qz + to_world[0, 3]
                        gy = to_world[1, 0] * qx + to_world[1, 1] * qy + to_world[1, 2] * qz + to_world[1, 3]
                        gz = to_world[2, 0] * qx + to_world[2, 1] * qy + to_world[2, 2] * qz + to_world[2, 3]
                        if not (low[0] <= gx <= high[0] and low[1] <= gy <= high[1] and low[2] <= gz <= high[2]):
                            continue
                        x0, x1 = np.int64(np.floor((gx - voxel) / block)), np.int64(np.floor((gx + voxel) / block))
                        y0, y1 = np.int64(np.floor((gy - voxel) / block)), np.int64(np.floor((gy + voxel) / block))
                        z0, z1 = np.int64(np.floor((gz - voxel) / block)), np.int64(np.floor((gz + voxel) / block))
                        for bx in range(x0, x1 + 1):
                            for by in range(y0, y1 + 1):
                                for bz in range(z0, z1 + 1):
                                    key = _key(bx, by, bz)
                                    if key != last:
                                        count += _insert(table, key)
                                        last = key
                        if count > limit:
                            return -1
    return count


# ---------------------------------------------------------------------------------------------------------- integration


def integrate(
    volume: Float32,
    blocks: Int64,
    chosen: Int64,
    w: Float32,
    factor: Float32,
    weight: Float32,
    rgb: NDArray[np.uint8],
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    to_camera: Float64,
    voxel: float,
    truncation: float,
    furthest: float,
) -> None:
    """Average one view into ``volume`` (B, 512, 6) float32: distance / truncation, weight, r, g, b, colour weight.

    Distances are along the surface normal (see the module), truncated to [-1, 1]. The weight is (cosine / depth)^2, so
    that a flat angle speaks only where no better one does; behind the surface it falls to zero with the distance to
    the tangent plane and with the way along the ray, which curved things leave again long before the plane does.
    """
    in_parallel(
        _integrate,
        len(chosen),
        BLOCKS,
        volume,
        blocks,
        chosen,
        w,
        factor,
        weight,
        rgb,
        fx,
        fy,
        cx,
        cy,
        to_camera,
        voxel,
        truncation,
        furthest,
    )


@njit(**EXACT)
def _integrate(
    start, stop, volume, blocks, chosen, w, factor, weight, rgb, fx, fy, cx, cy, to_camera, voxel, truncation, furthest
):
    height, width = w.shape
    rx0, rx1, rx2, tx = to_camera[0, 0], to_camera[0, 1], to_camera[0, 2], to_camera[0, 3]
    ry0, ry1, ry2, ty = to_camera[1, 0], to_camera[1, 1], to_camera[1, 2], to_camera[1, 3]
    rz0, rz1, rz2, tz = to_camera[2, 0], to_camera[2, 1], to_camera[2, 2], to_camera[2, 3]
    for c in range(start, stop):
        b = chosen[c]
        for i in range(BLOCK):
            gx = (blocks[b, 0] * BLOCK + i) * voxel
            for j in range(BLOCK):
                gy = (blocks[b, 1] * BLOCK + j) * voxel
                for k in range(BLOCK):
                    gz = (blocks[b, 2] * BLOCK + k) * voxel
                    z = rz0 * gx + rz1 * gy + rz2 * gz + tz
                    if z < 1e-3:
                        continue
                    u = fx * (rx0 * gx + rx1 * gy + rx2 * gz + tx) / z + cx
                    v = fy * (ry0 * gx + ry1 * gy + ry2 * gz + ty) / z + cy
                    if not (0 <= u < width and 0 <= v < height):
                        continue
                    x, y = int(u), int(v)
                    near = w[y, x]
                    if near <= 0:
                        continue
                    # Interpolation never moves the depth by more than JUMP: most voxels are far in front or behind.
                    if (JUMP / near - z) * factor[y, x] < -truncation:
                        continue
                    left, top = max(0, int(np.floor(u - 0.5))), max(0, int(np.floor(v - 0.5)))
                    right, bottom = min(width - 1, left + 1), min(height - 1, top + 1)
                    w00, w01, w10, w11 = w[top, left], w[top, right], w[bottom, left], w[bottom, right]
                    smallest, largest = min(min(w00, w01), min(w10, w11)), max(max(w00, w01), max(w10, w11))
                    inverse = np.float64(near)
                    red, green, blue = float(rgb[y, x, 0]), float(rgb[y, x, 1]), float(rgb[y, x, 2])
                    if smallest <= 0 or largest > JUMP * smallest:
                        if 1 / largest - z < truncation < (1 / near - z) * factor[y, x]:
                            # Free by this pixel, not by the next one: the rim of something nearer passes between.
                            continue
                    elif (1 / (JUMP * near) - z) * factor[y, x] < truncation:
                        ax, ay = min(max(u - 0.5 - left, 0.0), 1.0), min(max(v - 0.5 - top, 0.0), 1.0)
                        c00, c01, c10, c11 = (1 - ax) * (1 - ay), ax * (1 - ay), (1 - ax) * ay, ax * ay
                        inverse = c00 * w00 + c01 * w01 + c10 * w10 + c11 * w11
                        p00, p01, p10, p11 = rgb[top, left], rgb[top, right], rgb[bottom, left], rgb[bottom, right]
                        red = c00 * p00[0] + c01 * p01[0] + c10 * p10[0] + c11 * p11[0]
                        green = c00 * p00[1] + c01 * p01[1] + c10 * p10[1] + c11 * p11[1]
                        blue = c00 * p00[2] + c01 * p01[2] + c10 * p10[2] + c11 * p11[2]
                    distance = (1.0 / inverse - z) * factor[y, x] / truncation
                    # A surface beyond the limit still says that the space before it is free.
                    if distance < (1.0 if inverse * furthest < 1 else -1.0):
                        continue
                    trust = weight[y, x] * (factor[y, x] * inverse) ** 2
                    if distance < 0:
                        behind = (z - 1.0 / inverse) / (2 * truncation)
                        trust *= (1 + distance) / (1 + behind * behind)
                    if trust <= 0:
                        continue
                    cell = (i * BLOCK + j) * BLOCK + k
                    old = volume[b, cell, 1]
                    volume[b, cell, 0] = (volume[b, cell, 0] * old + min(distance, 1.0) * trust) / (old + trust)
                    volume[b, cell, 1] = old + trust
                    if distance < 1:
                        old = volume[b, cell, 5]
                        total = old + trust
                        volume[b, cell, 2] = (volume[b, cell, 2] * old + red * trust) / total
                        volume[b, cell, 3] = (volume[b, cell, 3] * old + green * trust) / total
                        volume[b, cell, 4] = (volume[b, cell, 4] * old + blue * trust) / total
                        volume[b, cell, 5] = total


# ----------------------------------------------------------------------------------------------------------- extraction
# Naive surface nets (Gibson, "Constrained elastic surface nets", 1998): one vertex in every cell that the surface
# crosses, at the mean of its edge crossings, and one quad around every crossed edge. Vertices are shared by design, and
# the mesh of a plane is exactly that plane.


@njit(cache=True, inline="always")
def _locate(neighbours, b, i, j, k):
    """Block and voxel index of a voxel up to one block away; block -1 where there is none."""
    di, dj, dk = (i >= BLOCK) - (i < 0), (j >= BLOCK) - (j < 0), (k >= BLOCK) - (k < 0)
    other = neighbours[b, (di + 1) * 9 + (dj + 1) * 3 + dk + 1]
    return other, ((i - di * BLOCK) * BLOCK + j - dj * BLOCK) * BLOCK + k - dk * BLOCK


@njit(cache=True, inline="always")
def _cell_corners(volume, neighbours, b, i, j, k, corners):
    """Fill ``corners`` (8,) with the distances at a cell's corners; False where one of them was never seen."""
    for n in range(8):
        other, cell = _locate(neighbours, b, i + (n >> 2), j + (n >> 1 & 1), k + (n & 1))
        if other < 0 or volume[other, cell, 1] <= 0:
            return False
        corners[n] = volume[other, cell, 0]
    return True


@njit(cache=True, inline="always")
def _crosses(corners, jump):
    """True where the surface passes the cell, and no edge crosses it as steeply as the rim of a silhouette does."""
    crossed = False
    for n in range(8):
        for bit in (1, 2, 4):
            m = n | bit
            if m != n and (corners[n] < 0) != (corners[m] < 0):
                crossed = True
                if abs(corners[n] - corners[m]) > jump:
                    return False
    return crossed


def mark_cells(volume: Float32, neighbours: Int32, jump: np.float32, rank: NDArray[np.int16]) -> Int64:
    """Number the cells that get a vertex within their block: ``rank`` (B, 512) int16, -1 none. Returns (B,) counts."""
    counts = np.zeros(len(volume), np.int64)
    in_parallel(_mark_cells, len(volume), BLOCKS, volume, neighbours, jump, rank, counts)
    return counts


@njit(**EXACT)
def _mark_cells(start, stop, volume, neighbours, jump, rank, counts):
    for b in range(start, stop):
        corners = np.empty(8, np.float32)
        used = 0
        for i in range(BLOCK):
            for j in range(BLOCK):
                for k in range(BLOCK):
                    cell = (i * BLOCK + j) * BLOCK + k
                    rank[b, cell] = -1
                    if volume[b, cell, 1] <= 0 or abs(volume[b, cell, 0]) >= 1:
                        # A crossed cell has no corner at full truncation: the surface is within one voxel of it.
                        continue
                    if _cell_corners(volume, neighbours, b, i, j, k, corners) and _crosses(corners, jump):
                        rank[b, cell] = used
                        used += 1
        counts[b] = used


def place_vertices(
    volume: Float32,
    neighbours: Int32,
    blocks: Int64,
    rank: NDArray[np.int16],
    first: Int64,
    voxel: float,
    vertices: Float32,
    colors: Float32,
) -> None:
    """Positions (V, 3) float32 and colours (V, 3) float32, 0 to 255, at the cells' mean edge crossings."""
    in_parallel(_place_vertices, len(volume), BLOCKS, volume, neighbours, blocks, rank, first, voxel, vertices, colors)


@njit(**EXACT)
def _place_vertices(start, stop, volume, neighbours, blocks, rank, first, voxel, vertices, colors):
    for b in range(start, stop):
        corners = np.empty(8, np.float32)
        for i in range(BLOCK):
            for j in range(BLOCK):
                for k in range(BLOCK):
                    cell = (i * BLOCK + j) * BLOCK + k
                    if rank[b, cell] < 0:
                        continue
                    _cell_corners(volume, neighbours, b, i, j, k, corners)
                    sx, sy, sz, crossings = 0.0, 0.0, 0.0, 0
                    for n in range(8):
                        for bit in (1, 2, 4):
                            m = n | bit
                            if m == n or (corners[n] < 0) == (corners[m] < 0):
                                continue
                            t = corners[n] / (corners[n] - corners[m])
                            sx += (n >> 2) + (t if bit == 4 else 0.0)
                            sy += (n >> 1 & 1) + (t if bit == 2 else 0.0)
                            sz += (n & 1) + (t if bit == 1 else 0.0)
                            crossings += 1
                    sx, sy, sz = sx / crossings, sy / crossings, sz / crossings
                    v = first[b] + rank[b, cell]
                    vertices[v, 0] = (blocks[b, 0] * BLOCK + i + sx) * voxel
                    vertices[v, 1] = (blocks[b, 1] * BLOCK + j + sy) * voxel
                    vertices[v, 2] = (blocks[b, 2] * BLOCK + k + sz) * voxel
                    total, red, green, blue = 0.0, 0.0, 0.0, 0.0
                    for n in range(8):
                        dx, dy, dz = n >> 2, n >> 1 & 1, n & 1
                        other, corner = _locate(neighbours, b, i + dx, j + dy, k + dz)
                        if volume[other, corner, 5] <= 0:
                            continue
                        share = (sx if dx else 1 - sx) * (sy if dy else 1 - sy) * (sz if dz else 1 - sz) + 1e-6
                        total += share
                        red += share * volume[other, corner, 2]
                        green += share * volume[other, corner, 3]
                        blue += share * volume[other, corner, 4]
                    if total > 0:
                        colors[v, 0], colors[v, 1], colors[v, 2] = red / total, green / total, blue / total


@njit(cache=True, inline="always")
def _quad(volume, neighbours, rank, first, b, i, j, k, axis, quad):
    """The four vertices around the edge from voxel (i, j, k) along ``axis``; 0 none, +1 or -1 the outward side."""
    here = (i * BLOCK + j) * BLOCK + k
    other, there = _locate(neighbours, b, i + (axis == 0), j + (axis == 1), k + (axis == 2))
    if other < 0 or volume[other, there, 1] <= 0 or volume[b, here, 1] <= 0:
        return 0
    inside = volume[b, here, 0] < 0
    if inside == (volume[other, there, 0] < 0):
        return 0
    for n in range(4):
        # Around the edge: (0, 0), (1, 0), (1, 1), (0, 1) steps back along the two other axes.
        p, q = int(n == 1 or n == 2), int(n >= 2)
        if axis == 0:
            block, cell = _locate(neighbours, b, i, j - 1 + p, k - 1 + q)
        elif axis == 1:
            block, cell = _locate(neighbours, b, i - 1 + q, j, k - 1 + p)
        else:
            block, cell = _locate(neighbours, b, i - 1 + p, j - 1 + q, k)
        if block < 0 or rank[block, cell] < 0:
            return 0
        quad[n] = first[block] + rank[block, cell]
    return 1 if inside else -1


def count_quads(volume: Float32, neighbours: Int32, rank: NDArray[np.int16], first: Int64) -> Int64:
    """Quads per block, (B,) int64."""
    counts = np.zeros(len(volume), np.int64)
    in_parallel(_count_quads, len(volume), BLOCKS, volume, neighbours, rank, first, counts)
    return counts


@njit(**EXACT)
def _count_quads(start, stop, volume, neighbours, rank, first, counts):
    for b in range(start, stop):
        quad = np.empty(4, np.int64)
        used = 0
        for i in range(BLOCK):
            for j in range(BLOCK):
                for k in range(BLOCK):
                    if abs(volume[b, (i * BLOCK + j) * BLOCK + k, 0]) >= 1:
                        continue
                    for axis in range(3):
                        used += _quad(volume, neighbours, rank, first, b, i, j, k, axis, quad) != 0
        counts[b] = used


def write_quads(
    volume: Float32,
    neighbours: Int32,
    rank: NDArray[np.int16],
    first: Int64,
    first_quad: Int64,
    vertices: Float32,
    faces: Int32,
) -> None:
    """Two triangles a quad, split along the shorter diagonal, counter-clockwise from outside: ``faces`` (2 Q, 3)."""
    in_parallel(_write_quads, len(volume), BLOCKS, volume, neighbours, rank, first, first_quad, vertices, faces)


@njit(**EXACT)
def _write_quads(start, stop, volume, neighbours, rank, first, first_quad, vertices, faces):
    for b in range(start, stop):
        quad = np.empty(4, np.int64)
        f = 2 * first_quad[b]
        for i in range(BLOCK):
            for j in range(BLOCK):
                for k in range(BLOCK):
                    if abs(volume[b, (i * BLOCK + j) * BLOCK + k, 0]) >= 1:
                        continue
                    for axis in range(3):
                        side = _quad(volume, neighbours, rank, first, b, i, j, k, axis, quad)
                        if side == 0:
                            continue
                        v0, v1, v2, v3 = quad[0], quad[1], quad[2], quad[3]
                        if side < 0:
                            v1, v3 = v3, v1
                        d02, d13 = 0.0, 0.0
                        for a in range(3):
                            d02 += (vertices[v0, a] - vertices[v2, a]) ** 2
                            d13 += (vertices[v1, a] - vertices[v3, a]) ** 2
                        if d02 <= d13:
                            faces[f, 0], faces[f, 1], faces[f, 2] = v0, v1, v2
                            faces[f + 1, 0], faces[f + 1, 1], faces[f + 1, 2] = v0, v2, v3
                        else:
                            faces[f, 0], faces[f, 1], faces[f, 2] = v0, v1, v3
                            faces[f + 1, 0], faces[f + 1, 1], faces[f + 1, 2] = v1, v2, v3
                        f += 2
