"""OpenUSD: the mesh, and the splats as a particle field or as points, by Pixar's ``usd-core``.

The stage is z up, in the drive's units (``metersPerUnit``). What it holds is in metres around the local origin, under a transform
of doubles that leads to the drive's coordinates, so nothing is lost far from the origin. ``displayColor`` is linear Rec. 709, as
USD's colours are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.base.types import Float32, Float64
from unveil_core.exports.coordinates import z_up
from unveil_core.exports.job import Job
from unveil_core.exports.splats.placed import opacities
from unveil_core.geometry.similarity import Similarity
from unveil_core.raster.spherical_harmonics import SH0
from unveil_core.surfels.surfels import three_log_scales

__all__ = ["ROOT", "new_stage", "set_mesh", "write_usd_mesh", "write_usd_points", "write_usd_splats"]

ROOT = "/street"


def write_usd_mesh(job: Job, path: Path) -> None:
    """The mesh of the state, with colours of its vertices."""
    from pxr import Sdf, UsdGeom, Vt

    mesh = job.mesh
    stage = new_stage(job, path)
    prim = UsdGeom.Mesh.Define(stage, f"{ROOT}/mesh")
    set_mesh(prim, mesh.vertices, mesh.faces)
    color = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    color.Set(Vt.Vec3fArray.FromNumpy(_linear(mesh.colors / 255.0)))
    prim.GetPrim().CreateAttribute("unveil:state", Sdf.ValueTypeNames.String).Set(job.state)
    _save(stage)


def write_usd_points(job: Job, path: Path) -> None:
    """The splats as ``UsdGeomPoints``: widths and ``displayColor``, which everything that reads USD shows."""
    from pxr import UsdGeom, Vt

    scene = job.scene
    stage = new_stage(job, path)
    prim = UsdGeom.Points.Define(stage, f"{ROOT}/points")
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(scene.means.numpy()))
    # A disc of the same area as the ellipse at one standard deviation.
    widths = (2 * scene.log_scales[:, :2].mean(dim=1).exp()).numpy()
    prim.CreateWidthsAttr(Vt.FloatArray.FromNumpy(widths))
    prim.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(scene.normals().contiguous().numpy()))
    prim.CreateExtentAttr(_extent(scene.means.numpy()))
    color = np.clip(0.5 + SH0 * scene.sh[:, 0].double().numpy(), 0, 1)
    prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(Vt.Vec3fArray.FromNumpy(_linear(color)))
    prim.CreateDisplayOpacityPrimvar(UsdGeom.Tokens.vertex).Set(Vt.FloatArray.FromNumpy(opacities(scene).numpy()))
    _labels(job, prim.GetPrim())
    _save(stage)


def write_usd_splats(job: Job, path: Path) -> None:
    """The splats as ``ParticleField3DGaussianSplat`` (OpenUSD 26.03): all that the scene has, coefficients particle by particle.

    Raises:
        SettingsError: an OpenUSD that does not know it yet.
    """
    from pxr import UsdVol, Vt

    if not hasattr(UsdVol, "ParticleField3DGaussianSplat"):
        raise SettingsError(
            "Too old: this OpenUSD has no splats", mend="pip install 'usd-core>=26.3', or use usd-points"
        )
    scene = job.scene
    stage = new_stage(job, path)
    prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, f"{ROOT}/splats")
    quats = scene.quats / scene.quats.norm(dim=1, keepdim=True).clamp_min(1e-12)
    field: dict[str, Any] = {
        "positions": Vt.Vec3fArray.FromNumpy(scene.means.numpy()),
        "scales": Vt.Vec3fArray.FromNumpy(three_log_scales(scene).exp().numpy()),
        # A Gf.Quatf lies in memory with its real part last.
        "orientations": Vt.QuatfArray.FromNumpy(np.ascontiguousarray(np.roll(quats.numpy(), -1, axis=1))),
        "opacities": Vt.FloatArray.FromNumpy(opacities(scene).numpy()),
        "radiance:sphericalHarmonicsCoefficients": Vt.Vec3fArray.FromNumpy(
            scene.sh.reshape(-1, 3).contiguous().numpy()
        ),
        "radiance:sphericalHarmonicsDegree": scene.sh_degree,
    }
    for name, values in field.items():
        prim.GetPrim().GetAttribute(name).Set(values)
    prim.GetPrim().GetAttribute("extent").Set(_extent(scene.means.numpy()))
    color = np.clip(0.5 + SH0 * scene.sh[:, 0].double().numpy(), 0, 1)
    prim.GetPrim().GetAttribute("primvars:displayColor").Set(Vt.Vec3fArray.FromNumpy(_linear(color)))
    _labels(job, prim.GetPrim())
    _save(stage)


def set_mesh(prim: Any, vertices: Float32, faces: NDArray[np.int32]) -> None:
    """Give a ``UsdGeomMesh`` its triangles.

    Args:
        vertices: (V, 3), metres around the local origin; faces: (F, 3).
    """
    from pxr import UsdGeom, Vt

    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.ravel())))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateDoubleSidedAttr(True)
    prim.CreateExtentAttr(_extent(vertices))


def new_stage(job: Job, path: Path) -> Any:
    """A stage at a path, with the transform :data:`ROOT` from the local origin to the drive's place, z up."""
    from pxr import Gf, Usd, UsdGeom

    place: Similarity = z_up(job.drive).from_local
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1 / place.scale)
    root = UsdGeom.Xform.Define(stage, ROOT)
    root.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*place.translation.tolist()))
    if place.scale != 1:
        root.AddScaleOp().Set(Gf.Vec3f(*[place.scale] * 3))
    stage.SetDefaultPrim(root.GetPrim())
    return stage


def _labels(job: Job, prim: Any) -> None:
    """Labels (trainIds) and objects as primvars of the particles."""
    from pxr import Sdf, UsdGeom, Vt

    for name, numbers in (("label", job.train_ids(job.scene)), ("instance", job.scene_instances())):
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.vertex)
        primvar.Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(numbers, dtype=np.int32)))


def _extent(points: Float32) -> list[Any]:
    from pxr import Gf

    if not len(points):
        return []
    return [Gf.Vec3f(*points.min(axis=0).tolist()), Gf.Vec3f(*points.max(axis=0).tolist())]


def _linear(color: Float64) -> Float32:
    return linear_of_srgb(color).astype(np.float32)


def _save(stage: Any) -> None:
    stage.GetRootLayer().Save()
