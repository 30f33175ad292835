"""USD files as usd-core composes them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.exports.conftest import Street
from tests.exports.street import WORLD
from unveil_core.exports.coordinates import z_up

pytest.importorskip("pxr")
HELD: list[Any] = []
"""Stages: one lives as long as it is held."""


def opened(street: Street, name: str) -> tuple[Any, np.ndarray, np.ndarray]:
    """The stage's one thing, the (4, 4) row-vector transform to the stage, and the rotation (3, 3) from it to the drive."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(street.exported(name)))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == pytest.approx(1 / WORLD.scale)
    (prim,) = stage.GetDefaultPrim().GetChildren()
    matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default()))
    HELD.append(stage)
    return prim, matrix, z_up(street.job.drive).to_drive


def in_drive(points: Any, matrix: np.ndarray, turn: np.ndarray) -> np.ndarray:
    return (np.array(points, dtype=np.float64) @ matrix[:3, :3] + matrix[3, :3]) @ turn.T


def test_the_mesh_lies_where_it_did_with_its_colours(street: Street) -> None:
    from pxr import UsdGeom

    prim, matrix, turn = opened(street, "usd")
    mesh, ours = UsdGeom.Mesh(prim), street.job.mesh
    np.testing.assert_allclose(
        in_drive(mesh.GetPointsAttr().Get(), matrix, turn), WORLD.to_world(ours.vertices), atol=1e-5
    )
    np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), ours.faces)
    color = np.array(mesh.GetDisplayColorPrimvar().Get(), dtype=np.float64)
    back = np.where(color <= 0.0031308, color * 12.92, 1.055 * color ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.round(back * 255), ours.colors)


def test_points_have_widths_colours_and_labels(street: Street) -> None:
    from pxr import UsdGeom

    prim, matrix, turn = opened(street, "usd-points")
    points, scene = UsdGeom.Points(prim), street.job.scene
    expected = WORLD.to_world(scene.means.double().numpy())
    np.testing.assert_allclose(in_drive(points.GetPointsAttr().Get(), matrix, turn), expected, atol=1e-5)
    widths = np.array(points.GetWidthsAttr().Get())
    np.testing.assert_allclose((widths / 2) ** 2, scene.log_scales.sum(dim=1).exp(), rtol=1e-4)
    assert len(points.GetDisplayColorPrimvar().Get()) == len(scene)
    api = UsdGeom.PrimvarsAPI(prim)
    assert set(api.GetPrimvar("label").Get()) == {0, 13} and set(api.GetPrimvar("instance").Get()) == {0, 3}


def test_the_particle_field_has_all_of_the_splats(street: Street) -> None:
    from pxr import UsdVol

    if not hasattr(UsdVol, "ParticleField3DGaussianSplat"):
        pytest.skip("this OpenUSD is older than 26.03")
    prim, matrix, turn = opened(street, "usd-splats")
    scene = street.job.scene
    assert prim.GetTypeName() == "ParticleField3DGaussianSplat"

    def value(name: str) -> Any:
        return prim.GetAttribute(name).Get()

    expected = WORLD.to_world(scene.means.double().numpy())
    np.testing.assert_allclose(in_drive(value("positions"), matrix, turn), expected, atol=1e-5)
    quats = np.array([[q.GetReal(), *q.GetImaginary()] for q in value("orientations")])
    ours = scene.quats.numpy() / np.linalg.norm(scene.quats.numpy(), axis=1, keepdims=True)
    np.testing.assert_allclose(quats, ours, atol=1e-6)
    np.testing.assert_allclose(np.array(value("scales"))[:, :2], scene.log_scales.exp(), rtol=1e-5)
    assert value("radiance:sphericalHarmonicsDegree") == 2
    sh = np.array(value("radiance:sphericalHarmonicsCoefficients")).reshape(-1, 9, 3)
    np.testing.assert_array_equal(sh, scene.sh)
    np.testing.assert_allclose(value("opacities"), 1 / (1 + np.exp(-scene.opacity_logits.numpy())), atol=1e-6)
