"""Which input of an inpainting network is the image, which the mask, which the reference, and how each wants its pixels.

By names (``mask``; ``reference``, ``ref``, ``exemplar``, ``example``) and by the number of channels: 3 colours, 1 mask,
4 the image that is black in its holes and then the mask. The last is LaMa as a bare network (Suvorov et al., *Resolution-robust
large mask inpainting with Fourier convolutions*, 2022), the first two LaMa with what its authors put around it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.networks.onnx_files import ONNX_TYPES, describe

__all__ = ["BOTH", "IMAGE", "MASK", "REFERENCE", "Port", "SignatureProblem", "read_ports"]

IMAGE, MASK, BOTH, REFERENCE = "image", "mask", "image and mask", "reference"
CHANNELS = {IMAGE: 3, MASK: 1, BOTH: 4, REFERENCE: 3}
SMALLEST_PX = 16
"""No network that inpaints takes less on a side; what declares less is something else."""


class SignatureProblem(Exception):
    """What is wrong with the inputs, a short phrase."""


@dataclass(frozen=True)
class Port:
    """One input.

    Attributes:
        name: in the file; role: ``IMAGE``, ``MASK``, ``BOTH`` or ``REFERENCE``.
        last: whether channels come last (1, H, W, C) instead of first (1, C, H, W).
        dtype: floating point gets [0, 1], uint8 0 to 255, bool only masks; a mask is largest where it is to be filled.
        height, width: fixed, or None.
    """

    name: str
    role: str
    last: bool
    dtype: type[np.generic]
    height: int | None
    width: int | None

    def tensor(self, planes: NDArray[np.float32]) -> NDArray[np.generic]:
        """(H, W, C) in [0, 1] as this input wants it, with its batch of one."""
        if self.dtype is np.uint8:
            values: NDArray[np.generic] = np.round(planes * 255).astype(np.uint8)
        else:
            values = planes > 0.5 if self.dtype is np.bool_ else planes.astype(self.dtype)
        return np.ascontiguousarray(values[None] if self.last else values.transpose(2, 0, 1)[None])


def read_ports(inputs: Sequence[Any], *, reference: bool) -> list[Port]:
    """The inputs of a session (``session.get_inputs()``), each with its role.

    Args:
        reference: whether the network must take a reference; else it must not.
    Raises:
        SignatureProblem: they are not those of such a network.
    """
    ports = [_port(i) for i in inputs]
    roles = sorted(p.role for p in ports)
    painted = [sorted(r) for r in ([IMAGE, MASK], [BOTH])]
    with_reference = [sorted([*r, REFERENCE]) for r in painted]
    if roles not in (with_reference if reference else painted):
        if not reference and roles in with_reference:
            raise SignatureProblem("takes a reference beside the image: give it with --reference-inpainter")
        if reference and roles in painted:
            raise SignatureProblem("takes no reference: give it with --inpainter")
        hint = " of which none is called reference" if roles in (sorted([IMAGE, IMAGE, MASK]),) else ""
        raise SignatureProblem(f"has the inputs {describe(inputs)}{hint}")
    sizes = {(p.height, p.width) for p in ports if p.role != REFERENCE}
    if len(sizes) > 1:
        raise SignatureProblem(f"wants image and mask of different sizes: {describe(inputs)}")
    return ports


def _port(given: Any) -> Port:
    name, shape = given.name, list(given.shape or ())
    if given.type not in ONNX_TYPES:
        raise SignatureProblem(f"wants {describe([given])}, and is given float, float16, double or uint8")
    dtype = ONNX_TYPES[given.type]
    if len(shape) != 4:
        raise SignatureProblem(f"wants {describe([given])}, and is given four dimensions (1, C, H, W) or (1, H, W, C)")
    if isinstance(shape[0], int) and shape[0] != 1:
        raise SignatureProblem(f"wants {shape[0]} images at a time in {describe([given])}, and is given one")
    counts = set(CHANNELS.values())
    last = shape[1] not in counts and shape[3] in counts
    channels = shape[3] if last else shape[1]
    if isinstance(channels, int) and channels not in counts:
        raise SignatureProblem(f"wants {describe([given])}, neither an image (3 channels) nor a mask (1) nor both (4)")
    role = _role(name, channels if isinstance(channels, int) else None)
    if channels != CHANNELS[role] and isinstance(channels, int):
        raise SignatureProblem(f"wants {describe([given])}: a {role} has {CHANNELS[role]} channels, not {channels}")
    if dtype is np.bool_ and role != MASK:
        raise SignatureProblem(f"wants {describe([given])}: only a mask can be bool")
    height, width = (d if isinstance(d, int) else None for d in (shape[1:3] if last else shape[2:4]))
    for side in (height, width):
        if side is not None and side < SMALLEST_PX:
            raise SignatureProblem(f"wants {describe([given])}: fewer than {SMALLEST_PX} pixels on a side")
    return Port(name, role, last, dtype, height, width)


def _role(name: str, channels: int | None) -> str:
    """By name where that says something, else by the channels."""
    words = re.split(r"[^a-z]+", re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower())
    if any(w in ("ref", "refs", "exemplar", "example") or w.startswith("reference") for w in words):
        return REFERENCE
    if any(w in ("mask", "masks", "hole", "holes") for w in words) and channels != 4 and "image" not in words:
        return MASK
    return {1: MASK, 4: BOTH}.get(channels or 0, IMAGE)
