"""Renders a view: linear light, depth, normals and object numbers in one go, and what a LiDAR measures.

Cycles takes depth and object numbers from a pixel's first sample, which goes through its centre: they are exact beside colours that
are antialiased.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from mathutils import Matrix

from sample_scenes.generators.streets.plan import SKY
from sample_scenes.generators.streets.visibility import View

SAMPLES = 10
"""Paths a pixel. With fewer the denoiser takes the asphalt's grain for noise; 16 cost half as much again and look the same."""
FAR_M = 400.0
SKY_DEPTH = 1e5


@dataclass(frozen=True, eq=False)
class Picture:
    """Attributes: light: (H, W, 3) linear; depth: (H, W) metres along the axis, inf for sky; normal: (H, W, 3); index: (H, W)."""

    light: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    index: np.ndarray


class Studio:
    """The scene's renderer: a camera, Cycles on the CPU, and a table of the objects."""

    def __init__(self, scene: bpy.types.Scene, scratch: Path, *, samples: int = SAMPLES) -> None:
        """``scratch``: a folder for what Cycles writes."""
        self.scene, self.path = scene, scratch / "passes.exr"
        self.labels, self.instances = _number(scene)
        data = bpy.data.cameras.new("camera")
        data.sensor_fit, data.sensor_width, data.clip_end = "HORIZONTAL", 36.0, FAR_M
        data.clip_start = 0.05
        self.camera = bpy.data.objects.new("camera", data)
        scene.collection.objects.link(self.camera)
        scene.camera = self.camera
        scene.render.engine = "CYCLES"
        cycles = scene.cycles
        cycles.device, cycles.samples = "CPU", samples
        cycles.use_adaptive_sampling = False
        cycles.denoiser = "OPENIMAGEDENOISE"
        # Albedo is antialiased and not smoothed: what grain it shows, the denoiser keeps.
        cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
        cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 2, 2, 1
        cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.sample_clamp_indirect = 4.0
        scene.render.use_persistent_data = True
        scene.render.resolution_percentage = 100
        layer = scene.view_layers[0]
        layer.use_pass_object_index = layer.use_pass_z = layer.use_pass_normal = True
        settings = scene.render.image_settings
        settings.media_type = "MULTI_LAYER_IMAGE"
        settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
        scene.render.filepath = str(self.path)

    def take(self, view: View, seed: int, *, color: bool = True) -> Picture:
        """Render a view; two pictures with one seed have one noise. Without ``color`` only what is exact counts."""
        scene, cycles = self.scene, self.scene.cycles
        self.camera.data.type = "PERSP"
        self.camera.data.lens = 18.0 / math.tan(math.radians(view.fov) / 2)
        self.camera.matrix_world = Matrix(view.pose.tolist())
        scene.render.resolution_x, scene.render.resolution_y = view.width, view.height
        cycles.seed = seed
        keep = cycles.samples, cycles.max_bounces
        cycles.use_denoising = color
        if not color:
            cycles.samples, cycles.max_bounces = 1, 0
        found = self._render()
        cycles.samples, cycles.max_bounces = keep
        return found

    def sweep(self, pose: np.ndarray, beams: int, low: float, high: float, across: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One turn of a LiDAR that stands upright at a camera's pose, by rows of a panorama.

        Returns:
            (R, 3) directions, (R,) ranges in metres, inf for none, and (R,) labels.
        """
        data, cycles = self.camera.data, self.scene.cycles
        half = math.radians(high - low) / (beams - 1) / 2
        data.type, data.panorama_type = "PANO", "EQUIRECTANGULAR"
        data.latitude_min, data.latitude_max = math.radians(low) - half, math.radians(high) + half
        yaw = math.atan2(-pose[1, 2], -pose[0, 2])
        upright = Matrix.Translation(pose[:3, 3].tolist()) @ Matrix.Rotation(yaw - math.pi / 2, 4, "Z") @ Matrix.Rotation(math.pi / 2, 4, "X")
        self.camera.matrix_world = upright
        self.scene.render.resolution_x, self.scene.render.resolution_y = across, beams
        keep = cycles.samples, cycles.max_bounces
        cycles.use_denoising, cycles.samples, cycles.max_bounces = False, 1, 0
        found = self._render()
        cycles.samples, cycles.max_bounces = keep
        # Columns run from the left over the front to the left again, rows from the top down.
        azimuth = yaw + math.pi - (np.arange(across) + 0.5) / across * 2 * math.pi
        elevation = np.radians(np.linspace(high, low, beams))
        e, a = np.meshgrid(elevation, azimuth, indexing="ij")
        directions = np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)], axis=-1)
        return directions.reshape(-1, 3), found.depth.ravel(), self.labels[found.index].ravel()

    def _render(self) -> Picture:
        bpy.ops.render.render(write_still=True)
        channels = {n: c.pixels for part in OpenEXR.File(str(self.path), separate_channels=True).parts for n, c in part.channels.items()}

        def find(*endings: str) -> np.ndarray:
            return np.stack([next(p for n, p in channels.items() if n.endswith(e)) for e in endings], axis=-1).astype(np.float32)

        light = find("Combined.R", "Combined.G", "Combined.B")
        depth = find(next(n for n in channels if ".Depth." in n or n.endswith("Depth.Z") or n.endswith("Depth.V")))[..., 0]
        index = np.round(find(next(n for n in channels if "Object Index" in n or "IndexOB" in n))[..., 0]).astype(np.int64)
        normal = find("Normal.X", "Normal.Y", "Normal.Z")
        long = np.linalg.norm(normal, axis=-1, keepdims=True)
        return Picture(light, np.where(depth > SKY_DEPTH, np.inf, depth), normal / np.maximum(long, 1e-6), index)


def _number(scene: bpy.types.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Number the objects; returns the class and the instance (0 for none) of each number, 0 being the sky."""
    labels, instances = [SKY], [0]
    for number, obj in enumerate((o for o in scene.objects if o.type == "MESH"), start=1):
        obj.pass_index = number
        labels.append(int(obj["class"]))
        instances.append(int(obj.get("instance", 0)))
    return np.array(labels), np.array(instances)
