"""What every backend computes: constants, planes, and the mathematics in one place.

Surfels (*2D Gaussian Splatting*, SIGGRAPH 2024, sections 4.1 and 4.2). A disc has a centre p, unit tangents t_u, t_v and standard
deviations s_u, s_v. In the camera's frame let ``h_u = s_u t_u``, ``h_v = s_v t_v`` and ``p = (X, Y, Z)``; c is the projection of p.

**Ray-splat intersection, re-centred at c.** With x = X / Z, y = Y / Z let

    J = [[fx (h_u.x - x h_u.z), fx (h_v.x - x h_v.z)],      A = [[a0, b0], [a1, b1]] = (J / Z)^-1
         [fy (h_u.y - y h_u.z), fy (h_v.y - y h_v.z)]],     (a2, b2) = -(h_u.z (a0, b0) + h_v.z (a1, b1)) / Z

and for a pixel at c + (dx, dy)

    q = 1 + a2 dx + b2 dy,   u = (a0 dx + b0 dy) / q,   v = (a1 dx + b1 dy) / q,   depth = Z / q.

This is equations 8 to 10 of the paper after dividing out Z; it stays well conditioned in float32 far from the origin and at
grazing angles.

**Weight.** G = exp(-min(u^2 + v^2, 2 |d|^2) / 2): the second term is the paper's screen-space low-pass filter (equation 11), centred
on the projected mean; where it wins, the depth is that of the centre. alpha = min(0.99, opacity G); contributions under 1/255 or
nearer than ``near`` do not count; a pixel is finished before the surfel that would bring its transmittance T under 1e-4.
A surfel whose centre is nearer than ``near`` is left out whole. Surfels are composited in the order of Z, ties by index.

**Planes.** With w_i = alpha_i T_i: rgb, alpha, semantics (per label), depth and normal are sums of w_i times the value; the median
depth is the depth of the last surfel met while T > 1/2. The normal is in the camera's frame and faces the camera.

**Distortion** (equation 13), with the mapped depth m = (far - far near / depth) / (far - near):

    L_d = sum_{i<j} w_i w_j (m_i - m_j)^2 = sum_i w_i (m_i^2 A_i + Q_i - 2 m_i M_i),  A, M, Q prefix sums of w, w m, w m^2.

The sum does not change when a constant is taken from all m. Taking the first hit's m keeps float32 gradients exact to 1e-5, where
the textbook form is wrong by up to 4 %. The label distortion is the same sum per label, each label with its own transmittance as if
the others were not there (*3D StreetUnveiler*, section 3.1), in the one pass.
"""

from __future__ import annotations

ALPHA_MIN = 1.0 / 255.0
ALPHA_MAX = 0.99
TRANSMITTANCE_MIN = 1e-4
LOW_PASS = 2.0
MAX_LABELS = 19

PLANES = (
    "rgb", "alpha", "semantics", "depth", "median_depth", "normal", "distortion", "label_distortion",
)  # fmt: skip
