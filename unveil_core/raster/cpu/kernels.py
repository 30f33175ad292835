"""The CPU rasterizer in numba: project, sort, bin, forward, backward, reduce. See ``raster.spec`` for the mathematics.

One file, because numba's cache is keyed by the file that holds a kernel. What makes it fast, and what silently unmakes it:

* A tile is 16x16 pixels in 4x4 blocks of 16 lanes; every inner loop runs over the 16 lanes of one block. All per-pixel state of
  a tile lies in ONE float32 buffer, block after block, so that LLVM sees constant distances between streams and vectorizes
  without alias checks. The slot of the surfel's label is copied to a fixed place and back for the same reason.
* Index arithmetic is unsigned (no wrap-around selects); constants are float32 (no float64 creeps in); "any lane" is a sum.
* Each surfel-tile intersection writes its own gradient row; rows are then summed per surfel in a fixed order. No atomics, no
  per-thread buffers: results are bitwise the same for any number of threads.

``tests/raster/test_vectorization.py`` counts packed against scalar operations, because losing vectorization costs a factor of four
and breaks nothing else.
"""

# ruff: noqa: E741, N806
# mypy: ignore-errors
from __future__ import annotations

import llvmlite.binding as llvm
import numpy as np
from numba import njit, prange

from unveil_core.raster.spec import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN

# Twenty streams in one loop need more run-time alias checks than LLVM's default of 8 allows.
llvm.set_option("unveil", "--runtime-memory-check-threshold=256")

f32, f64, u64, i64 = np.float32, np.float64, np.uint64, np.int64
FAST = {"fastmath": True, "cache": True, "boundscheck": False, "error_model": "numpy"}

TILE, BLOCK, LANES, BLOCKS_X, BLOCKS = 16, 4, 16, 4, 16
RECORD = 24
"""Floats of a packed surfel: see the ``R_`` offsets."""
ROW = 20
"""Floats of a gradient row: 3 x (n_u, n_v, q) moments, 1/z, opacity, rgb, normal, screen."""

(R_CX, R_CY, R_IZ, R_A0, R_B0, R_A1, R_B1, R_A2, R_B2, R_OPACITY, R_RED, R_GREEN, R_BLUE, R_NX, R_NY, R_NZ, R_Z,
 R_X0, R_X1, R_Y0, R_Y1, R_LABEL) = (u64(k) for k in range(22))  # fmt: skip

ZERO, ONE, TWO, HALF, MINUS = f32(0), f32(1), f32(2), f32(0.5), f32(-1)
A_MIN, A_MAX, T_MIN = f32(ALPHA_MIN), f32(ALPHA_MAX), f32(TRANSMITTANCE_MIN)
# exp(-x) on [0, 5.7] as (p(-x / 8))^8: beyond 5.7 alpha is under 1/255 whatever the opacity. Relative error 2e-6.
X_MAX, EIGHTH = f32(5.7), f32(0.125)
E0, E1, E2, E3, E4, E5 = (
    f32(0.999999903), f32(-0.999991289), f32(0.499867671), f32(-0.16591143), f32(0.0396654613), f32(-0.00578264651),
)  # fmt: skip
L16 = u64(16)

# ---- planes of the output, (11 + K, H, W)
P_RED, P_GREEN, P_BLUE, P_ALPHA, P_DEPTH, P_MEDIAN, P_NX, P_NY, P_NZ, P_DIST, P_LDIST, P_SEM = range(12)

# ---- forward state of one block: planes of 16 lanes; the first six are what backward needs
(F_T, F_M1, F_M2, F_LAST, F_MEDIAN_I, F_FIRST, F_LIVE, F_RED, F_GREEN, F_BLUE, F_NX, F_NY, F_NZ, F_DEPTH, F_DIST, F_LDIST,
 F_MEDIAN, F_X, F_Y, F_ALPHA, F_INV, F_DEP, F_SEM, F_LT, F_LM1, F_LM2, F_LFIRST) = (
    u64(16 * k) for k in range(27)
)  # fmt: skip
F_LABELS = 27 * 16
LABEL_SLOT = 5 * 16
KEPT = 6 * 16
KEPT_LABEL = 4 * 16
PLAIN_SOURCE = tuple(int(v) for v in (F_RED, F_GREEN, F_BLUE))
GEOMETRY_SOURCE = tuple(int(v) for v in (F_DEPTH, F_MEDIAN, F_NX, F_NY, F_NZ, F_DIST, F_LDIST))


def forward_template(label_count):
    """Initial forward state of a whole tile, flat float32."""
    stride = F_LABELS + label_count * LABEL_SLOT
    state = np.zeros((BLOCKS, stride), np.float32)
    block, lane = np.mgrid[0:BLOCKS, 0:LANES]
    state[:, int(F_X) : int(F_X) + 16] = (block % BLOCKS_X) * BLOCK + lane % BLOCK + 0.5
    state[:, int(F_Y) : int(F_Y) + 16] = (block // BLOCKS_X) * BLOCK + lane // BLOCK + 0.5
    for plane, value in ((F_T, 1), (F_LAST, -1), (F_MEDIAN_I, -1), (F_LIVE, 1)):
        state[:, int(plane) : int(plane) + 16] = value
    for k in range(label_count):
        start = F_LABELS + k * LABEL_SLOT + 16
        state[:, start : start + 16] = 1
    return state.ravel()


def kept_size(label_count):
    """Floats that a tile keeps for backward; the last one is the mask of labels met."""
    return BLOCKS * (KEPT + label_count * KEPT_LABEL) + 1


@njit(**FAST)
def forward_tile(t, tiles_x, template, records, offsets, ids, width, height, c1, inv_near, label_count, geometry, labels,
                 out, kept):  # fmt: skip
    """Composite one tile. ``geometry`` and ``labels`` switch whole groups of planes off."""
    stride = F_LABELS + label_count * LABEL_SLOT
    tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
    first, last = offsets[t], offsets[t + 1]
    state = np.empty(BLOCKS * stride, f32)
    for i in range(u64(BLOCKS * stride)):
        state[i] = template[i]
    alive = np.ones(BLOCKS, np.int32)
    alive_count = BLOCKS
    ftx, fty = f32(tx), f32(ty)
    if tx + TILE > width or ty + TILE > height:
        alive_count = 0
        for b in range(BLOCKS):
            alive[b] = 0
            for l in range(16):
                x, y = tx + (b % BLOCKS_X) * BLOCK + l % BLOCK, ty + (b // BLOCKS_X) * BLOCK + l // BLOCK
                inside = ONE if (x < width and y < height) else ZERO
                state[u64(b * stride + l) + F_LIVE] = inside
                if inside > ZERO:
                    alive[b] = 1
            alive_count += alive[b]
    met = 0
    for i in range(first, last):
        if alive_count == 0:
            break
        g = u64(ids[i])
        cx, cy, iz = records[g, R_CX] - ftx, records[g, R_CY] - fty, records[g, R_IZ]
        a0, b0, a1, b1 = records[g, R_A0], records[g, R_B0], records[g, R_A1], records[g, R_B1]
        a2, b2, opacity = records[g, R_A2], records[g, R_B2], records[g, R_OPACITY]
        red, green, blue = records[g, R_RED], records[g, R_GREEN], records[g, R_BLUE]
        nx, ny, nz, z = records[g, R_NX], records[g, R_NY], records[g, R_NZ], records[g, R_Z]
        label = i64(records[g, R_LABEL])
        rank = f32(i - first)
        bx0 = max(0, i64(records[g, R_X0]) - tx) // BLOCK
        bx1 = min(TILE - 1, i64(records[g, R_X1]) - 1 - tx) // BLOCK
        by0 = max(0, i64(records[g, R_Y0]) - ty) // BLOCK
        by1 = min(TILE - 1, i64(records[g, R_Y1]) - 1 - ty) // BLOCK
        for by in range(by0, by1 + 1):
            for bx in range(bx0, bx1 + 1):
                b = by * BLOCKS_X + bx
                if alive[b] == 0:
                    continue
                o = u64(b * stride)
                some, stopping = ZERO, ZERO
                for l in range(L16):
                    j = o + l
                    dx, dy = state[F_X + j] - cx, state[F_Y + j] - cy
                    nu, nv = a0 * dx + b0 * dy, a1 * dx + b1 * dy
                    q = ONE + a2 * dx + b2 * dy
                    r = ONE / q
                    u, v = nu * r, nv * r
                    exact, screen = u * u + v * v, TWO * (dx * dx + dy * dy)
                    use_exact = exact <= screen
                    x = (exact if use_exact else screen) * HALF
                    x = x if x < X_MAX else X_MAX
                    x = x * EIGHTH
                    e = ((((E5 * x + E4) * x + E3) * x + E2) * x + E1) * x + E0
                    e = e * e
                    e = e * e
                    e = e * e
                    alpha = e * opacity
                    alpha = alpha if alpha < A_MAX else A_MAX
                    inv = q * iz if use_exact else iz
                    dep = r * z if use_exact else z
                    alpha = alpha * state[F_LIVE + j]
                    alpha = alpha if alpha >= A_MIN else ZERO
                    alpha = alpha if inv > ZERO else ZERO
                    alpha = alpha if inv <= inv_near else ZERO
                    state[F_ALPHA + j] = alpha
                    state[F_INV + j] = inv
                    state[F_DEP + j] = dep
                    some += alpha
                    stopping += ONE if state[F_T + j] * (ONE - alpha) < T_MIN else ZERO
                if some <= ZERO:
                    continue
                if stopping > ZERO:
                    living = 0
                    for l in range(L16):
                        j = o + l
                        alpha = state[F_ALPHA + j]
                        if alpha > ZERO and state[F_T + j] * (ONE - alpha) < T_MIN:
                            state[F_ALPHA + j] = ZERO
                            state[F_LIVE + j] = ZERO
                        if state[F_LIVE + j] > ZERO:
                            living += 1
                    if living == 0:
                        alive[b] = 0
                        alive_count -= 1
                if geometry:
                    for l in range(L16):
                        j = o + l
                        alpha, inv, d, light = state[F_ALPHA + j], state[F_INV + j], state[F_DEP + j], state[F_T + j]
                        w = alpha * light
                        start = state[F_FIRST + j]
                        begins = alpha if light >= ONE else ZERO
                        start = inv if begins > ZERO else start
                        state[F_FIRST + j] = start
                        m = c1 * (start - inv)
                        m1, m2, mm = state[F_M1 + j], state[F_M2 + j], m * m
                        state[F_NX + j] += w * nx
                        state[F_NY + j] += w * ny
                        state[F_NZ + j] += w * nz
                        state[F_DEPTH + j] += w * d
                        state[F_DIST + j] += w * (mm * (ONE - light) + m2 - TWO * m * m1)
                        state[F_M1 + j] = m1 + w * m
                        state[F_M2 + j] = m2 + w * mm
                        middle = alpha if light > HALF else ZERO
                        old, old_i = state[F_MEDIAN + j], state[F_MEDIAN_I + j]
                        state[F_MEDIAN + j] = d if middle > ZERO else old
                        state[F_MEDIAN_I + j] = rank if middle > ZERO else old_i
                if labels:
                    met |= 1 << label
                    slot = u64(b * stride + F_LABELS + label * LABEL_SLOT)
                    for l in range(80):
                        state[o + F_SEM + u64(l)] = state[slot + u64(l)]
                    for l in range(L16):
                        j = o + l
                        alpha, inv, light = state[F_ALPHA + j], state[F_INV + j], state[F_LT + j]
                        state[F_SEM + j] += alpha * state[F_T + j]
                        w = alpha * light
                        start = state[F_LFIRST + j]
                        begins = alpha if light >= ONE else ZERO
                        start = inv if begins > ZERO else start
                        state[F_LFIRST + j] = start
                        m = c1 * (start - inv)
                        m1, m2, mm = state[F_LM1 + j], state[F_LM2 + j], m * m
                        state[F_LDIST + j] += w * (mm * (ONE - light) + m2 - TWO * m * m1)
                        state[F_LM1 + j] = m1 + w * m
                        state[F_LM2 + j] = m2 + w * mm
                        state[F_LT + j] = light * (ONE - alpha)
                    for l in range(80):
                        state[slot + u64(l)] = state[o + F_SEM + u64(l)]
                for l in range(L16):
                    j = o + l
                    alpha, light = state[F_ALPHA + j], state[F_T + j]
                    w = alpha * light
                    state[F_RED + j] += w * red
                    state[F_GREEN + j] += w * green
                    state[F_BLUE + j] += w * blue
                    state[F_T + j] = light * (ONE - alpha)
                    old = state[F_LAST + j]
                    state[F_LAST + j] = rank if alpha > ZERO else old
    for b in range(BLOCKS):
        for row in range(BLOCK):
            y = ty + (b // BLOCKS_X) * BLOCK + row
            x0 = tx + (b % BLOCKS_X) * BLOCK
            count = min(BLOCK, width - x0)
            if y >= height or count <= 0:
                continue
            j0 = b * stride + row * BLOCK
            for c in range(count):
                at = u64(j0 + c)
                for k in range(3):
                    out[k, y, x0 + c] = state[at + u64(PLAIN_SOURCE[k])]
                out[P_ALPHA, y, x0 + c] = ONE - state[at + F_T]
                if geometry:
                    for k in range(6):
                        out[P_DEPTH + k, y, x0 + c] = state[at + u64(GEOMETRY_SOURCE[k])]
                if labels:
                    out[P_LDIST, y, x0 + c] = state[at + F_LDIST]
                    for k in range(label_count):
                        out[P_SEM + k, y, x0 + c] = state[at + u64(F_LABELS + k * LABEL_SLOT)]
    keep = kept[t]
    kept_stride = KEPT + label_count * KEPT_LABEL
    for b in range(BLOCKS):
        for l in range(KEPT):
            keep[u64(b * kept_stride + l)] = state[u64(b * stride + l)]
        if labels:
            for k in range(label_count):
                if (met >> k) & 1:
                    for l in range(KEPT_LABEL):
                        keep[u64(b * kept_stride + KEPT + k * KEPT_LABEL + l)] = state[
                            u64(b * stride + F_LABELS + k * LABEL_SLOT + 16 + l)
                        ]
    keep[u64(BLOCKS * kept_stride)] = f32(met)


@njit(parallel=True, **FAST)
def forward(template, records, offsets, ids, width, height, c1, inv_near, label_count, geometry, labels, out, kept):
    """All tiles."""
    tiles_x, tiles_y = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    for t in prange(tiles_x * tiles_y):
        forward_tile(i64(t), tiles_x, template, records, offsets, ids, width, height, c1, inv_near, label_count,
                     geometry, labels, out, kept)  # fmt: skip


# ---- backward state of one block
(B_T, B_M1, B_M2, B_LAST, B_MEDIAN_I, B_FIRST, B_SUM, B_GA, B_X, B_Y, X_ALPHA, X_INV, X_R, X_U, X_V, X_E, X_Q, X_DEP,
 X_EXACT, X_DA, X_DM, X_RA, X_W, X_SEM, B_LT, B_LM1, B_LM2, B_LFIRST, B_LSUM, B_LGA) = (
    u64(16 * k) for k in range(30)
)  # fmt: skip
G_PLANES = 30 * 16
(G_RED, G_GREEN, G_BLUE, G_ALPHA, G_DEPTH, G_MEDIAN, G_NX, G_NY, G_NZ, G_DIST, G_LDIST) = (
    u64(G_PLANES + 16 * k) for k in range(11)
)  # fmt: skip
B_ACC = G_PLANES + 11 * 16
"""19 lane accumulators of the surfel at hand."""
B_SEMANTIC = B_ACC + 19 * 16
"""Per label: its semantic gradient, then the six planes of its distortion."""
B_LABEL_SLOT = 7 * 16


@njit(**FAST)
def backward_tile(t, tiles_x, records, offsets, ids, width, height, c1, inv_near, label_count, geometry, labels, kept,
                  grad, rows):  # fmt: skip
    """Gradient rows of one tile's intersections, walking its surfels from far to near."""
    stride = B_SEMANTIC + label_count * B_LABEL_SLOT
    tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
    first = offsets[t]
    count = offsets[t + 1] - first
    if count == 0:
        return
    ftx, fty = f32(tx), f32(ty)
    state = np.zeros(BLOCKS * stride, f32)
    keep = kept[t]
    kept_stride = KEPT + label_count * KEPT_LABEL
    met = i64(keep[u64(BLOCKS * kept_stride)])
    block_last = np.full(BLOCKS, -1, np.int64)
    tile_last = -1
    for b in range(BLOCKS):
        o = b * stride
        for l in range(KEPT):
            state[u64(o + l)] = keep[u64(b * kept_stride + l)]
        for l in range(16):
            x, y = tx + (b % BLOCKS_X) * BLOCK + l % BLOCK, ty + (b // BLOCKS_X) * BLOCK + l // BLOCK
            j = u64(o + l)
            state[j + B_X] = f32(x - tx) + HALF
            state[j + B_Y] = f32(y - ty) + HALF
            block_last[b] = max(block_last[b], i64(state[B_LAST + j]))
            if x < width and y < height:
                for k in range(4):
                    state[u64(G_PLANES + 16 * k) + j] = grad[k, y, x]
                if geometry:
                    for k in range(4, 10):
                        state[u64(G_PLANES + 16 * k) + j] = grad[k, y, x]
                if labels:
                    state[G_LDIST + j] = grad[P_LDIST, y, x]
                    for k in range(label_count):
                        state[u64(B_SEMANTIC + k * B_LABEL_SLOT) + j] = grad[P_SEM + k, y, x]
        tile_last = max(tile_last, block_last[b])
        oo = u64(o)
        # dL_d/dw_i = m_i^2 A + Q - 2 m_i M with the totals A, M, Q: scaled by the incoming gradient once, here.
        for l in range(L16):
            j = oo + l
            gd = state[G_DIST + j]
            state[B_GA + j] = gd * (ONE - state[B_T + j])
            state[G_ALPHA + j] += gd * state[B_M2 + j]
            state[B_M1 + j] *= gd
        if labels:
            for k in range(label_count):
                if (met >> k) & 1:
                    source = b * kept_stride + KEPT + k * KEPT_LABEL
                    slot = u64(o + B_SEMANTIC + k * B_LABEL_SLOT + 16)
                    for l in range(KEPT_LABEL):
                        state[slot + u64(l)] = keep[u64(source + l)]
                    for l in range(L16):
                        j = slot + l
                        gd = state[G_LDIST + oo + l]
                        light, m1, m2 = state[j], state[j + u64(16)], state[j + u64(32)]
                        state[j + u64(16)] = gd * m1
                        state[j + u64(32)] = gd * m2
                        state[j + u64(64)] = ZERO
                        state[j + u64(80)] = gd * (ONE - light)
    minus_two_c1 = f32(-2) * c1
    for back in range(count - 1, -1, -1):
        i = u64(first + back)
        if back > tile_last:
            for k in range(ROW):
                rows[i, u64(k)] = ZERO
            continue
        g = u64(ids[i])
        cx, cy, iz = records[g, R_CX] - ftx, records[g, R_CY] - fty, records[g, R_IZ]
        a0, b0, a1, b1 = records[g, R_A0], records[g, R_B0], records[g, R_A1], records[g, R_B1]
        a2, b2, opacity = records[g, R_A2], records[g, R_B2], records[g, R_OPACITY]
        red, green, blue = records[g, R_RED], records[g, R_GREEN], records[g, R_BLUE]
        nx, ny, nz, z = records[g, R_NX], records[g, R_NY], records[g, R_NZ], records[g, R_Z]
        label = i64(records[g, R_LABEL])
        rank = f32(back)
        bx0 = max(0, i64(records[g, R_X0]) - tx) // BLOCK
        bx1 = min(TILE - 1, i64(records[g, R_X1]) - 1 - tx) // BLOCK
        by0 = max(0, i64(records[g, R_Y0]) - ty) // BLOCK
        by1 = min(TILE - 1, i64(records[g, R_Y1]) - 1 - ty) // BLOCK
        hit = False
        previous = u64(0)
        for by in range(by0, by1 + 1):
            for bx in range(bx0, bx1 + 1):
                b = by * BLOCKS_X + bx
                if back > block_last[b]:
                    continue
                o = u64(b * stride)
                some = ZERO
                for l in range(L16):
                    j = o + l
                    dx, dy = state[B_X + j] - cx, state[B_Y + j] - cy
                    nu, nv = a0 * dx + b0 * dy, a1 * dx + b1 * dy
                    q = ONE + a2 * dx + b2 * dy
                    r = ONE / q
                    u, v = nu * r, nv * r
                    exact, screen = u * u + v * v, TWO * (dx * dx + dy * dy)
                    use_exact = exact <= screen
                    x = (exact if use_exact else screen) * HALF
                    x = x if x < X_MAX else X_MAX
                    x = x * EIGHTH
                    e = ((((E5 * x + E4) * x + E3) * x + E2) * x + E1) * x + E0
                    e = e * e
                    e = e * e
                    e = e * e
                    raw = e * opacity
                    alpha = raw if raw < A_MAX else A_MAX
                    inv = q * iz if use_exact else iz
                    dep = r * z if use_exact else z
                    alpha = alpha if state[B_LAST + j] >= rank else ZERO
                    alpha = alpha if alpha >= A_MIN else ZERO
                    alpha = alpha if inv > ZERO else ZERO
                    alpha = alpha if inv <= inv_near else ZERO
                    state[X_ALPHA + j] = alpha
                    state[X_INV + j] = inv
                    state[X_R + j] = r
                    state[X_U + j] = u
                    state[X_V + j] = v
                    state[X_E + j] = e if raw <= A_MAX else ZERO
                    state[X_Q + j] = q
                    state[X_DEP + j] = dep
                    state[X_EXACT + j] = ONE if use_exact else ZERO
                    some += alpha
                if some <= ZERO:
                    continue
                # The lane accumulators travel with the block that is being worked on: one horizontal sum per surfel.
                if not hit:
                    for l in range(19 * 16):
                        state[o + u64(B_ACC) + u64(l)] = ZERO
                    hit = True
                elif previous != o:
                    for l in range(19 * 16):
                        state[o + u64(B_ACC) + u64(l)] = state[previous + u64(B_ACC) + u64(l)]
                previous = o
                if labels:
                    slot = u64(B_SEMANTIC + label * B_LABEL_SLOT) + o
                    for l in range(16):
                        state[o + X_SEM + u64(l)] = state[slot + u64(l)]
                for l in range(L16):
                    j = o + l
                    alpha = state[X_ALPHA + j]
                    ra = ONE / (ONE - alpha)
                    light = state[B_T + j] * ra
                    state[B_T + j] = light
                    w = alpha * light
                    value = state[G_RED + j] * red + state[G_GREEN + j] * green + state[G_BLUE + j] * blue
                    value += state[G_ALPHA + j] + state[X_SEM + j]
                    state[X_RA + j] = ra
                    state[X_W + j] = w
                    state[X_DM + j] = ZERO
                    state[X_DA + j] = value
                if geometry:
                    for l in range(L16):
                        j = o + l
                        m = c1 * (state[B_FIRST + j] - state[X_INV + j])
                        ga, gm = state[B_GA + j], state[B_M1 + j]
                        value = state[G_DEPTH + j] * state[X_DEP + j]
                        value += state[G_NX + j] * nx + state[G_NY + j] * ny + state[G_NZ + j] * nz
                        value += m * (m * ga - TWO * gm)
                        state[X_DA + j] += value
                        state[X_DM + j] = state[X_W + j] * (m * ga - gm)
                for l in range(L16):
                    j = o + l
                    value, w, total = state[X_DA + j], state[X_W + j], state[B_SUM + j]
                    state[X_DA + j] = state[B_T + j] * value - total * state[X_RA + j]
                    state[B_SUM + j] = total + w * value
                if labels:
                    slot = u64(B_SEMANTIC + label * B_LABEL_SLOT + 16) + o
                    for l in range(96):
                        state[o + B_LT + u64(l)] = state[slot + u64(l)]
                    for l in range(L16):
                        j = o + l
                        alpha, ra = state[X_ALPHA + j], state[X_RA + j]
                        m = c1 * (state[B_LFIRST + j] - state[X_INV + j])
                        light = state[B_LT + j] * ra
                        state[B_LT + j] = light
                        w = alpha * light
                        gm, ga = state[B_LM1 + j], state[B_LGA + j]
                        value = m * (m * ga - TWO * gm) + state[B_LM2 + j]
                        total = state[B_LSUM + j]
                        state[X_DA + j] += light * value - total * ra
                        state[B_LSUM + j] = total + w * value
                        state[X_DM + j] += w * (m * ga - gm)
                    for l in range(96):
                        state[slot + u64(l)] = state[o + B_LT + u64(l)]
                for l in range(L16):
                    j = o + l
                    alpha, w, e, ex = state[X_ALPHA + j], state[X_W + j], state[X_E + j], state[X_EXACT + j]
                    r, u, v, q, d = state[X_R + j], state[X_U + j], state[X_V + j], state[X_Q + j], state[X_DEP + j]
                    dx, dy = state[B_X + j] - cx, state[B_Y + j] - cy
                    da = state[X_DA + j]
                    da = da if alpha > ZERO else ZERO
                    da = da if e > ZERO else ZERO
                    gmed = state[G_MEDIAN + j]
                    gmed = gmed if alpha > ZERO else ZERO
                    gmed = gmed if state[B_MEDIAN_I + j] == rank else ZERO
                    ginv = minus_two_c1 * state[X_DM + j] - (w * state[G_DEPTH + j] + gmed) * d * d
                    ginv = ginv if alpha > ZERO else ZERO
                    h = da * alpha
                    h3 = h * ex
                    h2 = h - h3
                    hr = h3 * r
                    gnu, gnv, gq = -hr * u, -hr * v, hr * (u * u + v * v) + ginv * iz * ex
                    k = u64(B_ACC) + j
                    state[k] += gnu
                    state[k + u64(16)] += gnu * dx
                    state[k + u64(32)] += gnu * dy
                    state[k + u64(48)] += gnv
                    state[k + u64(64)] += gnv * dx
                    state[k + u64(80)] += gnv * dy
                    state[k + u64(96)] += gq
                    state[k + u64(112)] += gq * dx
                    state[k + u64(128)] += gq * dy
                    scaled = ginv * q
                    state[k + u64(144)] += scaled if ex > ZERO else ginv
                    state[k + u64(160)] += da * e
                    state[k + u64(176)] += w * state[G_RED + j]
                    state[k + u64(192)] += w * state[G_GREEN + j]
                    state[k + u64(208)] += w * state[G_BLUE + j]
                    state[k + u64(224)] += w * state[G_NX + j]
                    state[k + u64(240)] += w * state[G_NY + j]
                    state[k + u64(256)] += w * state[G_NZ + j]
                    state[k + u64(272)] += h2 * dx
                    state[k + u64(288)] += h2 * dy
        if hit:
            for k in range(19):
                total = ZERO
                for l in range(L16):
                    total += state[previous + u64(B_ACC + k * 16) + l]
                rows[i, u64(k)] = total
            rows[i, u64(19)] = ZERO
        else:
            for k in range(ROW):
                rows[i, u64(k)] = ZERO


@njit(parallel=True, **FAST)
def backward(records, offsets, ids, width, height, c1, inv_near, label_count, geometry, labels, kept, grad, rows):
    """All tiles."""
    tiles_x, tiles_y = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    for t in prange(tiles_x * tiles_y):
        backward_tile(i64(t), tiles_x, records, offsets, ids, width, height, c1, inv_near, label_count, geometry, labels,
                      kept, grad, rows)  # fmt: skip


# ---------------------------------------------------------------------------------- project, sort, bin, reduce (scalar code)


@njit(inline="always")
def rotation(q0, q1, q2, q3):
    """Inverse norm, unit quaternion and the nine entries of its rotation; a zero quaternion is no rotation."""
    norm = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
    tiny = norm < f32(1e-24)
    inverse = ZERO if tiny else ONE / np.sqrt(norm)
    w = ONE if tiny else q0 * inverse
    x, y, z = q1 * inverse, q2 * inverse, q3 * inverse
    return (inverse, w, x, y, z,
            ONE - TWO * (y * y + z * z), TWO * (x * y - w * z), TWO * (x * z + w * y),
            TWO * (x * y + w * z), ONE - TWO * (x * x + z * z), TWO * (y * z - w * x),
            TWO * (x * z - w * y), TWO * (y * z + w * x), ONE - TWO * (x * x + y * y))  # fmt: skip


F255, TINY, EDGE = f32(255), f32(1e-6), f32(-1e-6)
JUST_ABOVE_HALF, JUST_BELOW_HALF = f32(0.501), f32(0.499)


@njit(parallel=True, **FAST)
def project(means, quats, scales, opacity, rgb, labels, R, t, fx, fy, cx0, cy0, width, height, near, records, visible):
    """Records of the surfels that can touch the image; ``visible`` (N,) uint8."""
    fw, fh = f32(width), f32(height)
    for i in prange(means.shape[0]):
        visible[i] = 0
        o = opacity[i]
        X = R[0, 0] * means[i, 0] + R[0, 1] * means[i, 1] + R[0, 2] * means[i, 2] + t[0]
        Y = R[1, 0] * means[i, 0] + R[1, 1] * means[i, 1] + R[1, 2] * means[i, 2] + t[1]
        Z = R[2, 0] * means[i, 0] + R[2, 1] * means[i, 1] + R[2, 2] * means[i, 2] + t[2]
        if not (o >= A_MIN and Z > near):
            continue
        _, _, _, _, _, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
            f64(quats[i, 0]), f64(quats[i, 1]), f64(quats[i, 2]), f64(quats[i, 3])
        )
        s0, s1 = scales[i, 0], scales[i, 1]
        h00 = (R[0, 0] * r0 + R[0, 1] * r3 + R[0, 2] * r6) * s0
        h01 = (R[1, 0] * r0 + R[1, 1] * r3 + R[1, 2] * r6) * s0
        h02 = (R[2, 0] * r0 + R[2, 1] * r3 + R[2, 2] * r6) * s0
        h10 = (R[0, 0] * r1 + R[0, 1] * r4 + R[0, 2] * r7) * s1
        h11 = (R[1, 0] * r1 + R[1, 1] * r4 + R[1, 2] * r7) * s1
        h12 = (R[2, 0] * r1 + R[2, 1] * r4 + R[2, 2] * r7) * s1
        nx = R[0, 0] * r2 + R[0, 1] * r5 + R[0, 2] * r8
        ny = R[1, 0] * r2 + R[1, 1] * r5 + R[1, 2] * r8
        nz = R[2, 0] * r2 + R[2, 1] * r5 + R[2, 2] * r8
        if nx * X + ny * Y + nz * Z > ZERO:
            nx, ny, nz = -nx, -ny, -nz
        iz = ONE / Z
        xn, yn = X * iz, Y * iz
        cx, cy = fx * xn + cx0, fy * yn + cy0
        U0, U1 = fx * (h00 - xn * h02), fx * (h10 - xn * h12)
        V0, V1 = fy * (h01 - yn * h02), fy * (h11 - yn * h12)
        # Exact support: G falls under 1/(255 o) at radius sqrt(k2). The bounds of the projected ellipse, or the whole
        # image for a disc whose support crosses the camera's plane; never smaller than the low-pass filter's circle.
        k2 = TWO * np.log(F255 * o)
        low = np.sqrt(HALF * k2)
        d = k2 * (h02 * h02 + h12 * h12) - Z * Z
        x0, x1, y0, y1 = ZERO, fw, ZERO, fh
        if d < EDGE * Z * Z:
            g = ONE / d
            ex, ey = k2 * (U0 * h02 + U1 * h12) * g, k2 * (V0 * h02 + V1 * h12) * g
            hx = np.sqrt(max(ex * ex - k2 * (U0 * U0 + U1 * U1) * g, ZERO))
            hy = np.sqrt(max(ey * ey - k2 * (V0 * V0 + V1 * V1) * g, ZERO))
            x0, x1 = cx + min(ex - hx, -low), cx + max(ex + hx, low)
            y0, y1 = cy + min(ey - hy, -low), cy + max(ey + hy, low)
        x0 = max(ZERO, f32(np.floor(min(x0, fw + ONE) - JUST_ABOVE_HALF)) + ONE)
        x1 = min(fw, f32(np.floor(max(x1, MINUS) - JUST_BELOW_HALF)) + ONE)
        y0 = max(ZERO, f32(np.floor(min(y0, fh + ONE) - JUST_ABOVE_HALF)) + ONE)
        y1 = min(fh, f32(np.floor(max(y1, MINUS) - JUST_BELOW_HALF)) + ONE)
        if not (x1 > x0 and y1 > y0):
            continue
        determinant = U0 * V1 - U1 * V0
        # Edge-on: the low-pass filter carries the surfel; the exact term only has to stay finite and large.
        if abs(determinant) < TINY * (abs(U0 * V1) + abs(U1 * V0)) + f32(1e-30):
            determinant = TINY * (abs(U0 * V1) + abs(U1 * V0)) + f32(1e-30)
        g = Z / determinant
        a0, b0, a1, b1 = V1 * g, -U1 * g, -V0 * g, U0 * g
        records[i, R_CX] = cx
        records[i, R_CY] = cy
        records[i, R_IZ] = iz
        records[i, R_A0] = a0
        records[i, R_B0] = b0
        records[i, R_A1] = a1
        records[i, R_B1] = b1
        records[i, R_A2] = -(h02 * a0 + h12 * a1) * iz
        records[i, R_B2] = -(h02 * b0 + h12 * b1) * iz
        records[i, R_OPACITY] = o
        records[i, R_RED] = rgb[i, 0]
        records[i, R_GREEN] = rgb[i, 1]
        records[i, R_BLUE] = rgb[i, 2]
        records[i, R_NX] = nx
        records[i, R_NY] = ny
        records[i, R_NZ] = nz
        records[i, R_Z] = Z
        records[i, R_X0] = x0
        records[i, R_X1] = x1
        records[i, R_Y0] = y0
        records[i, R_Y1] = y1
        records[i, R_LABEL] = f32(labels[i])
        visible[i] = 1


@njit(**FAST)
def depth_order(depth_bits, visible):
    """Indices of the visible surfels by depth, ties by index: a radix sort of the bits of positive floats."""
    count = 0
    for i in range(len(visible)):
        count += visible[i]
    a, b = np.empty(count, np.uint64), np.empty(count, np.uint64)
    k = 0
    for i in range(len(visible)):
        if visible[i]:
            a[k] = (u64(depth_bits[i]) << u64(32)) | u64(i)
            k += 1
    for turn in range(3):
        shift = u64(32 + 11 * turn)
        start = np.zeros(2049, np.int64)
        for i in range(count):
            start[i64((a[i] >> shift) & u64(2047)) + 1] += 1
        for i in range(2048):
            start[i + 1] += start[i]
        for i in range(count):
            digit = i64((a[i] >> shift) & u64(2047))
            b[start[digit]] = a[i]
            start[digit] += 1
        a, b = b, a
    order = np.empty(count, np.int32)
    for i in range(count):
        order[i] = np.int32(a[i] & u64(0xFFFFFFFF))
    return order


@njit(parallel=True, **FAST)
def pack(records, order, packed):
    """Records in depth order."""
    for i in prange(len(order)):
        for k in range(RECORD):
            packed[i, k] = records[order[i], k]


@njit(**FAST)
def count_tiles(packed, tiles_x, tiles_y, surfel_start, offsets):
    """Intersections before each surfel and before each tile; returns how many there are."""
    per_tile = np.zeros(tiles_x * tiles_y, np.int64)
    total = 0
    for i in range(packed.shape[0]):
        x0, x1 = i64(packed[i, R_X0]) // TILE, (i64(packed[i, R_X1]) - 1) // TILE
        y0, y1 = i64(packed[i, R_Y0]) // TILE, (i64(packed[i, R_Y1]) - 1) // TILE
        surfel_start[i] = total
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                per_tile[y * tiles_x + x] += 1
        total += (x1 - x0 + 1) * (y1 - y0 + 1)
    surfel_start[packed.shape[0]] = total
    offsets[0] = 0
    for t in range(tiles_x * tiles_y):
        offsets[t + 1] = offsets[t] + per_tile[t]
    return total


@njit(parallel=True, **FAST)
def fill_tiles(packed, tiles_x, tiles_y, surfel_start, offsets, ids, slot, parts):
    """Tile lists in depth order, and where each surfel's intersections lie; each part owns a band of tile rows."""
    for part in prange(parts):
        low, high = tiles_y * part // parts, tiles_y * (part + 1) // parts
        cursor = offsets[low * tiles_x : high * tiles_x].copy()
        for i in range(packed.shape[0]):
            y0, y1 = i64(packed[i, R_Y0]) // TILE, (i64(packed[i, R_Y1]) - 1) // TILE
            if y1 < low or y0 >= high:
                continue
            x0, x1 = i64(packed[i, R_X0]) // TILE, (i64(packed[i, R_X1]) - 1) // TILE
            across = x1 - x0 + 1
            for y in range(max(y0, low), min(y1, high - 1) + 1):
                for x in range(x0, x1 + 1):
                    k = (y - low) * tiles_x + x
                    place = cursor[k]
                    cursor[k] = place + 1
                    ids[place] = i
                    slot[surfel_start[i] + (y - y0) * across + (x - x0)] = place


@njit(parallel=True, **FAST)
def reduce_rows(packed, order, surfel_start, slot, rows, means, quats, scales, R, t, fx, fy,
                g_means, g_quats, g_scales, g_opacity, g_rgb, g_screen):  # fmt: skip
    """Sum each surfel's rows in a fixed order and carry them back to its parameters. The outputs come in zeroed."""
    for i in prange(packed.shape[0]):
        a = np.zeros(ROW, f32)
        for s in range(surfel_start[i], surfel_start[i + 1]):
            for k in range(ROW):
                a[k] += rows[slot[s], k]
        n = order[i]
        A0, B0, A1, B1 = packed[i, R_A0], packed[i, R_B0], packed[i, R_A1], packed[i, R_B1]
        A2, B2 = packed[i, R_A2], packed[i, R_B2]
        g_cx = -(A0 * a[0] + A1 * a[3] + A2 * a[6]) + TWO * a[17]
        g_cy = -(B0 * a[0] + B1 * a[3] + B2 * a[6]) + TWO * a[18]
        g_a2, g_b2 = a[7], a[8]
        X = R[0, 0] * means[n, 0] + R[0, 1] * means[n, 1] + R[0, 2] * means[n, 2] + t[0]
        Y = R[1, 0] * means[n, 0] + R[1, 1] * means[n, 1] + R[1, 2] * means[n, 2] + t[1]
        Z = R[2, 0] * means[n, 0] + R[2, 1] * means[n, 1] + R[2, 2] * means[n, 2] + t[2]
        iz = ONE / Z
        inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
            f64(quats[n, 0]), f64(quats[n, 1]), f64(quats[n, 2]), f64(quats[n, 3])
        )
        s0, s1 = scales[n, 0], scales[n, 1]
        t00 = R[0, 0] * r0 + R[0, 1] * r3 + R[0, 2] * r6
        t01 = R[1, 0] * r0 + R[1, 1] * r3 + R[1, 2] * r6
        t02 = R[2, 0] * r0 + R[2, 1] * r3 + R[2, 2] * r6
        t10 = R[0, 0] * r1 + R[0, 1] * r4 + R[0, 2] * r7
        t11 = R[1, 0] * r1 + R[1, 1] * r4 + R[1, 2] * r7
        t12 = R[2, 0] * r1 + R[2, 1] * r4 + R[2, 2] * r7
        nx = R[0, 0] * r2 + R[0, 1] * r5 + R[0, 2] * r8
        ny = R[1, 0] * r2 + R[1, 1] * r5 + R[1, 2] * r8
        nz = R[2, 0] * r2 + R[2, 1] * r5 + R[2, 2] * r8
        side = MINUS if nx * X + ny * Y + nz * Z > ZERO else ONE
        xn, yn, W0, W1 = X * iz, Y * iz, t02 * s0, t12 * s1
        # A = (J / Z)^-1 and (a2, b2) = -(W0 (a0, b0) + W1 (a1, b1)) / Z, backwards
        g_a0, g_a1 = a[1] - W0 * iz * g_a2, a[4] - W1 * iz * g_a2
        g_b0, g_b1 = a[2] - W0 * iz * g_b2, a[5] - W1 * iz * g_b2
        g_W0, g_W1 = -(A0 * g_a2 + B0 * g_b2) * iz, -(A1 * g_a2 + B1 * g_b2) * iz
        g_Z = -(A2 * g_a2 + B2 * g_b2) * iz
        m00, m01 = A0 * g_a0 + A1 * g_a1, A0 * g_b0 + A1 * g_b1
        m10, m11 = B0 * g_a0 + B1 * g_a1, B0 * g_b0 + B1 * g_b1
        J00, J01 = -(m00 * A0 + m01 * B0), -(m00 * A1 + m01 * B1)
        J10, J11 = -(m10 * A0 + m11 * B0), -(m10 * A1 + m11 * B1)
        U0, U1 = fx * (t00 * s0 - xn * W0), fx * (t10 * s1 - xn * W1)
        V0, V1 = fy * (t01 * s0 - yn * W0), fy * (t11 * s1 - yn * W1)
        g_U0, g_U1, g_V0, g_V1 = J00 * iz, J01 * iz, J10 * iz, J11 * iz
        g_Z -= (U0 * g_U0 + U1 * g_U1 + V0 * g_V0 + V1 * g_V1) * iz
        h00, h10, h01, h11 = fx * g_U0, fx * g_U1, fy * g_V0, fy * g_V1
        h02 = -fx * xn * g_U0 - fy * yn * g_V0 + g_W0
        h12 = -fx * xn * g_U1 - fy * yn * g_V1 + g_W1
        g_xn, g_yn = fx * (g_cx - g_U0 * W0 - g_U1 * W1), fy * (g_cy - g_V0 * W0 - g_V1 * W1)
        g_X, g_Y = g_xn * iz, g_yn * iz
        g_Z -= (xn * g_xn + yn * g_yn) * iz + a[9] * iz * iz
        for k in range(3):
            g_means[n, k] = R[0, k] * g_X + R[1, k] * g_Y + R[2, k] * g_Z
        g_scales[n, 0] = h00 * t00 + h01 * t01 + h02 * t02
        g_scales[n, 1] = h10 * t10 + h11 * t11 + h12 * t12
        h00, h01, h02, h10, h11, h12 = h00 * s0, h01 * s0, h02 * s0, h10 * s1, h11 * s1, h12 * s1
        h20, h21, h22 = side * a[14], side * a[15], side * a[16]
        G0 = R[0, 0] * h00 + R[1, 0] * h01 + R[2, 0] * h02
        G3 = R[0, 1] * h00 + R[1, 1] * h01 + R[2, 1] * h02
        G6 = R[0, 2] * h00 + R[1, 2] * h01 + R[2, 2] * h02
        G1 = R[0, 0] * h10 + R[1, 0] * h11 + R[2, 0] * h12
        G4 = R[0, 1] * h10 + R[1, 1] * h11 + R[2, 1] * h12
        G7 = R[0, 2] * h10 + R[1, 2] * h11 + R[2, 2] * h12
        G2 = R[0, 0] * h20 + R[1, 0] * h21 + R[2, 0] * h22
        G5 = R[0, 1] * h20 + R[1, 1] * h21 + R[2, 1] * h22
        G8 = R[0, 2] * h20 + R[1, 2] * h21 + R[2, 2] * h22
        gw = TWO * (x * (G7 - G5) + y * (G2 - G6) + z * (G3 - G1))
        gx = TWO * (-TWO * x * (G4 + G8) + y * (G1 + G3) + z * (G2 + G6) + w * (G7 - G5))
        gy = TWO * (x * (G1 + G3) - TWO * y * (G0 + G8) + z * (G5 + G7) + w * (G2 - G6))
        gz = TWO * (x * (G2 + G6) + y * (G5 + G7) - TWO * z * (G0 + G4) + w * (G3 - G1))
        along = gw * w + gx * x + gy * y + gz * z
        g_quats[n, 0] = (gw - along * w) * inverse
        g_quats[n, 1] = (gx - along * x) * inverse
        g_quats[n, 2] = (gy - along * y) * inverse
        g_quats[n, 3] = (gz - along * z) * inverse
        g_opacity[n] = a[10]
        g_rgb[n, 0], g_rgb[n, 1], g_rgb[n, 2] = a[11], a[12], a[13]
        g_screen[n, 0], g_screen[n, 1] = g_cx, g_cy


@njit(**FAST)
def first_bad_row(values, columns):
    """First row of a flat float32 array that holds NaN or infinity, or -1: by the bits, since fast math forgets NaN."""
    bits = values.view(np.uint32)
    bad = u64(0)
    for i in range(u64(bits.size)):
        bad += u64((bits[i] & np.uint32(0x7F800000)) == np.uint32(0x7F800000))
    if bad == u64(0):
        return -1
    for i in range(bits.size):
        if (bits[i] & np.uint32(0x7F800000)) == np.uint32(0x7F800000):
            return i // columns
    return -1
