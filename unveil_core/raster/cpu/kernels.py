"""The CPU rasterizer in numba: project, sort, bin, forward, backward, reduce. See ``raster.spec`` for the mathematics.

One file, because numba's cache is keyed by the file that holds a kernel. What makes it fast, and what silently
unmakes it:

* A tile is 16x16 pixels in 4x4 blocks of 16 lanes; every inner loop runs over the 16 lanes of one block. All
  per-pixel state of a tile lies in ONE float32 buffer, block after block, so that LLVM sees constant distances
  between streams and vectorizes without alias checks. The slot of the surfel's label is copied to a fixed place and
  back for the same reason.
* Index arithmetic is unsigned (no wrap-around selects); constants are float32 (no float64 creeps in); "any lane" is a
  sum.
* The tile kernels are written once and inlined with constant switches into one kernel per group of planes
  (``GROUPS``), each compiled when it is first needed: a plane that was not asked for leaves no instruction behind.
* Each surfel-tile intersection writes its own gradient row; rows are then summed per surfel in a fixed order. No
  atomics, no per-thread buffers: results are bitwise the same for any number of threads.
* Per-surfel code is scalar, and float64 between the parameters and the records: edge-on discs cancel digits there.

``tests/raster/test_vectorization.py`` counts packed against scalar operations, because losing vectorization costs a
factor of four and breaks nothing else.
"""

# ruff: noqa: E741
# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from unveil_core.parallel import FAST
from unveil_core.raster.spec import (
    ALPHA_MAX,
    ALPHA_MIN,
    DEPTH_MAX,
    EDGE_ON,
    LOG_SCALE_MAX,
    OFFSET_MAX,
    SCALE_MIN_PX,
    TRANSMITTANCE_MIN,
)

f32, f64, u64, i64 = np.float32, np.float64, np.uint64, np.int64
INLINED = {**FAST, "forceinline": True}

TILE, BLOCK, LANES, BLOCKS_X, BLOCKS = 16, 4, 16, 4, 16
RECORD = 24
"""Floats of a surfel's record: see the ``R_`` offsets."""
ROW = 20
"""Floats of a gradient row: 3 x (n_u, n_v, q) moments, 1/z, opacity, rgb, normal, screen."""

(R_CX, R_CY, R_IZ, R_A0, R_B0, R_A1, R_B1, R_A2, R_B2, R_OPACITY, R_RED, R_GREEN, R_BLUE, R_NX, R_NY, R_NZ, R_Z,
 R_X0, R_X1, R_Y0, R_Y1, R_LABEL) = (u64(k) for k in range(22))  # fmt: skip

ZERO, ONE, TWO, HALF = f32(0), f32(1), f32(2), f32(0.5)
A_MIN, A_MAX, T_MIN = f32(ALPHA_MIN), f32(ALPHA_MAX), f32(TRANSMITTANCE_MIN)
# exp(-x) on [0, 5.7] as (p(-x / 8))^8: beyond 5.7 alpha is under 1/255 whatever the opacity. Relative error 2e-6.
X_MAX, EIGHTH = f32(5.7), f32(0.125)
E0, E1, E2, E3, E4, E5 = (
    f32(0.999999903), f32(-0.999991289), f32(0.499867671), f32(-0.16591143), f32(0.0396654613), f32(-0.00578264651),
)  # fmt: skip
# A ray in the disc's own plane has q = 0. Held away from it, masked lanes stay finite and zero times them is zero.
Q_MIN = f32(1e-10)
L16 = u64(16)

# ---- forward state of one block: planes of 16 lanes; the first KEPT_COLOUR or KEPT_GEOMETRY are what backward needs
(F_T, F_LAST, F_M1, F_M2, F_MEDIAN_I, F_FIRST, F_LIVE, F_RED, F_GREEN, F_BLUE, F_NX, F_NY, F_NZ, F_DEPTH, F_DIST,
 F_LDIST, F_MEDIAN, F_X, F_Y, F_SEM, F_LT, F_LM1, F_LM2, F_LFIRST) = (
    u64(16 * k) for k in range(24)
)  # fmt: skip
F_LABELS = 24 * 16
"""Then per label: its semantics, and with label distortion its transmittance, two moments and first hit."""
KEPT_COLOUR, KEPT_GEOMETRY, KEPT_LABEL = 2 * 16, 6 * 16, 4 * 16


def forward_template(label_count: int, semantics: bool, label_distortion: bool) -> np.ndarray:
    """Initial forward state of a whole tile, flat float32."""
    slot = (80 if label_distortion else 16) if semantics else 0
    state = np.zeros((BLOCKS, F_LABELS + label_count * slot), np.float32)
    block, lane = np.mgrid[0:BLOCKS, 0:LANES]
    state[:, int(F_X) : int(F_X) + 16] = (block % BLOCKS_X) * BLOCK + lane % BLOCK + 0.5
    state[:, int(F_Y) : int(F_Y) + 16] = (block // BLOCKS_X) * BLOCK + lane // BLOCK + 0.5
    for plane, value in ((F_T, 1), (F_LAST, -1), (F_MEDIAN_I, -1), (F_LIVE, 1)):
        state[:, int(plane) : int(plane) + 16] = value
    if label_distortion:
        for k in range(label_count):
            start = F_LABELS + k * slot + 16
            state[:, start : start + 16] = 1
    return state.ravel()


def kept_size(label_count: int, geometry: bool, label_distortion: bool) -> int:
    """Floats that a tile keeps for backward; the last one is the mask of labels met."""
    block = KEPT_GEOMETRY if geometry else KEPT_COLOUR
    return BLOCKS * (block + (label_count * KEPT_LABEL if label_distortion else 0)) + 1


@njit(inline="always")
def _forward_tile(
    t, tiles_x, template, records, offsets, ids, width, height, c1, inv_near, label_count, geometry, semantics,
    label_distortion, rgb, alphas, depth, median, normal, distortion, labels, label_dist, kept, hits,
):  # fmt: skip
    slot_size = (80 if label_distortion else 16) if semantics else 0
    stride = F_LABELS + label_count * slot_size
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
            for rest in range(i, last):
                hits[u64(rest)] = 0
            break
        g = u64(ids[i])
        hit = 0
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
                if semantics:
                    slot = u64(b * stride + F_LABELS + label * slot_size)
                    for l in range(u64(slot_size)):
                        state[o + F_SEM + l] = state[slot + l]
                some, living = ZERO, ZERO
                for l in range(L16):
                    j = o + l
                    dx, dy = state[F_X + j] - cx, state[F_Y + j] - cy
                    nu, nv = a0 * dx + b0 * dy, a1 * dx + b1 * dy
                    q = ONE + a2 * dx + b2 * dy
                    q = q if abs(q) > Q_MIN else Q_MIN
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
                    live, light = state[F_LIVE + j], state[F_T + j]
                    alpha = alpha * live
                    alpha = alpha if alpha >= A_MIN else ZERO
                    alpha = alpha if inv > ZERO else ZERO
                    alpha = alpha if inv <= inv_near else ZERO
                    some += alpha
                    # The surfel that would bring the light under the limit ends the pixel, and does not count itself.
                    past = light * (ONE - alpha)
                    live = live if past >= T_MIN else ZERO
                    alpha = alpha * live
                    state[F_LIVE + j] = live
                    living += live
                    w = alpha * light
                    state[F_RED + j] += w * red
                    state[F_GREEN + j] += w * green
                    state[F_BLUE + j] += w * blue
                    state[F_T + j] = light * (ONE - alpha)
                    old = state[F_LAST + j]
                    state[F_LAST + j] = rank if alpha > ZERO else old
                    if semantics:
                        state[F_SEM + j] += w
                    if geometry:
                        d, start = r * z if use_exact else z, state[F_FIRST + j]
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
                    if label_distortion:
                        llight, lstart = state[F_LT + j], state[F_LFIRST + j]
                        lw = alpha * llight
                        begins = alpha if llight >= ONE else ZERO
                        lstart = inv if begins > ZERO else lstart
                        state[F_LFIRST + j] = lstart
                        m = c1 * (lstart - inv)
                        m1, m2, mm = state[F_LM1 + j], state[F_LM2 + j], m * m
                        state[F_LDIST + j] += lw * (mm * (ONE - llight) + m2 - TWO * m * m1)
                        state[F_LM1 + j] = m1 + lw * m
                        state[F_LM2 + j] = m2 + lw * mm
                        state[F_LT + j] = llight * (ONE - alpha)
                if some <= ZERO:
                    continue
                hit |= 1 << b
                if living == ZERO:
                    alive[b] = 0
                    alive_count -= 1
                if label_distortion:
                    met |= 1 << label
                if semantics:
                    for l in range(u64(slot_size)):
                        state[slot + l] = state[o + F_SEM + l]
        hits[u64(i)] = hit
    for b in range(BLOCKS):
        for row in range(BLOCK):
            y = ty + (b // BLOCKS_X) * BLOCK + row
            x0 = tx + (b % BLOCKS_X) * BLOCK
            count = min(BLOCK, width - x0)
            if y >= height:
                continue
            for c in range(count):
                j, yy, xx = u64(b * stride + row * BLOCK + c), u64(y), u64(x0 + c)
                rgb[yy, xx, u64(0)] = state[F_RED + j]
                rgb[yy, xx, u64(1)] = state[F_GREEN + j]
                rgb[yy, xx, u64(2)] = state[F_BLUE + j]
                alphas[yy, xx] = ONE - state[F_T + j]
                if geometry:
                    depth[yy, xx] = state[F_DEPTH + j]
                    median[yy, xx] = state[F_MEDIAN + j]
                    normal[yy, xx, u64(0)] = state[F_NX + j]
                    normal[yy, xx, u64(1)] = state[F_NY + j]
                    normal[yy, xx, u64(2)] = state[F_NZ + j]
                    distortion[yy, xx] = state[F_DIST + j]
                if label_distortion:
                    label_dist[yy, xx] = state[F_LDIST + j]
                if semantics:
                    for k in range(u64(label_count)):
                        labels[yy, xx, k] = state[u64(F_LABELS) + k * u64(slot_size) + j]
    if kept.shape[0] > 0:
        keep = kept[t]
        block = KEPT_GEOMETRY if geometry else KEPT_COLOUR
        kept_stride = block + (label_count * KEPT_LABEL if label_distortion else 0)
        for b in range(BLOCKS):
            for l in range(u64(block)):
                keep[u64(b * kept_stride) + l] = state[u64(b * stride) + l]
            if label_distortion:
                for k in range(label_count):
                    if (met >> k) & 1:
                        target, source = (
                            u64(b * kept_stride + block + k * KEPT_LABEL),
                            u64(b * stride + F_LABELS + k * 80 + 16),
                        )
                        for l in range(u64(KEPT_LABEL)):
                            keep[target + l] = state[source + l]
        keep[u64(BLOCKS * kept_stride)] = f32(met)


# ---- backward state of one block
(B_T, B_LAST, B_M1, B_M2, B_MEDIAN_I, B_FIRST, B_SUM, B_GA, B_X, B_Y, B_SEM, B_LT, B_LM1, B_LM2, B_LFIRST, B_LSUM,
 B_LGA, G_RED, G_GREEN, G_BLUE, G_ALPHA, G_DEPTH, G_MEDIAN, G_NX, G_NY, G_NZ, G_DIST, G_LDIST) = (
    u64(16 * k) for k in range(28)
)  # fmt: skip
B_ACC = 28 * 16
"""19 lane accumulators of the surfel at hand; the first 15 are all that colour and semantics need."""
(S_U, S_UX, S_UY, S_V, S_VX, S_VY, S_Q, S_QX, S_QY, S_OPACITY, S_RED, S_GREEN, S_BLUE, S_SX, S_SY,
 S_IZ, S_NX, S_NY, S_NZ) = (
    u64(B_ACC + 16 * k) for k in range(19)
)  # fmt: skip
B_LABELS = B_ACC + 19 * 16
"""Then per label: its semantic gradient, and with label distortion six planes."""


@njit(inline="always")
def _backward_tile(
    t, tiles_x, records, offsets, ids, width, height, c1, inv_near, label_count, geometry, semantics, label_distortion,
    kept, hits, g_rgb, g_alpha, g_depth, g_median, g_normal, g_distortion, g_labels, g_label_dist, place, rows,
):  # fmt: skip
    slot_size = (112 if label_distortion else 16) if semantics else 0
    sums = 19 if geometry else 15
    # Sixteen, but the compiler must not know: it would unroll the shorter loops into single operations.
    lanes = u64(rows.shape[1]) - u64(ROW - 16)
    stride = B_LABELS + label_count * slot_size
    tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
    first = offsets[t]
    count = offsets[t + 1] - first
    block = KEPT_GEOMETRY if geometry else KEPT_COLOUR
    kept_stride = block + (label_count * KEPT_LABEL if label_distortion else 0)
    state = np.empty(BLOCKS * stride, f32)
    ftx, fty = f32(tx), f32(ty)
    keep = kept[t]
    met = i64(keep[u64(BLOCKS * kept_stride)])
    for b in range(BLOCKS):
        o = u64(b * stride)
        for l in range(u64(block)):
            state[o + l] = keep[u64(b * kept_stride) + l]
        for l in range(16):
            x, y = tx + (b % BLOCKS_X) * BLOCK + l % BLOCK, ty + (b // BLOCKS_X) * BLOCK + l // BLOCK
            j, yy, xx = o + u64(l), u64(y), u64(x)
            state[B_X + j] = f32(x - tx) + HALF
            state[B_Y + j] = f32(y - ty) + HALF
            state[B_SUM + j] = ZERO
            if x < width and y < height:
                state[G_RED + j] = g_rgb[yy, xx, u64(0)]
                state[G_GREEN + j] = g_rgb[yy, xx, u64(1)]
                state[G_BLUE + j] = g_rgb[yy, xx, u64(2)]
                state[G_ALPHA + j] = g_alpha[yy, xx]
                if geometry:
                    state[G_DEPTH + j] = g_depth[yy, xx]
                    state[G_MEDIAN + j] = g_median[yy, xx]
                    state[G_NX + j] = g_normal[yy, xx, u64(0)]
                    state[G_NY + j] = g_normal[yy, xx, u64(1)]
                    state[G_NZ + j] = g_normal[yy, xx, u64(2)]
                    state[G_DIST + j] = g_distortion[yy, xx]
                if label_distortion:
                    state[G_LDIST + j] = g_label_dist[yy, xx]
                if semantics:
                    for k in range(u64(label_count)):
                        state[u64(B_LABELS) + k * u64(slot_size) + j] = g_labels[yy, xx, k]
            else:
                for k in range(u64(11)):
                    state[G_RED + k * L16 + j] = ZERO
                if semantics:
                    for k in range(u64(label_count)):
                        state[u64(B_LABELS) + k * u64(slot_size) + j] = ZERO
        if geometry:
            # dL_d/dw_i = m_i^2 A + Q - 2 m_i M with the totals A, M, Q: scaled by the incoming gradient once, here.
            for l in range(lanes):
                j = o + l
                gd = state[G_DIST + j]
                state[B_GA + j] = gd * (ONE - state[B_T + j])
                state[G_ALPHA + j] += gd * state[B_M2 + j]
                state[B_M1 + j] *= gd
        if label_distortion:
            for k in range(label_count):
                if (met >> k) & 1:
                    source = u64(b * kept_stride + block + k * KEPT_LABEL)
                    slot = o + u64(B_LABELS + k * 112 + 16)
                    for l in range(u64(KEPT_LABEL)):
                        state[slot + l] = keep[source + l]
                    for l in range(lanes):
                        j = slot + l
                        gd, light = state[G_LDIST + o + l], state[j]
                        state[u64(16) + j] *= gd
                        state[u64(32) + j] *= gd
                        state[u64(64) + j] = ZERO
                        state[u64(80) + j] = gd * (ONE - light)
    minus_two_c1 = f32(-2) * c1
    for back in range(count - 1, -1, -1):
        i = u64(first + back)
        at = u64(place[i])
        for k in range(ROW):
            rows[at, u64(k)] = ZERO
        blocks = i64(hits[i])
        if blocks == 0:
            continue
        g = u64(ids[i])
        cx, cy, iz = records[g, R_CX] - ftx, records[g, R_CY] - fty, records[g, R_IZ]
        a0, b0, a1, b1 = records[g, R_A0], records[g, R_B0], records[g, R_A1], records[g, R_B1]
        a2, b2, opacity = records[g, R_A2], records[g, R_B2], records[g, R_OPACITY]
        red, green, blue = records[g, R_RED], records[g, R_GREEN], records[g, R_BLUE]
        nx, ny, nz, z = records[g, R_NX], records[g, R_NY], records[g, R_NZ], records[g, R_Z]
        label = i64(records[g, R_LABEL])
        rank = f32(back)
        fresh, previous = True, u64(0)
        for b in range(BLOCKS):
            if (blocks >> b) & 1 == 0:
                continue
            o = u64(b * stride)
            # The lane accumulators travel with the block that is worked on: one horizontal sum per surfel.
            if fresh:
                for l in range(u64(sums * 16)):
                    state[o + u64(B_ACC) + l] = ZERO
                fresh = False
            else:
                for l in range(u64(sums * 16)):
                    state[o + u64(B_ACC) + l] = state[previous + u64(B_ACC) + l]
            previous = o
            if semantics:
                slot = u64(B_LABELS + label * slot_size) + o
                for l in range(u64(slot_size)):
                    state[o + B_SEM + l] = state[slot + l]
            for l in range(L16):
                j = o + l
                dx, dy = state[B_X + j] - cx, state[B_Y + j] - cy
                nu, nv = a0 * dx + b0 * dy, a1 * dx + b1 * dy
                q = ONE + a2 * dx + b2 * dy
                q = q if abs(q) > Q_MIN else Q_MIN
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
                alpha = alpha if state[B_LAST + j] >= rank else ZERO
                alpha = alpha if alpha >= A_MIN else ZERO
                alpha = alpha if inv > ZERO else ZERO
                alpha = alpha if inv <= inv_near else ZERO
                ex = ONE if use_exact else ZERO
                e = e if raw <= A_MAX else ZERO
                ra = ONE / (ONE - alpha)
                light = state[B_T + j] * ra
                state[B_T + j] = light
                w, total = alpha * light, state[B_SUM + j]
                gred, ggreen, gblue = state[G_RED + j], state[G_GREEN + j], state[G_BLUE + j]
                value = gred * red + ggreen * green + gblue * blue + state[G_ALPHA + j]
                if semantics:
                    value += state[B_SEM + j]
                if geometry:
                    d = r * z if use_exact else z
                    m = c1 * (state[B_FIRST + j] - inv)
                    ga, gm = state[B_GA + j], state[B_M1 + j]
                    gnx, gny, gnz = state[G_NX + j], state[G_NY + j], state[G_NZ + j]
                    gdepth = state[G_DEPTH + j]
                    value += gdepth * d
                    value += gnx * nx + gny * ny + gnz * nz
                    value += m * (m * ga - TWO * gm)
                    dm = w * (m * ga - gm)
                da = light * value - total * ra
                state[B_SUM + j] = total + w * value
                if label_distortion:
                    m = c1 * (state[B_LFIRST + j] - inv)
                    llight = state[B_LT + j] * ra
                    state[B_LT + j] = llight
                    lw, ltotal = alpha * llight, state[B_LSUM + j]
                    gm, ga = state[B_LM1 + j], state[B_LGA + j]
                    lvalue = m * (m * ga - TWO * gm) + state[B_LM2 + j]
                    da += llight * lvalue - ltotal * ra
                    state[B_LSUM + j] = ltotal + lw * lvalue
                    dm += lw * (m * ga - gm)
                da = da if alpha > ZERO else ZERO
                da = da if e > ZERO else ZERO
                h = da * alpha
                h3 = h * ex
                h2 = h - h3
                hr = h3 * r
                ue, ve = u * ex, v * ex
                gnu, gnv, gq = -hr * ue, -hr * ve, hr * (ue * ue + ve * ve)
                if geometry:
                    gmed = state[G_MEDIAN + j]
                    gmed = gmed if alpha > ZERO else ZERO
                    gmed = gmed if state[B_MEDIAN_I + j] == rank else ZERO
                    ginv = minus_two_c1 * dm - (w * gdepth + gmed) * d * d
                    ginv = ginv if alpha > ZERO else ZERO
                    gq += ginv * iz * ex
                    scaled = ginv * q
                    state[S_IZ + j] += scaled if ex > ZERO else ginv
                    state[S_NX + j] += w * gnx
                    state[S_NY + j] += w * gny
                    state[S_NZ + j] += w * gnz
                state[S_U + j] += gnu
                state[S_UX + j] += gnu * dx
                state[S_UY + j] += gnu * dy
                state[S_V + j] += gnv
                state[S_VX + j] += gnv * dx
                state[S_VY + j] += gnv * dy
                state[S_Q + j] += gq
                state[S_QX + j] += gq * dx
                state[S_QY + j] += gq * dy
                state[S_OPACITY + j] += da * e
                state[S_RED + j] += w * gred
                state[S_GREEN + j] += w * ggreen
                state[S_BLUE + j] += w * gblue
                state[S_SX + j] += h2 * dx
                state[S_SY + j] += h2 * dy
            if label_distortion:
                for l in range(u64(96)):
                    state[slot + L16 + l] = state[o + B_LT + l]
        # Many sums in one loop: one sum alone comes out as adds that wait for each other.
        t0, t1, t2, t3, t4, t5, t6, t7 = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
        for l in range(lanes):
            j = previous + l
            t0 += state[S_U + j]
            t1 += state[S_UX + j]
            t2 += state[S_UY + j]
            t3 += state[S_V + j]
            t4 += state[S_VX + j]
            t5 += state[S_VY + j]
            t6 += state[S_Q + j]
            t7 += state[S_QX + j]
        rows[at, u64(0)] = t0
        rows[at, u64(1)] = t1
        rows[at, u64(2)] = t2
        rows[at, u64(3)] = t3
        rows[at, u64(4)] = t4
        rows[at, u64(5)] = t5
        rows[at, u64(6)] = t6
        rows[at, u64(7)] = t7
        t8, t9, t10, t11, t12, t13, t14 = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
        for l in range(lanes):
            j = previous + l
            t8 += state[S_QY + j]
            t9 += state[S_OPACITY + j]
            t10 += state[S_RED + j]
            t11 += state[S_GREEN + j]
            t12 += state[S_BLUE + j]
            t13 += state[S_SX + j]
            t14 += state[S_SY + j]
        rows[at, u64(8)] = t8
        rows[at, u64(9)] = t9
        rows[at, u64(10)] = t10
        rows[at, u64(11)] = t11
        rows[at, u64(12)] = t12
        rows[at, u64(13)] = t13
        rows[at, u64(14)] = t14
        if geometry:
            t15, t16, t17, t18 = ZERO, ZERO, ZERO, ZERO
            for l in range(lanes):
                j = previous + l
                t15 += state[S_IZ + j]
                t16 += state[S_NX + j]
                t17 += state[S_NY + j]
                t18 += state[S_NZ + j]
            rows[at, u64(15)] = t15
            rows[at, u64(16)] = t16
            rows[at, u64(17)] = t17
            rows[at, u64(18)] = t18


# ---- one pair of kernels per group of planes
def _group(geometry, semantics, label_distortion):
    """Forward and backward with these switches as constants, after the switches themselves."""

    @njit(**FAST)
    def forward(
        tile, end, tiles_x, template, records, offsets, ids, width, height, c1, inv_near, label_count,
        rgb, alphas, depth, median, normal, distortion, labels, label_dist, kept, hits,
    ):  # fmt: skip
        for t in range(tile, end):
            _forward_tile(
                t, tiles_x, template, records, offsets, ids, width, height, c1, inv_near, label_count,
                geometry, semantics, label_distortion,
                rgb, alphas, depth, median, normal, distortion, labels, label_dist, kept, hits,
            )  # fmt: skip

    @njit(**FAST)
    def backward(
        tile, end, tiles_x, records, offsets, ids, width, height, c1, inv_near, label_count,
        kept, hits, g_rgb, g_alpha, g_depth, g_median, g_normal, g_distortion, g_labels, g_label_dist, place, rows,
    ):  # fmt: skip
        for t in range(tile, end):
            _backward_tile(
                t, tiles_x, records, offsets, ids, width, height, c1, inv_near, label_count,
                geometry, semantics, label_distortion,
                kept, hits, g_rgb, g_alpha, g_depth, g_median, g_normal, g_distortion, g_labels, g_label_dist, place, rows,
            )  # fmt: skip

    return geometry, semantics, label_distortion, forward, backward


GROUPS = {
    "colour": _group(geometry=False, semantics=False, label_distortion=False),
    "semantic": _group(geometry=False, semantics=True, label_distortion=False),
    "geometry": _group(geometry=True, semantics=False, label_distortion=False),
    "all": _group(geometry=True, semantics=True, label_distortion=True),
}
"""Name to (geometry, semantics, label_distortion, forward, backward), the cheapest first."""


# ---- project, sort, bin, reduce (scalar code)

SH0, SH1 = 0.28209479177387814, 0.4886025119029199
SH2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
SH3 = (
    -0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154, -0.4570457994644658,
    1.445305721320277, -0.5900435899266435,
)  # fmt: skip


@njit(**INLINED)
def sh_basis(x, y, z):
    """The 16 basis functions of degree 0 to 3 at a unit direction, as ``spherical_harmonics.basis``."""
    xx, yy, zz = x * x, y * y, z * z
    return (SH0, -SH1 * y, SH1 * z, -SH1 * x,
            SH2[0] * x * y, SH2[1] * y * z, SH2[2] * (2 * zz - xx - yy), SH2[3] * x * z, SH2[4] * (xx - yy),
            SH3[0] * y * (3 * xx - yy), SH3[1] * x * y * z, SH3[2] * y * (4 * zz - xx - yy),
            SH3[3] * z * (2 * zz - 3 * xx - 3 * yy), SH3[4] * x * (4 * zz - xx - yy), SH3[5] * z * (xx - yy),
            SH3[6] * x * (xx - 3 * yy))  # fmt: skip


@njit(**INLINED)
def sh_slopes(x, y, z):
    """Their partial derivatives by x, y and z: three tuples of 16."""
    xx, yy, zz = x * x, y * y, z * z
    by_x = (0.0, 0.0, 0.0, -SH1,
            SH2[0] * y, 0.0, -2 * SH2[2] * x, SH2[3] * z, 2 * SH2[4] * x,
            6 * SH3[0] * x * y, SH3[1] * y * z, -2 * SH3[2] * x * y, -6 * SH3[3] * x * z,
            SH3[4] * (4 * zz - 3 * xx - yy), 2 * SH3[5] * x * z, 3 * SH3[6] * (xx - yy))  # fmt: skip
    by_y = (0.0, -SH1, 0.0, 0.0,
            SH2[0] * x, SH2[1] * z, -2 * SH2[2] * y, 0.0, -2 * SH2[4] * y,
            3 * SH3[0] * (xx - yy), SH3[1] * x * z, SH3[2] * (4 * zz - xx - 3 * yy), -6 * SH3[3] * y * z,
            -2 * SH3[4] * x * y, -2 * SH3[5] * y * z, -6 * SH3[6] * x * y)  # fmt: skip
    by_z = (0.0, 0.0, SH1, 0.0,
            0.0, SH2[1] * y, 4 * SH2[2] * z, SH2[3] * x, 0.0,
            0.0, SH3[1] * x * y, 8 * SH3[2] * y * z, SH3[3] * (6 * zz - 3 * xx - 3 * yy),
            8 * SH3[4] * x * z, SH3[5] * (xx - yy), 0.0)  # fmt: skip
    return by_x, by_y, by_z


@njit(**INLINED)
def rotation(q0, q1, q2, q3):
    """Inverse norm, unit quaternion and the nine entries of its rotation; a zero quaternion is no rotation."""
    norm = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
    tiny = norm < 1e-24
    inverse = 0.0 if tiny else 1.0 / np.sqrt(norm)
    w = 1.0 if tiny else q0 * inverse
    x, y, z = q1 * inverse, q2 * inverse, q3 * inverse
    return (inverse, w, x, y, z,
            1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
            2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
            2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))  # fmt: skip


@njit(**INLINED)
def held_scale(log_scale, floor):
    """The standard deviation within its limits, and its derivative by the logarithm: itself, or zero at a limit."""
    scale = np.exp(min(f64(log_scale), LOG_SCALE_MAX))
    slope = scale if log_scale < LOG_SCALE_MAX else 0.0
    return (scale, slope) if scale > floor else (floor, 0.0)


@njit(**INLINED)
def clipped_extent(g0, g1, h0, h1, Z, near, k2):
    """Least and greatest slope (offset from the projected mean over depth) of a disc cut at the near plane.

    The disc is ``{s: |s|^2 <= k2}`` at depth ``Z + h . s``, its offset times depth is ``g . s``. The extremes of such
    a ratio over a convex region lie on its boundary: at the ends of the chord depth = near, or where a line through
    the eye touches the arc.
    """
    hh = h0 * h0 + h1 * h1
    h = np.sqrt(hh)
    along = (near - Z) / hh
    across = np.sqrt(max(k2 - along * along * hh, 0.0)) / h
    middle, swing = along * (g0 * h0 + g1 * h1) / near, abs(across * (g1 * h0 - g0 * h1)) / near
    low, high = middle - swing, middle + swing
    A, B, C = Z * Z - k2 * hh, k2 * (g0 * h0 + g1 * h1), -k2 * (g0 * g0 + g1 * g1)
    discriminant = B * B - A * C
    if discriminant > 0.0:
        root = -(B + np.sqrt(discriminant)) if B > 0.0 else np.sqrt(discriminant) - B
        for turn in range(2):
            top, bottom = (root, A) if turn == 0 else (C, root)
            if abs(bottom) > 1e-12 * abs(top):
                slope = top / bottom
                n0, n1 = g0 - slope * h0, g1 - slope * h1
                nn = n0 * n0 + n1 * n1
                if nn > 0.0:
                    touch = slope * Z / nn
                    if Z + touch * (h0 * n0 + h1 * n1) >= near:
                        low, high = min(low, slope), max(high, slope)
    return low, high


@njit(**FAST)
def project(first, end, means, quats, log_scales, opacity_logits, sh, labels, R, t, eye, fx, fy, cx0, cy0, width, height, near,
            coefficients, records, boxes, depths, visible):  # fmt: skip
    """Records of the surfels that can touch the image, with activations and colour; the tiles that each touches
    (first and last column, first and last row), its depth, and ``visible`` (N,) uint8."""
    for i in range(first, end):
        visible[i] = 0
        X = R[0, 0] * means[i, 0] + R[0, 1] * means[i, 1] + R[0, 2] * means[i, 2] + t[0]
        Y = R[1, 0] * means[i, 0] + R[1, 1] * means[i, 1] + R[1, 2] * means[i, 2] + t[1]
        Z = R[2, 0] * means[i, 0] + R[2, 1] * means[i, 1] + R[2, 2] * means[i, 2] + t[2]
        if not near < Z < DEPTH_MAX:
            continue
        opacity = 1.0 / (1.0 + np.exp(min(-f64(opacity_logits[i]), 700.0)))
        if opacity < ALPHA_MIN:
            continue
        iz = 1.0 / Z
        xn, yn = X * iz, Y * iz
        if not (abs(fx * xn) < OFFSET_MAX and abs(fy * yn) < OFFSET_MAX):
            continue
        _, _, _, _, _, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
            f64(quats[i, 0]), f64(quats[i, 1]), f64(quats[i, 2]), f64(quats[i, 3])
        )
        floor = SCALE_MIN_PX * Z / max(fx, fy)
        s0, _ = held_scale(log_scales[i, 0], floor)
        s1, _ = held_scale(log_scales[i, 1], floor)
        h00 = (R[0, 0] * r0 + R[0, 1] * r3 + R[0, 2] * r6) * s0
        h01 = (R[1, 0] * r0 + R[1, 1] * r3 + R[1, 2] * r6) * s0
        h02 = (R[2, 0] * r0 + R[2, 1] * r3 + R[2, 2] * r6) * s0
        h10 = (R[0, 0] * r1 + R[0, 1] * r4 + R[0, 2] * r7) * s1
        h11 = (R[1, 0] * r1 + R[1, 1] * r4 + R[1, 2] * r7) * s1
        h12 = (R[2, 0] * r1 + R[2, 1] * r4 + R[2, 2] * r7) * s1
        nx = R[0, 0] * r2 + R[0, 1] * r5 + R[0, 2] * r8
        ny = R[1, 0] * r2 + R[1, 1] * r5 + R[1, 2] * r8
        nz = R[2, 0] * r2 + R[2, 1] * r5 + R[2, 2] * r8
        facing = nx * X + ny * Y + nz * Z
        distance = np.sqrt(X * X + Y * Y + Z * Z)
        edge_on = abs(facing) < EDGE_ON * distance
        if facing > 0.0 and not edge_on:
            nx, ny, nz = -nx, -ny, -nz
        cx, cy = fx * xn + cx0, fy * yn + cy0
        U0, U1 = fx * (h00 - xn * h02), fx * (h10 - xn * h12)
        V0, V1 = fy * (h01 - yn * h02), fy * (h11 - yn * h12)
        # Exact support: G falls under 1/(255 o) at radius sqrt(k2). The bounds of what it projects to, and never
        # smaller than the low-pass filter's circle.
        k2 = 2.0 * np.log(opacity / ALPHA_MIN)
        low = np.sqrt(0.5 * k2)
        x0, x1, y0, y1 = -low, low, -low, low
        if not edge_on:
            if Z - np.sqrt(k2 * (h02 * h02 + h12 * h12)) > near:
                g = 1.0 / (Z * Z - k2 * (h02 * h02 + h12 * h12))
                ex, ey = -k2 * (U0 * h02 + U1 * h12) * g, -k2 * (V0 * h02 + V1 * h12) * g
                hx = np.sqrt(max(ex * ex + k2 * (U0 * U0 + U1 * U1) * g, 0.0))
                hy = np.sqrt(max(ey * ey + k2 * (V0 * V0 + V1 * V1) * g, 0.0))
                x0, x1 = min(ex - hx, -low), max(ex + hx, low)
                y0, y1 = min(ey - hy, -low), max(ey + hy, low)
            else:
                ex0, ex1 = clipped_extent(U0, U1, h02, h12, Z, near, k2)
                ey0, ey1 = clipped_extent(V0, V1, h02, h12, Z, near, k2)
                x0, x1, y0, y1 = min(ex0, -low), max(ex1, low), min(ey0, -low), max(ey1, low)
        # Pixels whose centre lies within, a thousandth generous for float32.
        x0, x1 = np.floor(max(cx + x0, 0.0) + 0.499), np.floor(min(cx + x1, f64(width)) + 0.501)
        y0, y1 = np.floor(max(cy + y0, 0.0) + 0.499), np.floor(min(cy + y1, f64(height)) + 0.501)
        x1, y1 = min(x1, f64(width)), min(y1, f64(height))
        if not (x1 > x0 and y1 > y0):
            continue
        # Edge-on: an intersection so far out that the low-pass filter always wins.
        a0, b0, a1, b1, a2, b2 = 1e3, 0.0, 0.0, 1e3, 0.0, 0.0
        if not edge_on:
            g = Z / (U0 * V1 - U1 * V0)
            a0, b0, a1, b1 = V1 * g, -U1 * g, -V0 * g, U0 * g
            a2, b2 = -(h02 * a0 + h12 * a1) * iz, -(h02 * b0 + h12 * b1) * iz
        dx, dy, dz = means[i, 0] - eye[0], means[i, 1] - eye[1], means[i, 2] - eye[2]
        red, green, blue = 0.5 + SH0 * sh[i, 0, 0], 0.5 + SH0 * sh[i, 0, 1], 0.5 + SH0 * sh[i, 0, 2]
        if coefficients > 1:
            basis = sh_basis(dx / distance, dy / distance, dz / distance)
            r, g, b = ZERO, ZERO, ZERO
            for k in range(1, coefficients):
                weight = f32(basis[k])
                r += weight * sh[i, k, 0]
                g += weight * sh[i, k, 1]
                b += weight * sh[i, k, 2]
            red, green, blue = red + r, green + g, blue + b
        records[i, R_CX] = cx
        records[i, R_CY] = cy
        records[i, R_IZ] = iz
        records[i, R_A0] = a0
        records[i, R_B0] = b0
        records[i, R_A1] = a1
        records[i, R_B1] = b1
        records[i, R_A2] = a2
        records[i, R_B2] = b2
        records[i, R_OPACITY] = opacity
        records[i, R_RED] = max(red, 0.0)
        records[i, R_GREEN] = max(green, 0.0)
        records[i, R_BLUE] = max(blue, 0.0)
        records[i, R_NX] = nx
        records[i, R_NY] = ny
        records[i, R_NZ] = nz
        records[i, R_Z] = Z
        records[i, R_X0] = x0
        records[i, R_X1] = x1
        records[i, R_Y0] = y0
        records[i, R_Y1] = y1
        records[i, R_LABEL] = f32(labels[i])
        boxes[i, 0], boxes[i, 1] = i64(x0) // TILE, (i64(x1) - 1) // TILE
        boxes[i, 2], boxes[i, 3] = i64(y0) // TILE, (i64(y1) - 1) // TILE
        depths[i] = Z
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


@njit(**FAST)
def pack(first, end, records, order, packed):
    """Records in depth order: a tile's list then walks through memory in one direction."""
    for i in range(first, end):
        for k in range(RECORD):
            packed[i, k] = records[order[i], k]


@njit(**FAST)
def count_tiles(boxes, visible, tiles_x, tiles_y, surfel_start, offsets):
    """Intersections before each surfel (N + 1,) and before each tile; returns how many there are."""
    per_tile = np.zeros(tiles_x * tiles_y, np.int64)
    total = 0
    for n in range(len(visible)):
        surfel_start[n] = total
        if visible[n]:
            x0, x1, y0, y1 = i64(boxes[n, 0]), i64(boxes[n, 1]), i64(boxes[n, 2]), i64(boxes[n, 3])
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    per_tile[y * tiles_x + x] += 1
            total += (x1 - x0 + 1) * (y1 - y0 + 1)
    surfel_start[len(visible)] = total
    offsets[0] = 0
    for t in range(tiles_x * tiles_y):
        offsets[t + 1] = offsets[t] + per_tile[t]
    return total


@njit(**FAST)
def fill_tiles(low, high, order, boxes, tiles_x, surfel_start, offsets, ids, place):
    """Tile lists in depth order for a band of tile rows, and for each entry the place of its gradient row.

    Rows lie surfel after surfel: scattered stores in backward wait for nobody, scattered loads in the reduction would.
    """
    cursor = offsets[low * tiles_x : high * tiles_x].copy()
    for i in range(len(order)):
        n = order[i]
        y0, y1 = i64(boxes[n, 2]), i64(boxes[n, 3])
        if y1 < low or y0 >= high:
            continue
        x0, x1 = i64(boxes[n, 0]), i64(boxes[n, 1])
        across = x1 - x0 + 1
        for y in range(max(y0, low), min(y1, high - 1) + 1):
            for x in range(x0, x1 + 1):
                k = (y - low) * tiles_x + x
                entry = cursor[k]
                cursor[k] = entry + 1
                ids[entry] = i
                place[entry] = surfel_start[n] + (y - y0) * across + (x - x0)


@njit(**FAST)
def reduce_rows(first, end, records, visible, surfel_start, rows, means, quats, log_scales, opacity_logits, sh, R, t, eye,
                fx, fy, coefficients, g_means, g_quats, g_log_scales, g_opacity_logits, g_sh, g_screen):  # fmt: skip
    """Sum each surfel's rows in a fixed order and carry them back to its parameters; zero for those off the screen."""
    for n in range(first, end):
        for k in range(coefficients if visible[n] else 0, g_sh.shape[1]):
            for c in range(3):
                g_sh[n, k, c] = ZERO
        if not visible[n]:
            for k in range(3):
                g_means[n, k] = ZERO
            for k in range(4):
                g_quats[n, k] = ZERO
            for k in range(2):
                g_log_scales[n, k] = ZERO
                g_screen[n, k] = ZERO
            g_opacity_logits[n] = ZERO
            continue
        a = np.zeros(ROW, f32)
        for s in range(surfel_start[n], surfel_start[n + 1]):
            for k in range(ROW):
                a[k] += rows[s, k]
        X = R[0, 0] * means[n, 0] + R[0, 1] * means[n, 1] + R[0, 2] * means[n, 2] + t[0]
        Y = R[1, 0] * means[n, 0] + R[1, 1] * means[n, 1] + R[1, 2] * means[n, 2] + t[1]
        Z = R[2, 0] * means[n, 0] + R[2, 1] * means[n, 1] + R[2, 2] * means[n, 2] + t[2]
        iz = 1.0 / Z
        inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
            f64(quats[n, 0]), f64(quats[n, 1]), f64(quats[n, 2]), f64(quats[n, 3])
        )
        floor = SCALE_MIN_PX * Z / max(fx, fy)
        s0, slope0 = held_scale(log_scales[n, 0], floor)
        s1, slope1 = held_scale(log_scales[n, 1], floor)
        t00 = R[0, 0] * r0 + R[0, 1] * r3 + R[0, 2] * r6
        t01 = R[1, 0] * r0 + R[1, 1] * r3 + R[1, 2] * r6
        t02 = R[2, 0] * r0 + R[2, 1] * r3 + R[2, 2] * r6
        t10 = R[0, 0] * r1 + R[0, 1] * r4 + R[0, 2] * r7
        t11 = R[1, 0] * r1 + R[1, 1] * r4 + R[1, 2] * r7
        t12 = R[2, 0] * r1 + R[2, 1] * r4 + R[2, 2] * r7
        nx = R[0, 0] * r2 + R[0, 1] * r5 + R[0, 2] * r8
        ny = R[1, 0] * r2 + R[1, 1] * r5 + R[1, 2] * r8
        nz = R[2, 0] * r2 + R[2, 1] * r5 + R[2, 2] * r8
        facing = nx * X + ny * Y + nz * Z
        distance = np.sqrt(X * X + Y * Y + Z * Z)
        edge_on = abs(facing) < EDGE_ON * distance
        side = -1.0 if facing > 0.0 and not edge_on else 1.0
        xn, yn, W0, W1 = X * iz, Y * iz, t02 * s0, t12 * s1
        U0, U1 = fx * (t00 * s0 - xn * W0), fx * (t10 * s1 - xn * W1)
        V0, V1 = fy * (t01 * s0 - yn * W0), fy * (t11 * s1 - yn * W1)
        g_cx, g_cy, g_Z = 2.0 * a[13], 2.0 * a[14], 0.0
        g_U0, g_U1, g_V0, g_V1, g_W0, g_W1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if not edge_on:
            g = Z / (U0 * V1 - U1 * V0)
            A0, B0, A1, B1 = V1 * g, -U1 * g, -V0 * g, U0 * g
            A2, B2 = -(W0 * A0 + W1 * A1) * iz, -(W0 * B0 + W1 * B1) * iz
            g_cx -= A0 * a[0] + A1 * a[3] + A2 * a[6]
            g_cy -= B0 * a[0] + B1 * a[3] + B2 * a[6]
            # A = (J / Z)^-1 and (a2, b2) = -(W0 (a0, b0) + W1 (a1, b1)) / Z, backwards
            g_a2, g_b2 = f64(a[7]), f64(a[8])
            g_a0, g_a1 = a[1] - W0 * iz * g_a2, a[4] - W1 * iz * g_a2
            g_b0, g_b1 = a[2] - W0 * iz * g_b2, a[5] - W1 * iz * g_b2
            g_W0, g_W1 = -(A0 * g_a2 + B0 * g_b2) * iz, -(A1 * g_a2 + B1 * g_b2) * iz
            m00, m01 = A0 * g_a0 + A1 * g_a1, A0 * g_b0 + A1 * g_b1
            m10, m11 = B0 * g_a0 + B1 * g_a1, B0 * g_b0 + B1 * g_b1
            g_U0, g_U1 = -(m00 * A0 + m01 * B0) * iz, -(m00 * A1 + m01 * B1) * iz
            g_V0, g_V1 = -(m10 * A0 + m11 * B0) * iz, -(m10 * A1 + m11 * B1) * iz
            g_Z = -(A2 * g_a2 + B2 * g_b2) * iz - (U0 * g_U0 + U1 * g_U1 + V0 * g_V0 + V1 * g_V1) * iz
        h00, h10, h01, h11 = fx * g_U0, fx * g_U1, fy * g_V0, fy * g_V1
        h02 = -fx * xn * g_U0 - fy * yn * g_V0 + g_W0
        h12 = -fx * xn * g_U1 - fy * yn * g_V1 + g_W1
        g_xn, g_yn = fx * (g_cx - g_U0 * W0 - g_U1 * W1), fy * (g_cy - g_V0 * W0 - g_V1 * W1)
        g_X, g_Y = g_xn * iz, g_yn * iz
        g_Z -= (xn * g_xn + yn * g_yn) * iz + a[15] * iz * iz
        gm0 = R[0, 0] * g_X + R[1, 0] * g_Y + R[2, 0] * g_Z
        gm1 = R[0, 1] * g_X + R[1, 1] * g_Y + R[2, 1] * g_Z
        gm2 = R[0, 2] * g_X + R[1, 2] * g_Y + R[2, 2] * g_Z
        # Colour: no gradient where the clamp at zero held it.
        red = f64(a[10]) if records[n, R_RED] > ZERO else 0.0
        green = f64(a[11]) if records[n, R_GREEN] > ZERO else 0.0
        blue = f64(a[12]) if records[n, R_BLUE] > ZERO else 0.0
        dx, dy, dz = (
            (means[n, 0] - eye[0]) / distance,
            (means[n, 1] - eye[1]) / distance,
            (means[n, 2] - eye[2]) / distance,
        )
        g_sh[n, 0, 0], g_sh[n, 0, 1], g_sh[n, 0, 2] = SH0 * red, SH0 * green, SH0 * blue
        if coefficients > 1:
            basis = sh_basis(dx, dy, dz)
            by_x, by_y, by_z = sh_slopes(dx, dy, dz)
            red32, green32, blue32 = f32(red), f32(green), f32(blue)
            gx, gy, gz = 0.0, 0.0, 0.0
            for k in range(1, coefficients):
                value = f32(basis[k])
                g_sh[n, k, 0], g_sh[n, k, 1], g_sh[n, k, 2] = value * red32, value * green32, value * blue32
                weight = red32 * sh[n, k, 0] + green32 * sh[n, k, 1] + blue32 * sh[n, k, 2]
                gx += weight * by_x[k]
                gy += weight * by_y[k]
                gz += weight * by_z[k]
            radial = gx * dx + gy * dy + gz * dz
            gm0 += (gx - radial * dx) / distance
            gm1 += (gy - radial * dy) / distance
            gm2 += (gz - radial * dz) / distance
        g_means[n, 0], g_means[n, 1], g_means[n, 2] = gm0, gm1, gm2
        g_log_scales[n, 0] = slope0 * (h00 * t00 + h01 * t01 + h02 * t02)
        g_log_scales[n, 1] = slope1 * (h10 * t10 + h11 * t11 + h12 * t12)
        h00, h01, h02, h10, h11, h12 = h00 * s0, h01 * s0, h02 * s0, h10 * s1, h11 * s1, h12 * s1
        h20, h21, h22 = side * a[16], side * a[17], side * a[18]
        G0 = R[0, 0] * h00 + R[1, 0] * h01 + R[2, 0] * h02
        G3 = R[0, 1] * h00 + R[1, 1] * h01 + R[2, 1] * h02
        G6 = R[0, 2] * h00 + R[1, 2] * h01 + R[2, 2] * h02
        G1 = R[0, 0] * h10 + R[1, 0] * h11 + R[2, 0] * h12
        G4 = R[0, 1] * h10 + R[1, 1] * h11 + R[2, 1] * h12
        G7 = R[0, 2] * h10 + R[1, 2] * h11 + R[2, 2] * h12
        G2 = R[0, 0] * h20 + R[1, 0] * h21 + R[2, 0] * h22
        G5 = R[0, 1] * h20 + R[1, 1] * h21 + R[2, 1] * h22
        G8 = R[0, 2] * h20 + R[1, 2] * h21 + R[2, 2] * h22
        gw = 2.0 * (x * (G7 - G5) + y * (G2 - G6) + z * (G3 - G1))
        gx = 2.0 * (-2.0 * x * (G4 + G8) + y * (G1 + G3) + z * (G2 + G6) + w * (G7 - G5))
        gy = 2.0 * (x * (G1 + G3) - 2.0 * y * (G0 + G8) + z * (G5 + G7) + w * (G2 - G6))
        gz = 2.0 * (x * (G2 + G6) + y * (G5 + G7) - 2.0 * z * (G0 + G4) + w * (G3 - G1))
        along = gw * w + gx * x + gy * y + gz * z
        g_quats[n, 0] = (gw - along * w) * inverse
        g_quats[n, 1] = (gx - along * x) * inverse
        g_quats[n, 2] = (gy - along * y) * inverse
        g_quats[n, 3] = (gz - along * z) * inverse
        # sigmoid' without cancellation near 1
        decay = np.exp(-abs(f64(opacity_logits[n])))
        g_opacity_logits[n] = a[9] * decay / ((1.0 + decay) * (1.0 + decay))
        g_screen[n, 0], g_screen[n, 1] = g_cx, g_cy


CHUNK = 8192


@njit(**FAST)
def count_not_finite(first, end, bits, bad):
    """How many of some float32 numbers, given by their bits, are NaN or infinite (fast math forgets NaN); ``bad`` gets
    the count of each chunk of ``CHUNK``."""
    for chunk in range(first // CHUNK, (end + CHUNK - 1) // CHUNK):
        here = np.uint32(0)
        for i in range(u64(chunk * CHUNK), u64(min(bits.size, (chunk + 1) * CHUNK))):
            here += np.uint32((bits[i] & np.uint32(0x7F800000)) == np.uint32(0x7F800000))
        bad[chunk] = here
