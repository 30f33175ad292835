"""All formats that results are exported to. A new one is a module of this package and an entry of ``FORMATS``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.exports.cameras.chan import write_chan
from unveil_core.exports.cameras.colmap import write_colmap
from unveil_core.exports.cameras.nerfstudio import write_nerfstudio
from unveil_core.exports.dataset.layout import write_kitti, write_nuscenes, write_pandaset
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.las import write_las
from unveil_core.exports.mapping.objects import write_objects
from unveil_core.exports.meshes import write_mesh_glb, write_mesh_obj, write_mesh_ply
from unveil_core.exports.plates.exr import write_exr
from unveil_core.exports.plates.mattes import write_mattes
from unveil_core.exports.plates.movie import write_mp4, write_prores
from unveil_core.exports.plates.png import write_png
from unveil_core.exports.splats.gltf import write_splat_gltf
from unveil_core.exports.splats.ply import write_splat_ply
from unveil_core.exports.splats.spz import write_spz
from unveil_core.exports.textured.glb import write_textured_glb
from unveil_core.exports.textured.obj import write_textured_obj
from unveil_core.exports.textured.usd import write_textured_usd
from unveil_core.exports.usd import write_usd_mesh, write_usd_points, write_usd_splats

__all__ = ["FORMATS", "ExportFormat", "formats_named", "place_of"]

EXTRA = "exports"
"""The extra of the package that installs the optional libraries."""


@dataclass(frozen=True)
class ExportFormat:
    """One format.

    Attributes:
        name: on the command line.
        what: it holds.
        result: the file or folder in the output folder; ``{state}`` stands for empty or full.
        write: makes it at a path: a file, or a folder that is there already. Raises UnveilError and OSError.
        library: by which it is written, as its project is called; "" for own code.
        modules: of those libraries that are not always installed, looked for before anything is written.
        read_back: what the tests read it with.
        lost: of what the workspace knows.
        both_states: whether it can hold the full street, too.
        needs: parts of the job that are read before anything is written, so that what is missing is told first.
    """

    name: str
    what: str
    result: str
    write: Callable[[Job, Path], None]
    read_back: str
    lost: str
    library: str = ""
    modules: tuple[str, ...] = ()
    both_states: bool = True
    needs: tuple[str, ...] = ()

    @property
    def suffix(self) -> str:
        """Of the file, with its dot; "" for a folder."""
        return Path(self.result).suffix


FORMATS: dict[str, ExportFormat] = {
    f.name: f
    for f in (
        ExportFormat(
            "splat-ply",
            "the scene as 3D Gaussian Splatting PLY, with label and instance",
            "{state}_splats.ply",
            write_splat_ply,
            "readers by the rules of Unity's importer, SuperSplat and 3DGS; gsply; Unveil, which renders the same",
            "the sky; coordinates are single precision, less a shift far from the origin",
            needs=("scene",),
        ),
        ExportFormat(
            "spz",
            "the scene as SPZ 3, or 2 or 4 with --spz",
            "{state}_splats.spz",
            write_spz,
            "gsply; readers by the format's description",
            "the sky, labels, objects; quantized (see below)",
            needs=("scene",),
        ),
        ExportFormat(
            "splat-gltf",
            "the scene as GLB with KHR_gaussian_splatting",
            "{state}_splats.glb",
            write_splat_gltf,
            "pygltflib",
            "the sky",
            needs=("scene",),
        ),
        ExportFormat(
            "usd-splats",
            "the scene as OpenUSD ParticleField3DGaussianSplat",
            "{state}_splats.usdc",
            write_usd_splats,
            "usd-core",
            "the sky",
            "usd-core",
            modules=("pxr",),
            needs=("scene",),
        ),
        ExportFormat(
            "usd-points",
            "the scene as OpenUSD points with widths, normals and displayColor",
            "{state}_points.usdc",
            write_usd_points,
            "usd-core",
            "the sky, colours by direction, the shape of splats",
            "usd-core",
            modules=("pxr",),
            needs=("scene",),
        ),
        ExportFormat(
            "ply",
            "the mesh as PLY",
            "{state}_mesh.ply",
            write_mesh_ply,
            "trimesh",
            "nothing: doubles where needed",
            needs=("mesh",),
        ),
        ExportFormat(
            "obj",
            "the mesh as OBJ with colours of vertices",
            "{state}_mesh.obj",
            write_mesh_obj,
            "trimesh",
            "positions beyond six decimals",
            "trimesh",
            needs=("mesh",),
        ),
        ExportFormat(
            "glb",
            "the mesh as GLB",
            "{state}_mesh.glb",
            write_mesh_glb,
            "trimesh",
            "nothing: a node holds the origin",
            needs=("mesh",),
        ),
        ExportFormat(
            "usd",
            "the mesh as OpenUSD with displayColor",
            "{state}_mesh.usdc",
            write_usd_mesh,
            "usd-core",
            "nothing: a transform holds the origin",
            "usd-core",
            modules=("pxr",),
            needs=("mesh",),
        ),
        ExportFormat(
            "textured-glb",
            "the mesh as GLB with textures from the clean frames, and levels of detail",
            "textured_glb",
            write_textured_glb,
            "trimesh, pygltflib",
            "triangles beyond the budget; what is seen from one side only",
            "xatlas",
            modules=("xatlas",),
            both_states=False,
            needs=("mesh",),
        ),
        ExportFormat(
            "textured-obj",
            "the same as OBJ with PNG",
            "textured_obj",
            write_textured_obj,
            "trimesh",
            "likewise; positions beyond six decimals",
            "xatlas",
            modules=("xatlas",),
            both_states=False,
            needs=("mesh",),
        ),
        ExportFormat(
            "textured-usd",
            "the same as OpenUSD with PNG",
            "textured_usd",
            write_textured_usd,
            "usd-core",
            "likewise",
            "usd-core and xatlas",
            modules=("pxr", "xatlas"),
            both_states=False,
            needs=("mesh",),
        ),
        ExportFormat(
            "nerfstudio",
            "cameras with lens and time, clean frames and points: transforms.json",
            "nerfstudio",
            write_nerfstudio,
            "Unveil's own import: the same cameras and pixels; a reader by nerfstudio's rules, its own parser where installed",
            "masks, labels, objects; lenses that nerfstudio does not know, see below",
            both_states=False,
        ),
        ExportFormat(
            "colmap",
            "cameras with lens, clean frames and points: a COLMAP text model",
            "colmap",
            write_colmap,
            "pycolmap; a reader by the rules of 3D Gaussian Splatting",
            "time stamps, tracks of points; OPENCV lenses with k3 become FULL_OPENCV",
            both_states=False,
        ),
        ExportFormat(
            "chan",
            "a camera track for Nuke: position, rotation ZXY, vertical field of view",
            "chan",
            write_chan,
            "SciPy's rotations",
            "principal point, lens, time stamps: in export.json; ST maps are in the workspace",
            both_states=False,
        ),
        ExportFormat(
            "las",
            "the points of the street as LAS 1.4, with classes",
            "{state}_points.las",
            write_las,
            "laspy; a reader by the standard's tables, with PDAL's rules",
            "coordinates finer than a millimetre; the coordinate system, unless --epsg tells it",
            "laspy",
            modules=("laspy",),
            needs=("coordinate_system",),
        ),
        ExportFormat(
            "laz",
            "the same, compressed",
            "{state}_points.laz",
            write_las,
            "laspy",
            "likewise",
            "laspy with lazrs",
            modules=("lazrs",),
            needs=("coordinate_system",),
        ),
        ExportFormat(
            "objects-json",
            "the removed objects: a list with boxes and frames, and the splats of each",
            "objects",
            write_objects,
            "the same readers",
            "pixels of the objects",
            both_states=False,
        ),
        ExportFormat(
            "png",
            "clean plates, 8 or 16 bits as delivered",
            "png",
            write_png,
            "OpenCV: bit for bit",
            "nothing",
            both_states=False,
        ),
        ExportFormat(
            "exr",
            "clean plates in linear light, with mattes, provenance, certainty, depth and normal",
            "exr",
            write_exr,
            "OpenEXR",
            "of 16-bit footage the lowest bits",
            "OpenEXR",
            both_states=False,
        ),
        ExportFormat(
            "mattes",
            "a matte of each removed object with its border and shadow, provenance and certainty, as PNG sequences",
            "mattes",
            write_mattes,
            "OpenCV: the clean frames come back bit for bit",
            "where a border or a shadow belongs: the nearest object has it",
            both_states=False,
        ),
        ExportFormat(
            "mp4",
            "clean frames as H.264, to look at",
            "mp4",
            write_mp4,
            "PyAV, OpenCV",
            "exact pixels, half of the colour's resolution, alpha",
            "PyAV",
            modules=("av",),
            both_states=False,
        ),
        ExportFormat(
            "pandaset",
            "PandaSet with clean photographs, a copy of its tree by links",
            "pandaset",
            write_pandaset,
            "Unveil's own import",
            "sweeps, boxes and labels stay as they were; JPEG is compressed again where something was removed",
            both_states=False,
        ),
        ExportFormat(
            "kitti",
            "KITTI raw, its odometry or KITTI-360, likewise",
            "kitti",
            write_kitti,
            "Unveil's own import: the delivered pixels",
            "sweeps, boxes and labels stay as they were",
            both_states=False,
        ),
        ExportFormat(
            "nuscenes",
            "nuScenes, likewise, with its tables",
            "nuscenes",
            write_nuscenes,
            "Unveil's own import",
            "as of pandaset",
            both_states=False,
        ),
        ExportFormat(
            "prores",
            "clean frames as ProRes 422 HQ, to edit",
            "prores",
            write_prores,
            "PyAV, OpenCV",
            "exact pixels, half of the colour's width, alpha",
            "PyAV",
            modules=("av",),
            both_states=False,
        ),
    )
}
"""By name, splats first."""


def formats_named(names: Sequence[str]) -> list[ExportFormat]:
    """The formats of these names.

    Raises:
        SettingsError: an unknown name, none, or a library that is not installed.
    """
    unknown = [name for name in names if name not in FORMATS]
    if unknown or not names:
        problem = f"Not a format: {unknown[0]}" if unknown else "no format is named"
        raise SettingsError(problem, mend=f"give one or more with --to: {', '.join(FORMATS)}")
    formats = [FORMATS[name] for name in dict.fromkeys(names)]
    for one in formats:
        if any(find_spec(module) is None for module in one.modules):
            mend = f"pip install '.[{EXTRA}]' in the folder of Unveil"
            raise SettingsError(f"Not installed: {one.library}, which {one.name} needs", mend=mend)
    return formats


def place_of(one: ExportFormat, job: Job, folder: Path) -> Path:
    """Where the result of a format goes in a folder."""
    return folder / one.result.format(state=job.state)
