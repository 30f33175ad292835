"""What every backend computes: constants, planes, and the mathematics in one place.

Surfels (*2D Gaussian Splatting*, SIGGRAPH 2024, sections 4.1 and 4.2). A disc has a centre p, unit tangents t_u, t_v
and standard deviations s_u, s_v. In the camera's frame let ``h_u = s_u t_u``, ``h_v = s_v t_v`` and ``p = (X, Y,
Z)``; c is the projection of p.

**Ray-splat intersection, re-centred at c.** With x = X / Z, y = Y / Z let

    J = [[fx (h_u.x - x h_u.z), fx (h_v.x - x h_v.z)],      A = [[a0, b0], [a1, b1]] = (J / Z)^-1
         [fy (h_u.y - y h_u.z), fy (h_v.y - y h_v.z)]],     (a2, b2) = -(h_u.z (a0, b0) + h_v.z (a1, b1)) / Z

and for a pixel at c + (dx, dy)

    q = 1 + a2 dx + b2 dy,   u = (a0 dx + b0 dy) / q,   v = (a1 dx + b1 dy) / q,   depth = Z / q.

This is equations 8 to 10 of the paper after dividing out Z; it stays well conditioned in float32 far from the origin
and at grazing angles.

**Weight.** G = exp(-min(u^2 + v^2, 2 |d|^2) / 2): the second term is the paper's screen-space low-pass filter
(equation 11), centred on the projected mean; where it wins, the depth is that of the centre. alpha = min(0.99,
opacity G); contributions under 1/255 or nearer than ``near`` do not count; a pixel is finished before the surfel that
would bring its transmittance T under 1e-4. So a surfel reaches no farther than sqrt(2 ln(255 opacity)) standard
deviations, exactly. Surfels are composited in the order of Z rounded to float32, ties by index.

**Ellipsoids** (Zwicker et al., *EWA Volume Splatting*, 2001, section 4; Kerbl et al., *3D Gaussian Splatting*, 2023,
equations 5 and 6) are surfels with three scales. With R's columns in the camera's frame and x, y as above

    W = Jp R diag(s),   Jp = [[fx / Z, 0, -fx x / Z], [0, fy / Z, -fy y / Z]],   C = W W^T + DILATION I

is the footprint's covariance in square pixels, and

    [[a0, b0], [0, b1]]^T [[a0, b0], [0, b1]] = C^-1,   a1 = a2 = b2 = 0,

so that q = 1, u^2 + v^2 = d^T C^-1 d, and the depth is Z at every pixel. From there on they are treated as discs are.

* ``DILATION`` is 1 / 2, where implementations of 3DGS add 0.3: the discs' low-pass filter 2 |d|^2 is then never the
  smaller one, and both kinds are filtered alike.
* In Jp alone, x and y are held within ``FIELD_MARGIN`` times half the field of view from the image's middle, without a
  gradient beyond: the first-order footprint grows without bound away from it.
* The normal is the axis of the smallest scale, the last of equals, turned like a disc's. Which one that is has no
  gradient.

**Limits**, the same for every backend, so that finite parameters always give finite images and gradients:

* A surfel whose centre is nearer than ``near`` is left out whole, even where its edge reaches before the camera. So
  is one whose centre is farther than ``DEPTH_MAX`` or projects more than ``OFFSET_MAX`` pixels from the principal
  point: float32 cannot place it.
* A disc seen under a sine of less than ``EDGE_ON`` has no intersection, only its low-pass filter: the rows of A are
  then parallel to the last digit. Its normal is its own third axis, unturned, because no side faces the camera.
* Standard deviations are held between ``SCALE_MIN_PX`` pixels at the centre's depth and ``exp(LOG_SCALE_MAX)``;
  beyond, they have no gradient. A zero quaternion is no rotation, and has no gradient.

**Planes.** With w_i = alpha_i T_i: rgb, alpha, semantics (per label), depth and normal are sums of w_i times the
value; the median depth is the depth of the last surfel met while T > 1/2. The normal is in the camera's frame and
faces the camera.

**Distortion** (equation 13), with the mapped depth m = (far - far near / depth) / (far - near):

    L_d = sum_{i<j} w_i w_j (m_i - m_j)^2 = sum_i w_i (m_i^2 A_i + Q_i - 2 m_i M_i)

with A, M, Q the prefix sums of w, w m and w m^2.

The sum does not change when a constant is taken from all m. Taking the first hit's m keeps float32 gradients exact to
1e-5, where the textbook form is wrong by up to 4 %. Its gradient needs only the totals: dL_d/dw_i = m_i^2 A + Q - 2
m_i M. The label distortion is the same sum per label, each label with its own transmittance as if the others were not
there (*3D StreetUnveiler*, section 3.1), in the one pass; a pixel that is finished is finished for every label.

**Gradient by alpha.** With v_i = dL/dw_i and S_i the sum of w_j v_j over the surfels behind i: dL/dalpha_i = T_i v_i
- S_i / (1 - alpha_i). One scalar sum serves all planes.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "ALPHA_MAX",
    "ALPHA_MIN",
    "DEPTH_MAX",
    "DILATION",
    "EDGE_ON",
    "FIELD_MARGIN",
    "GENEROUS",
    "LOG_SCALE_MAX",
    "LOW_PASS",
    "Limits",
    "MAX_LABELS",
    "OFFSET_MAX",
    "PLANES",
    "SCALE_MIN_PX",
    "TRANSMITTANCE_MIN",
]

ALPHA_MIN = 1.0 / 255.0
ALPHA_MAX = 0.99
TRANSMITTANCE_MIN = 0.9999e-4
"""A hair under 1e-4: two surfels of alpha 0.99 leave exactly 1e-4, and float32 and float64 must decide them alike."""
LOW_PASS = 2.0
DILATION = 0.500001
"""A hair over 1 / LOW_PASS: the footprint's distance must be the smaller one in float32 too, or gradients get lost."""
FIELD_MARGIN = 1.3
DEPTH_MAX = 1e12
OFFSET_MAX = 1e6
EDGE_ON = 1e-5
SCALE_MIN_PX = 1e-6
GENEROUS = 1.002
"""Bounds are wider than exact by this, squared, so that float32 loses no pixel."""
LOG_SCALE_MAX = 20.0
MAX_LABELS = 19


@dataclass(frozen=True)
class Limits:
    """Where a backend stops counting. The defaults are the specification; others are for measuring what they cost.

    Attributes:
        alpha_min: contributions under this do not count, 1/255 at least; transmittance_min: light under this ends a
            pixel.
        exact_reach: whether a surfel is held against each block of 4x4 pixels exactly; if not, every block of the tiles
            in its bounding box is evaluated, with the same result.
        exp_degree: 3, 4 or 5: of the polynomial for the exponential; relative errors 7e-4, 3e-5 and 3e-6.
    """

    alpha_min: float = ALPHA_MIN
    transmittance_min: float = TRANSMITTANCE_MIN
    exact_reach: bool = True
    exp_degree: int = 5

    def __post_init__(self) -> None:
        if not ALPHA_MIN <= self.alpha_min < ALPHA_MAX:
            raise ValueError(f"alpha_min {self.alpha_min}; 1/255 to {ALPHA_MAX} is possible")
        if not 0 < self.transmittance_min < 1 or self.exp_degree not in (3, 4, 5):
            raise ValueError(
                f"transmittance_min {self.transmittance_min} and exp_degree {self.exp_degree}; 0 to 1, and 3, 4 or 5"
            )


PLANES = ("rgb", "alpha", "semantics", "depth", "median_depth", "normal", "distortion", "label_distortion")
