"""Textured meshes as OpenUSD: a mesh and a material for each page, emissive, for photographs carry the light of their street."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_bytes_atomic
from unveil_core.exports.coordinates import z_up
from unveil_core.exports.job import Job
from unveil_core.exports.textured.levels import Level, encoded, page_mesh, textured_levels
from unveil_core.exports.usd import ROOT, new_stage, set_mesh
from unveil_core.exports.whole import tell

__all__ = ["write_textured_usd"]


def write_textured_usd(job: Job, folder: Path) -> None:
    """``empty.usdc``, ``empty_0.png`` ..., the same of each level of detail, and ``export.json``."""
    told = []
    for level in textured_levels(job):
        stage = new_stage(job, folder / f"{level.name}.usdc")
        for number, image in enumerate(level.textured.images):
            write_bytes_atomic(folder / f"{level.name}_{number}.png", encoded(image, ".png"))
            _page(stage, level, number)
        stage.GetRootLayer().Save()
        told.append(level.told(f"{level.name}.usdc"))
    tell(
        folder,
        "textured-usd",
        {"coordinates": z_up(job.drive).to_json(shifted=False), "colorspace": job.colorspace, "levels": told},
    )


def _page(stage: Any, level: Level, number: int) -> None:
    from pxr import Sdf, UsdGeom, UsdShade, Vt

    vertices, coordinates, triangles = page_mesh(level.textured, number)
    if not len(triangles):
        return
    prim = UsdGeom.Mesh.Define(stage, f"{ROOT}/page_{number}")
    set_mesh(prim, level.textured.mesh.vertices[vertices], triangles)
    primvars = UsdGeom.PrimvarsAPI(prim.GetPrim())
    st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(coordinates)))
    at = f"{ROOT}/materials/page_{number}"
    material = UsdShade.Material.Define(stage, at)
    reader = UsdShade.Shader.Define(stage, f"{at}/coordinates")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(stage, f"{at}/texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{level.name}_{number}.png")
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    surface = UsdShade.Shader.Define(stage, f"{at}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0, 0, 0))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    emitted = surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f)
    emitted.ConnectToSource(texture.ConnectableAPI(), "rgb")
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)
