"""Photograph, scan and label the street; derive the truth masks; write everything in the layout of a drive."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path

import bpy
import cv2
import numpy as np
import OpenEXR
from build_street import PERSON, SKY, heading, place, removable
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree
from visibility import FOV, HEIGHT, WIDTH, Crowd, intrinsics, looked_up, never_seen, rays

FINEST_CELL = 0.15
STEP, CAMERA_HEIGHT, PITCH = 1.15, 1.6, math.radians(4.0)
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]


def configure(scene, *, samples: int) -> None:  # type: ignore[no-untyped-def]
    """Cycles on the CPU, denoised, sRGB without a film look."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = True
    scene.cycles.denoiser = "OPENIMAGEDENOISE"
    scene.cycles.denoising_prefilter = "ACCURATE"
    scene.cycles.max_bounces = 3
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.seed = 1
    scene.render.use_persistent_data = True
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = 0.1


def drive(scene, *, frames: int) -> list[np.ndarray]:  # type: ignore[no-untyped-def]
    """A camera and its poses: OpenGL camera-to-world, (4, 4) each."""
    data = bpy.data.cameras.new("front")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = 18.0 / math.tan(FOV / 2)
    data.clip_end = 400
    camera = bpy.data.objects.new("front", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    poses = []
    for i in range(frames):
        s = i * STEP
        sway = 0.1 * math.sin(i * 0.5)
        position = np.array(place(s, -0.35 + sway, CAMERA_HEIGHT + 0.015 * math.sin(i * 1.3)))
        yaw = heading(s + 3.0) + 0.012 * math.sin(i * 0.7)
        forward = np.array([math.cos(yaw) * math.cos(PITCH), math.sin(yaw) * math.cos(PITCH), -math.sin(PITCH)])
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(right, forward), -forward, position
        poses.append(pose)
    return poses


def set_pose(scene, pose: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    """Move the camera."""
    scene.camera.matrix_world = Matrix(pose.tolist())


def render_color(scene, poses, frame: int, path: Path) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Render one frame to PNG and return it, (H, W, 3) uint8 BGR."""
    set_pose(scene, poses[frame])
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return cv2.imread(str(path))


def render_passes(scene, poses, frame: int, folder: Path) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """Exact object index (H, W) int and depth (H, W) float32, inf for the sky."""
    set_pose(scene, poses[frame])
    keep = scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 1, False, 0
    layer = scene.view_layers[0]
    layer.use_pass_object_index = layer.use_pass_z = True
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    path = folder / "passes.exr"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = keep
    index = depth = None
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in part.channels.items():
            if "Object Index" in name or "IndexOB" in name:
                index = np.round(channel.pixels).astype(np.int64)
            elif "Depth" in name:
                depth = channel.pixels.astype(np.float32)
    assert index is not None and depth is not None
    return index, np.where(depth > 1e5, np.inf, depth).astype(np.float32)


def number_objects(scene) -> dict[int, tuple[int, int]]:  # type: ignore[no-untyped-def]
    """Give every mesh a pass index; returns index to (class, instance)."""
    table = {0: (SKY, 0)}
    for i, obj in enumerate((o for o in scene.objects if o.type == "MESH"), start=1):
        obj.pass_index = i
        table[i] = (int(obj["class"]), int(obj.get("instance", 0)))
    return table


def instance_table(scene) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Number the objects; returns the instance (0 for none) of each object index."""
    table = number_objects(scene)
    return np.array([table[i][1] for i in range(len(table))])


def surfaces(scene) -> BVHTree:  # type: ignore[no-untyped-def]
    """All surfaces that are rendered just now, to cast rays at."""
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    vertices, polygons = [], []
    for obj in scene.objects:
        if obj.type != "MESH" or obj.hide_render:
            continue
        mesh = obj.evaluated_get(depsgraph).to_mesh()
        base = len(vertices)
        matrix = obj.matrix_world
        vertices += [matrix @ v.co for v in mesh.vertices]
        polygons += [tuple(base + i for i in p.vertices) for p in mesh.polygons]
    return BVHTree.FromPolygons(vertices, polygons)


def scan(scene, poses) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """A spinning 64-beam LiDAR on the roof, one turn a frame: points (P, 3) and the frame each was taken at."""
    tree = surfaces(scene)
    rng = np.random.default_rng(3)
    elevation = np.radians(np.concatenate([np.linspace(-24, -4, 34), np.linspace(-3.5, 15, 30)]))
    azimuth = np.radians(np.arange(0, 360, 0.45))
    points, frames = [], []
    for frame, pose in enumerate(poses):
        origin = pose[:3, 3] + np.array([0, 0, 0.35])
        yaw = math.atan2(-pose[1, 2], -pose[0, 2])
        a = azimuth + yaw + rng.uniform(0, np.radians(0.45))
        for e in elevation:
            directions = np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.full_like(a, np.sin(e))], axis=1)
            for direction in directions:
                hit, _, _, distance = tree.ray_cast(Vector(origin), Vector(direction), 60.0)
                if hit is not None and distance > 1.0:
                    points.append(origin + direction * (distance + rng.normal(0, 0.012)))
                    frames.append(frame)
    return np.array(points), np.array(frames)


def normals(pose: np.ndarray, region: np.ndarray, tree: BVHTree) -> np.ndarray:
    """(H, W, 3) of the surfaces that a view shows in a region (H, W), 0 elsewhere."""
    found = np.zeros((*region.shape, 3))
    rows, columns = np.nonzero(region)
    for row, column, direction in zip(rows, columns, rays(pose)[rows, columns], strict=True):
        normal = tree.ray_cast(Vector(pose[:3, 3]), Vector(direction))[1]
        if normal is not None:
            found[row, column] = normal
    return found


def write_drive(scene, poses, folder: Path, offset: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    """Render both states and write the drive with its truth."""
    for name in ("images", "semantics", "instances", "truth/images", "truth/depth", "truth/removed", "truth/unseen", "truth/shadow"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    table = number_objects(scene)
    classes = np.array([table[i][0] for i in range(len(table))])
    instances = np.array([table[i][1] for i in range(len(table))])
    objects = removable(scene)
    count = len(poses)
    full, full_depth, index, empty, empty_depth = [], [], [], [], []
    points, _ = scan(scene, poses)
    with tempfile.TemporaryDirectory() as scratch:
        for hidden in (False, True):
            for obj in objects:
                obj.hide_render = hidden
            for frame in range(count):
                picture = render_color(scene, poses, frame, Path(scratch) / "color.png")
                ids, depth = render_passes(scene, poses, frame, Path(scratch))
                (empty if hidden else full).append(picture)
                (empty_depth if hidden else full_depth).append(depth)
                if not hidden:
                    index.append(ids)
                print(f"{'empty' if hidden else 'crowded'} {frame + 1}/{count}", flush=True)
    bare = surfaces(scene)
    crowd = Crowd(poses, full_depth, [instances[i] > 0 for i in index])
    rows_of_frames = []
    for i in range(count):
        stem = f"{i:04d}"
        cv2.imwrite(str(folder / f"images/{stem}.jpg"), full[i], JPEG)
        cv2.imwrite(str(folder / f"truth/images/{stem}.jpg"), empty[i], JPEG)
        cv2.imwrite(str(folder / f"semantics/{stem}.png"), classes[index[i]].astype(np.uint8))
        cv2.imwrite(str(folder / f"instances/{stem}.png"), instances[index[i]].astype(np.uint16))
        # Every second pixel, as KITTI keeps depth: 256 steps a metre, 0 for none. Small, and fine enough.
        depth = empty_depth[i][1::2, 1::2]
        steps = np.where(np.isfinite(depth) & (depth < 255), np.round(depth * 256), 0).astype(np.uint16)
        cv2.imwrite(str(folder / f"truth/depth/{stem}.png"), steps, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        removed = crowd.removed[i]
        cv2.imwrite(str(folder / f"truth/removed/{stem}.png"), removed.astype(np.uint8) * 255)
        luma = [cv2.GaussianBlur(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), 0.8) for p in (full[i], empty[i])]
        border = cv2.dilate(removed.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        shadow = (luma[1] - luma[0] > 10) & ~border
        shadow = cv2.morphologyEx(shadow.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        cv2.imwrite(str(folder / f"truth/shadow/{stem}.png"), shadow * 255)
        unseen = never_seen(poses[i], removed, empty_depth[i], normals(poses[i], removed, bare), crowd)
        cv2.imwrite(str(folder / f"truth/unseen/{stem}.png"), unseen.astype(np.uint8) * 255)
        matrix = poses[i].copy()
        matrix[:3, 3] += offset
        rows_of_frames.append({
            "file_path": f"images/{stem}.jpg", "semantic_path": f"semantics/{stem}.png",
            "instance_path": f"instances/{stem}.png", "timestamp": round(i * 0.1, 3), "camera": "front",
            "transform_matrix": matrix.tolist(),
        })  # fmt: skip
    write_points(points, poses, full, full_depth, folder / "points.ply", offset)
    names = [{"id": int(o["instance"]), "class": "person" if o["class"] == PERSON else "car", "name": o.name} for o in objects]
    document = {
        "camera_model": "PINHOLE", **intrinsics(),
        "metric": True, "ply_file_path": "points.ply", "semantic_classes": "cityscapes", "instances": names,
        "frames": rows_of_frames,
    }  # fmt: skip
    (folder / "transforms.json").write_text(json.dumps(document, indent=1))


def read_crowd(scene, poses, folder: Path) -> Crowd:  # type: ignore[no-untyped-def]
    """Render what the frames of the drive show of the scene as it is."""
    instances = instance_table(scene)
    passes = [render_passes(scene, poses, frame, folder) for frame in range(len(poses))]
    return Crowd(poses, [depth for _, depth in passes], [instances[index] > 0 for index, _ in passes])


def write_unseen(scene, poses, folder: Path) -> int:  # type: ignore[no-untyped-def]
    """Write truth/unseen/ of the recorded frames anew, without rendering pictures; returns how many pixels it has."""
    objects = removable(scene)
    pixels = 0
    with tempfile.TemporaryDirectory() as scratch:
        crowd = read_crowd(scene, poses, Path(scratch))
        for obj in objects:
            obj.hide_render = True
        bare = surfaces(scene)
        for frame, pose in enumerate(poses):
            _, depth = render_passes(scene, poses, frame, Path(scratch))
            unseen = never_seen(pose, crowd.removed[frame], depth, normals(pose, crowd.removed[frame], bare), crowd)
            cv2.imwrite(str(folder / f"truth/unseen/{frame:04d}.png"), unseen.astype(np.uint8) * 255)
            pixels += int(unseen.sum())
    for obj in objects:
        obj.hide_render = False
    return pixels


def write_points(points, poses, pictures, depths, path: Path, offset: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    """Thin the scan to ``FINEST_CELL`` near the path and coarser beyond, colour it from the frames, write doubles."""
    centres = np.array([p[:3, 3] for p in poses])
    distance = np.min(np.linalg.norm(points[:, None, :2] - centres[None, ::3, :2], axis=2), axis=1)
    cell = FINEST_CELL * np.where(distance < 9, 1.0, np.where(distance < 20, 1.6, 2.7))
    key = np.concatenate([np.floor(points / cell[:, None]), cell[:, None] * 1000], axis=1).astype(np.int64)
    points = points[np.sort(np.unique(key, axis=0, return_index=True)[1])]
    color = np.full((len(points), 3), 128.0)
    best = np.full(len(points), np.inf)
    for pose, picture, depth in zip(poses, pictures, depths, strict=True):
        seen, row, column = looked_up(pose, points, depth, 0.1)
        away = np.linalg.norm(points - pose[:3, 3], axis=1)
        take = seen & (away < best)
        color[take] = picture[row[take], column[take], ::-1]
        best[take] = away[take]
    table = np.empty(len(points), dtype=[("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
    for k, name in enumerate("xyz"):
        table[name] = points[:, k] + offset[k]
    for k, name in enumerate(("red", "green", "blue")):
        table[name] = color[:, k].round()
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {n}\n" for n in "xyz") + "".join(f"property uchar {n}\n" for n in ("red", "green", "blue"))
    path.write_bytes((header + "end_header\n").encode() + table.tobytes())
