"""Rotations and quaternions."""

from __future__ import annotations

import numpy as np

from unveil_core.geometry.transforms import quat_to_rotation, rotation_to_quat


def test_rotations_become_quaternions_one_by_one_or_at_once() -> None:
    quats = np.random.default_rng(0).normal(size=(50, 4))
    quats[:4] = np.eye(4)  # half turns, where the formula with a square root of the trace fails
    rotations = np.stack([quat_to_rotation(q) for q in quats])
    found = rotation_to_quat(rotations)
    np.testing.assert_array_equal(found, [rotation_to_quat(r) for r in rotations])
    assert (found[:, 0] >= 0).all()
    np.testing.assert_allclose([quat_to_rotation(q) for q in found], rotations, atol=1e-12)
    assert rotation_to_quat(rotations.reshape(5, 10, 3, 3)).shape == (5, 10, 4)
