"""Textured meshes beside vertex colours at equal triangles, both drawn and compared with the clean frames.

    python benchmarks/reconstruction/textures.py WORKSPACE

Pages are painted from every other frame and judged by the rest, which they have not seen, and once more from all frames. Writes
benchmarks/results/textures.json, and textures.jpg: vertex colours, texture, clean frame.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.base.files import write_image_atomic  # noqa: E402
from unveil_core.base.frame_cache import Frames  # noqa: E402
from unveil_core.base.pictures.decoding import read_image  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.evaluate.metrics import gradient, psnr_of_mse, squared_error, ssim_map  # noqa: E402
from unveil_core.exports.job import Job  # noqa: E402
from unveil_core.exports.textured.levels import MOST_PAGES, texel_m, texture_view  # noqa: E402
from unveil_core.mesh import decimate  # noqa: E402
from unveil_core.mesh.hits import hit_triangles  # noqa: E402
from unveil_core.mesh.picture import render_mesh_picture, render_textured_picture  # noqa: E402
from unveil_core.mesh.texture import paint, unwrap  # noqa: E402
from unveil_core.workspace.files import frame_file  # noqa: E402
from unveil_core.workspace.workspace import Workspace  # noqa: E402

TRIANGLES = (200_000, 50_000, 12_500)
COVERED = 0.995
"""A frame's pixels are judged where the mesh covers all samples of them."""


def judged(draw, frames, clean, covered) -> dict[str, float]:  # type: ignore[no-untyped-def]
    """PSNR, SSIM and gradient energy (over the clean frames') of pictures, over all frames."""
    errors, similar, energy, true = [], [], 0.0, 0.0
    for frame, true_picture, inside in zip(frames, clean, covered, strict=True):
        picture = draw(frame.camera)
        errors.append(squared_error(picture, true_picture)[inside])
        similar.append(ssim_map(picture, true_picture)[inside])
        energy += float(gradient(picture)[inside].sum())
        true += float(gradient(true_picture)[inside].sum())
    mse = float(np.concatenate(errors).mean())
    return {
        "psnr": round(psnr_of_mse(mse), 2),
        "ssim": round(float(np.concatenate(similar).mean()), 3),
        "gradient_energy": round(energy / true, 3),
    }


def main() -> None:
    workspace = Workspace.open(Path(sys.argv[1]))
    job = Job(workspace)
    frames = list(job.drive.frames)
    clean = [read_image(frame_file(workspace.root / "clean", f)) for f in frames]
    rows, strip = [], []
    for triangles in TRIANGLES:
        mesh = decimate(job.mesh, triangles)
        begun = time.perf_counter()
        atlas = unwrap(mesh, job.texture_px, texel_m(frames), MOST_PAGES)
        unwrapped = time.perf_counter() - begun
        covered = []
        for frame in frames:
            fine = hit_triangles(mesh, frame.camera.resized(2 * frame.camera.width, 2 * frame.camera.height)).face >= 0
            size = (frame.camera.width, frame.camera.height)
            covered.append(cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA) > COVERED)
        row = {"triangles": len(mesh.faces), "texel_m": round(atlas.texel, 4), "pages": len(atlas.sides)}
        for name, sources, judges in (("unseen frames", frames[::2], slice(1, None, 2)), ("all frames", frames, slice(None))):
            begun = time.perf_counter()
            views = Frames(len(sources), lambda i, sources=sources: texture_view(job, sources[i]))
            textured = paint(mesh, atlas, [f.camera for f in sources], views)
            seconds = time.perf_counter() - begun
            plain = judged(
                lambda camera, mesh=mesh: render_mesh_picture(mesh, camera, headlight=0),
                frames[judges],
                clean[judges],
                covered[judges],
            )
            fine = judged(
                lambda camera, textured=textured: render_textured_picture(textured, camera),
                frames[judges],
                clean[judges],
                covered[judges],
            )
            row[name] = {"vertex colours": plain, "texture": fine, "paint_s": round(seconds, 1)}
        row["unwrap_s"] = round(unwrapped, 1)
        rows.append(row)
        print(json.dumps(row), flush=True)
        middle = len(frames) // 2
        camera = frames[middle].camera
        pictures = [render_mesh_picture(mesh, camera, headlight=0), render_textured_picture(textured, camera), clean[middle]]
        strip.append(np.concatenate(pictures, axis=1))
    report = {"machine": machine(), "workspace": workspace.root.name, "frames": len(frames), "rows": rows}
    (ROOT / "benchmarks/results/textures.json").write_text(json.dumps(report, indent=1) + "\n")
    write_image_atomic(ROOT / "benchmarks/results/textures.jpg", np.concatenate(strip))


if __name__ == "__main__":
    main()
