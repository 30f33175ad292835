"""A phone that films: each row at its own moment, in a hand that shakes, with an exposure that follows the light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sample_scenes.generators.phone_clip.street import ASPHALT, BRICK, CLOTH, GLASS, LEAVES, METAL, PAINT, PLASTER, SLABS, WOOD
from unveil_core.base.kernels.compiled import njit

__all__ = ["Phone", "exposure", "picture", "pose", "things"]

SUN = np.array([-0.38, -0.52, 0.76])
SUN /= np.linalg.norm(SUN)
FIRST_M, STRETCH_M, STRETCHES = -40.0, 4.0, 45
"""Where the first stretch of the street begins along x, how long each is, and how many there are."""
NOISE = 0.006
"""Of the sensor, of full scale."""


@dataclass(frozen=True)
class Phone:
    """Attributes: width, height: pixels; focal_px; rate: pictures a second; readout_s: from the first row to the last."""

    width: int = 960
    height: int = 540
    focal_px: float = 700.0
    rate: float = 12.0
    readout_s: float = 0.022
    speed: float = 4.0
    camera_height: float = 1.55
    shake: float = 1.0


def pose(phone: Phone, seconds: float) -> np.ndarray:
    """(4, 4) camera to world with OpenCV axes, at a moment."""
    t = seconds
    parts = (
        ((0.0040, 1.1, 0.3), (0.0016, 2.7, 1.9), (0.0005, 6.1, 0.5)),
        ((0.0045, 0.9, 2.1), (0.0018, 3.1, 0.2), (0.0005, 5.3, 2.6)),
        ((0.0050, 0.7, 1.2), (0.0014, 2.3, 2.9), (0.0004, 4.7, 0.9)),
    )
    shake = [phone.shake * sum(a * math.sin(2 * math.pi * f * t + p) for a, f, p in part) for part in parts]
    x = phone.speed * t + 0.3 * math.sin(0.9 * t)
    y = -0.5 + 0.45 * math.sin(0.55 * t)
    z = phone.camera_height + 0.02 * phone.shake * math.sin(2 * math.pi * 1.6 * t)
    yaw = 0.45 * 0.55 / phone.speed * math.cos(0.55 * t) + shake[0] + 0.02 * math.sin(0.4 * t)
    pitch, roll = math.radians(3.0) + shake[1], shake[2]
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)])
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    right, down = math.cos(roll) * right + math.sin(roll) * down, math.cos(roll) * down - math.sin(roll) * right
    found = np.eye(4)
    found[:3, 0], found[:3, 1], found[:3, 2], found[:3, 3] = right, down, forward, (x, y, z)
    return found


def exposure(seconds: float) -> float:
    """Factor, as a phone's automatic follows the light: late, and a little too far."""
    return float(2 ** (0.25 * math.sin(0.75 * seconds) - 0.1 * math.sin(1.9 * seconds + 0.6)))


def picture(
    phone: Phone, boxes: tuple[np.ndarray, ...], seconds: float, *, samples: int = 2
) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) uint8 RGB and (H, W) trainIds of the frame that begins at a moment.

    Args:
        boxes: as ``Street.arrays`` gives them.
        samples: to a pixel.
    """
    poses = np.stack([pose(phone, seconds + phone.readout_s * row / phone.height) for row in range(phone.height)])
    light = np.zeros((phone.height, phone.width, 3), np.float32)
    kinds = np.zeros((phone.height, phone.width), np.uint8)
    centre, half, turn, colour, material, kind, _ = boxes
    starts, members = stretches(boxes)
    _film(poses, phone.focal_px, samples, SUN, centre, half, turn, starts, members, colour, material, kind, light, kinds)
    rng = np.random.default_rng(round(seconds * 1000))
    light = np.clip(1.9 * exposure(seconds) * light, 0, 1)
    shown = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    shown = shown + rng.normal(0, NOISE, shown.shape)
    return np.clip(np.round(shown * 255), 0, 255).astype(np.uint8), kinds


def things(phone: Phone, boxes: tuple[np.ndarray, ...], seconds: float) -> np.ndarray:
    """(H, W) uint16 numbers of the objects that each pixel of the frame that begins at a moment shows, 0 = none: cars and people."""
    poses = np.stack([pose(phone, seconds + phone.readout_s * row / phone.height) for row in range(phone.height)])
    numbers = np.zeros((phone.height, phone.width), np.uint16)
    starts, members = stretches(boxes)
    _number(poses, phone.focal_px, *boxes[:3], starts, members, boxes[6].astype(np.uint16), numbers)
    return numbers


@njit(cache=True, nogil=True)
def _number(poses, focal, centre, half, turn, starts, members, thing, numbers):  # type: ignore[no-untyped-def]
    """Fill ``numbers`` (H, W) by the middle of each pixel, of rows that each have a pose (H, 4, 4)."""
    height, width = numbers.shape
    for row in range(height):
        m = poses[row]
        for column in range(width):
            x, y = (column + 0.5 - width / 2) / focal, (row + 0.5 - height / 2) / focal
            rx = m[0, 0] * x + m[0, 1] * y + m[0, 2]
            ry = m[1, 0] * x + m[1, 1] * y + m[1, 2]
            rz = m[2, 0] * x + m[2, 1] * y + m[2, 2]
            _, k, _ = _meet(m[0, 3], m[1, 3], m[2, 3], rx, ry, rz, centre, half, turn, starts, members, 1e9)
            numbers[row, column] = thing[k] if k >= 0 else 0


@njit(cache=True, nogil=True)
def _hash(x, y, z):  # type: ignore[no-untyped-def]
    """A number in [0, 1) for a place of whole numbers."""
    n = (x * 374761393 + y * 668265263 + z * 2147483647) & 0x7FFFFFFF
    n = ((n ^ (n >> 13)) * 1274126177) & 0x7FFFFFFF
    return ((n ^ (n >> 16)) & 0xFFFF) / 65536.0


@njit(cache=True, nogil=True)
def _noise(x, y, z):  # type: ignore[no-untyped-def]
    """Smooth noise in [0, 1), with one wave to a unit."""
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    i, j = int(i), int(j)
    a, b = _hash(i, j, z), _hash(i + 1, j, z)
    c, d = _hash(i, j + 1, z), _hash(i + 1, j + 1, z)
    return (a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v


@njit(cache=True, nogil=True)
def _rough(x, y, z, octaves):  # type: ignore[no-untyped-def]
    """Noise of several sizes, about 0.5."""
    total, size = 0.0, 0.5
    for k in range(octaves):
        total += size * _noise(x, y, z + k)
        x, y, size = 2.03 * x, 2.03 * y, 0.5 * size
    return total / (1 - 2 * size) if octaves > 1 else total * 2


@njit(cache=True, nogil=True)
def _enter(ox, oy, oz, rx, ry, rz, centre, half, turn, k, best):  # type: ignore[no-untyped-def]
    """Distance at which a ray enters box ``k``, negative where it does not before ``best``, and the axis of the face."""
    c, s = turn[k, 0], turn[k, 1]
    px, py, pz = ox - centre[k, 0], oy - centre[k, 1], oz - centre[k, 2]
    enter, leave, side = 0.0, best, 0
    for axis in range(3):
        if axis == 0:
            o, r = px * c + py * s, rx * c + ry * s
        elif axis == 1:
            o, r = py * c - px * s, ry * c - rx * s
        else:
            o, r = pz, rz
        if abs(r) < 1e-12:
            if abs(o) > half[k, axis]:
                return -1.0, 0
            continue
        a, b = (-half[k, axis] - o) / r, (half[k, axis] - o) / r
        low, high = min(a, b), max(a, b)
        if low > enter:
            enter, side = low, axis
        leave = min(leave, high)
        if enter >= leave:
            return -1.0, 0
    return (enter, side) if enter > 1e-9 else (-1.0, 0)


@njit(cache=True, nogil=True)
def _meet(ox, oy, oz, rx, ry, rz, centre, half, turn, starts, members, nearest):  # type: ignore[no-untyped-def]
    """Distance to the nearest box along a ray below ``nearest``, which box, and the axis of the face that it enters.

    Args:
        starts, members: boxes of each stretch of the street, one after the other; the first is of those that reach over many.
    """
    best, found, face = nearest, -1, 0
    for m in range(starts[0], starts[1]):
        far, side = _enter(ox, oy, oz, rx, ry, rz, centre, half, turn, members[m], best)
        if far > 0:
            best, found, face = far, members[m], side
    count = len(starts) - 2
    place = int((ox - FIRST_M) / STRETCH_M)
    step = 1 if rx >= 0 else -1
    while 0 <= place < count:
        for m in range(starts[place + 1], starts[place + 2]):
            far, side = _enter(ox, oy, oz, rx, ry, rz, centre, half, turn, members[m], best)
            if far > 0:
                best, found, face = far, members[m], side
        if abs(rx) < 1e-9:
            break
        edge = FIRST_M + STRETCH_M * (place + (1 if step > 0 else 0))
        if (edge - ox) / rx > best:
            break
        place += step
    return best, found, face


def stretches(boxes: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Boxes by stretch of the street, as :func:`_meet` takes them."""
    centre, half, turn = boxes[0], boxes[1], boxes[2]
    reach = np.abs(half[:, 0] * turn[:, 0]) + np.abs(half[:, 1] * turn[:, 1])
    first = np.floor((centre[:, 0] - reach - FIRST_M) / STRETCH_M).astype(int)
    last = np.floor((centre[:, 0] + reach - FIRST_M) / STRETCH_M).astype(int)
    wide = last - first > 8
    lists = [np.flatnonzero(wide)]
    for place in range(STRETCHES):
        lists.append(np.flatnonzero(~wide & (first <= place) & (last >= place)))
    return np.concatenate([[0], np.cumsum([len(part) for part in lists])]), np.concatenate(lists)


@njit(cache=True, nogil=True)
def _reflectance(material, k, u, v, colour, out):  # type: ignore[no-untyped-def]
    """Colour of a place (u, v) in metres on a face of box ``k``."""
    for c in range(3):
        out[c] = colour[k, c]
    if material == ASPHALT:
        grain = 0.55 + 0.5 * _rough(14 * u, 14 * v, 3, 4) + 0.5 * _rough(0.4 * u, 0.9 * v, 9, 3)
        if abs(_rough(0.7 * u, 0.7 * v, 21, 3) - 0.5) < 0.004:
            grain *= 0.45  # a crack
        if (abs(v) < 0.07 and (u / 6.0) % 1 < 0.5) or abs(abs(v) - 2.62) < 0.05:
            grain = 3.2 + 0.8 * _noise(9 * u, 9 * v, 5)
        for c in range(3):
            out[c] *= grain
    elif material == SLABS:
        a, b = u / 0.6, v / 0.4 + 0.5 * (math.floor(u / 0.6) % 2)
        joint = min(a % 1, 1 - a % 1) < 0.03 or min(b % 1, 1 - b % 1) < 0.04
        tone = 0.75 + 0.35 * _hash(int(math.floor(a)), int(math.floor(b)), 2) + 0.3 * (_rough(8 * u, 8 * v, 4, 3) - 0.5)
        for c in range(3):
            out[c] *= 0.45 if joint else tone
    elif material == BRICK or material == PLASTER:
        a, b = u / 2.4, v / 2.9
        inside_u, inside_v = (a % 1) - 0.5, (b % 1) - 0.58
        window = abs(inside_u) < 0.22 and abs(inside_v) < 0.26 and b > 0.35
        frame = window and (abs(inside_u) > 0.195 or abs(inside_v) > 0.235 or abs(inside_u) < 0.012)
        if frame:
            for c in range(3):
                out[c] = 0.75
        elif window:
            shine = 0.04 + 0.16 * _rough(1.5 * u, 0.7 * v, int(math.floor(a)) + 7 * int(math.floor(b)), 3)
            out[0], out[1], out[2] = shine, shine * 1.1, shine * 1.25
        elif material == BRICK:
            row = math.floor(v / 0.075)
            at = u / 0.24 + 0.5 * (row % 2)
            mortar = (v / 0.075) % 1 < 0.16 or at % 1 < 0.06
            tone = 0.7 + 0.6 * _hash(int(math.floor(at)), int(row), k) + 0.25 * (_rough(3 * u, 3 * v, k, 3) - 0.5)
            for c in range(3):
                out[c] = 0.4 if mortar else out[c] * tone
        else:
            stain = 0.8 + 0.25 * _rough(0.8 * u, 0.5 * v, k, 4) + 0.3 * (_rough(11 * u, 11 * v, k + 1, 3) - 0.5)
            for c in range(3):
                out[c] *= stain
    elif material == LEAVES:
        tone = 0.3 + 1.5 * _rough(9 * u, 9 * v, k, 4) ** 2
        for c in range(3):
            out[c] *= tone
    elif material == WOOD:
        tone = 0.6 + 0.8 * _rough(30 * u, 2 * v, k, 3)
        for c in range(3):
            out[c] *= tone
    elif material == CLOTH or material == METAL:
        tone = 0.75 + 0.5 * _rough(10 * u, 10 * v, k, 3)
        for c in range(3):
            out[c] *= tone
    elif material == PAINT:
        line = abs(abs(u) - 0.55) < 0.012 or abs(v) < 0.01
        for c in range(3):
            out[c] *= 0.4 if line else 0.92 + 0.16 * _rough(1.1 * u, 1.1 * v, k, 3)


@njit(cache=True, nogil=True)
def _film(poses, focal, samples, sun, centre, half, turn, starts, members, colour, material, kind, light, kinds):  # type: ignore[no-untyped-def]
    """Fill ``light`` (H, W, 3), linear, and ``kinds`` (H, W) of rows that each have a pose (H, 4, 4)."""
    height, width = kinds.shape
    base = np.zeros(3)
    for row in range(height):
        m = poses[row]
        ox, oy, oz = m[0, 3], m[1, 3], m[2, 3]
        for column in range(width):
            for a in range(samples):
                x = (column + (a + 0.5) / samples - width / 2) / focal
                y = (row + ((5 * a + 2) % samples + 0.5) / samples - height / 2) / focal
                rx = m[0, 0] * x + m[0, 1] * y + m[0, 2]
                ry = m[1, 0] * x + m[1, 1] * y + m[1, 2]
                rz = m[2, 0] * x + m[2, 1] * y + m[2, 2]
                far, k, face = _meet(ox, oy, oz, rx, ry, rz, centre, half, turn, starts, members, 1e9)
                if k < 0:
                    up = rz / math.sqrt(rx * rx + ry * ry + rz * rz)
                    cloud = _rough(1.2 * rx / (abs(rz) + 0.2), 1.2 * ry / (abs(rz) + 0.2), 40, 4)
                    base[0] = 0.50 + 0.25 * cloud - 0.2 * up
                    base[1] = 0.58 + 0.2 * cloud - 0.16 * up
                    base[2] = 0.70 + 0.1 * cloud - 0.08 * up
                    if a == 0:
                        kinds[row, column] = 10
                else:
                    px, py, pz = ox + far * rx, oy + far * ry, oz + far * rz
                    c, s = turn[k, 0], turn[k, 1]
                    dx, dy, dz = px - centre[k, 0], py - centre[k, 1], pz - centre[k, 2]
                    lx, ly = dx * c + dy * s, dy * c - dx * s
                    n0, n1, n2 = 0.0, 0.0, 0.0
                    if face == 0:
                        sign = 1.0 if lx > 0 else -1.0
                        n0, n1, u, v = sign * c, sign * s, ly, dz
                    elif face == 1:
                        sign = 1.0 if ly > 0 else -1.0
                        n0, n1, u, v = -sign * s, sign * c, lx, dz
                    else:
                        n2, u, v = (1.0 if dz > 0 else -1.0), lx, ly
                    if material[k] == BRICK or material[k] == PLASTER:
                        v = pz
                    _reflectance(material[k], k, u, v, colour, base)
                    facing = n0 * sun[0] + n1 * sun[1] + n2 * sun[2]
                    lit = 0.0
                    if facing > 0:
                        e = 1e-3
                        _, hit, _ = _meet(
                            px + e * n0, py + e * n1, pz + e * n2, sun[0], sun[1], sun[2],
                            centre, half, turn, starts, members, 60.0,
                        )
                        lit = facing if hit < 0 else 0.0
                    ambient = 0.24 + 0.08 * n2
                    if material[k] == GLASS:
                        ambient += 0.9
                    for i in range(3):
                        base[i] *= ambient * (0.94, 1.0, 1.1)[i] + lit * (0.85, 0.8, 0.7)[i]
                    if a == 0:
                        kinds[row, column] = kind[k]
                for i in range(3):
                    light[row, column, i] += base[i] / samples
