"""The splat GLB as pygltflib reads it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tests.exports.conftest import Street
from tests.exports.street import WORLD
from unveil_core.exports.splats.placed import placed
from unveil_core.geometry.similarity import Similarity
from unveil_core.mesh.export import Z_TO_Y


def test_attributes_and_extension_are_those_of_khr_gaussian_splatting(street: Street) -> None:
    pygltflib = pytest.importorskip("pygltflib")
    path, job = street.exported("splat-gltf"), street.job
    document = pygltflib.GLTF2().load(str(path))
    assert document.extensionsUsed == ["KHR_gaussian_splatting"]
    (primitive,) = document.meshes[0].primitives
    assert primitive.mode == 0
    assert primitive.extensions == {
        "KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    }
    names = vars(primitive.attributes)
    blob = document.binary_blob()

    def values(name: str) -> np.ndarray:
        accessor = document.accessors[names[name]]
        view = document.bufferViews[accessor.bufferView]
        assert view.byteOffset % 4 == 0
        kind = {5126: "<f4", 5123: "<u2"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        return np.frombuffer(blob, kind, accessor.count * width, view.byteOffset).reshape(accessor.count, width)

    scene, there = job.scene, placed(job.scene, Similarity(1.0, Z_TO_Y))
    node = document.nodes[0]
    positions = values("POSITION").astype(np.float64) * node.scale + np.array(node.translation)
    turn = WORLD.rotation @ Z_TO_Y.T
    np.testing.assert_allclose(positions @ turn.T, WORLD.to_world(scene.means.double().numpy()), atol=1e-5)
    bounds = document.accessors[names["POSITION"]]
    np.testing.assert_array_equal([bounds.min, bounds.max], [values("POSITION").min(0), values("POSITION").max(0)])
    quats = np.roll(values("KHR_gaussian_splatting:ROTATION"), 1, axis=1)
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(np.abs((quats * there.quats.numpy()).sum(axis=1)), 1, atol=1e-6)
    scales = values("KHR_gaussian_splatting:SCALE")
    np.testing.assert_allclose(scales[:, :2], scene.log_scales.exp(), rtol=1e-5)
    np.testing.assert_allclose(scales[:, 2], 1e-4, rtol=1e-5)
    opacity = values("KHR_gaussian_splatting:OPACITY")[:, 0]
    np.testing.assert_allclose(opacity, torch.sigmoid(scene.opacity_logits), atol=1e-6)
    for k, name in enumerate(["0_COEF_0", *(f"1_COEF_{i}" for i in range(3)), *(f"2_COEF_{i}" for i in range(5))]):
        np.testing.assert_allclose(values(f"KHR_gaussian_splatting:SH_DEGREE_{name}"), there.sh[:, k], atol=1e-6)
    color = values("COLOR_0") / 65535
    srgb = np.clip(0.5 + 0.28209479 * scene.sh[:, 0].numpy(), 0, 1)
    back = np.where(color[:, :3] <= 0.0031308, color[:, :3] * 12.92, 1.055 * color[:, :3] ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(back, srgb, atol=2e-3)
    assert set(np.unique(values("_LABEL"))) == {0, 13} and set(np.unique(values("_INSTANCE"))) == {0, 3}
