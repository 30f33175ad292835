"""The program that runs pycolmap: started by ``process.py``, and by nobody else.

pycolmap brings libraries of its own, compression among them, that do not agree with OpenCV's and torch's in one process. So this
module loads nothing of the project. It reads one request, a line of JSON, from standard input and writes lines of JSON to standard
output: ``{"done", "total", "message"}`` while it works, at the end ``{"answer": …}`` or ``{"error": …}``.
"""

from __future__ import annotations

import copy
import ctypes
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

__all__: list[str] = []

LOOKS_S = 1.0
"""Between looks for the program that started this one."""
AT_ONCE = 8
"""Pictures whose features are found, and pairs times four that are matched, between two reports."""


def _end_with_parent(parent: int) -> None:
    """End with the program that started this one, however that ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    while os.getppid() == parent:
        time.sleep(LOOKS_S)
    os._exit(1)


class _Teller:
    """Writes lines to the program that started this one."""

    def __init__(self) -> None:
        self.stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
        nothing = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):  # what libraries print is no answer
            os.dup2(nothing, stream)

    def tell(self, **told: Any) -> None:
        self.stream.write(json.dumps(told) + "\n")
        self.stream.flush()

    def progress(self, done: int, total: int, message: str) -> None:
        self.tell(done=done, total=total, message=message)


def _features(request: dict[str, Any], tell: _Teller) -> dict[str, Any]:
    """Features of all pictures that have none in the database yet; one lens for each camera."""
    import pycolmap

    database, root = request["database"], request["pictures"]
    known = _known(database)
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads = request["threads"]
    extraction.max_image_size = request["longest_side"]
    extraction.sift.max_num_features = request["most_features"]
    extraction.sift.first_octave = request["first_octave"]
    total = sum(len(c["names"]) for c in request["cameras"])
    done = 0
    for camera in request["cameras"]:
        names = camera["names"]
        lens = next((known[n] for n in names if n in known), -1)
        missing = [n for n in names if n not in known]
        done += len(names) - len(missing)
        for start in range(0, len(missing), AT_ONCE):
            part = missing[start : start + AT_ONCE]
            reader = pycolmap.ImageReaderOptions()
            reader.camera_model = camera["model"]
            if request["masks"]:
                reader.mask_path = request["masks"]
            if lens >= 0:
                reader.existing_camera_id = lens
            else:
                reader.camera_params = ",".join(repr(float(p)) for p in camera["parameters"])
            mode = pycolmap.CameraMode.SINGLE
            pycolmap.extract_features(database, root, part, mode, reader, extraction)
            if lens < 0:
                lens = next((v for k, v in _known(database).items() if k in part), -1)
            done += len(part)
            tell.progress(done, total, "finding features")
    with pycolmap.Database.open(database) as held:
        counts = {i.name: held.num_keypoints_for_image(i.image_id) for i in held.read_all_images()}
    return {"features": counts}


def _known(database: str) -> dict[str, int]:
    """The lens of each picture that has features in a database."""
    import pycolmap

    with pycolmap.Database.open(database) as held:
        return {i.name: i.camera_id for i in held.read_all_images() if held.exists_keypoints(i.image_id)}


def _match(request: dict[str, Any], tell: _Teller) -> dict[str, Any]:
    """Match pairs of pictures, and keep what one motion of the camera explains."""
    import pycolmap

    database, pairs = request["database"], request["pairs"]
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = request["threads"]
    pairing = pycolmap.ImportedPairingOptions()
    verifying = pycolmap.TwoViewGeometryOptions()
    verifying.ransac.random_seed = request["seed"]
    place = Path(database).with_suffix(".pairs.txt")
    pairing.match_list_path = str(place)
    for start in range(0, len(pairs), 4 * AT_ONCE):
        place.write_text("".join(f"{a} {b}\n" for a, b in pairs[start : start + 4 * AT_ONCE]), encoding="utf-8")
        pycolmap.match_image_pairs(database, options, pairing, verifying)
        tell.progress(min(start + 4 * AT_ONCE, len(pairs)), len(pairs), "matching frames")
    place.unlink(missing_ok=True)
    with pycolmap.Database.open(database) as held:
        names = {i.image_id: i.name for i in held.read_all_images()}
        found, geometries = held.read_two_view_geometries()
        ids = [pycolmap.pair_id_to_image_pair(p) if isinstance(p, int) else p for p in found]
        told = [
            [names[a], names[b], len(g.inlier_matches), str(g.config).rsplit(".", 1)[-1]]
            for (a, b), g in zip(ids, geometries, strict=True)
        ]
    return {"pairs": told}


def _map(request: dict[str, Any], tell: _Teller) -> dict[str, Any]:
    """Cameras and points from matches: of several starts the one that explains the most.

    The lens bends nothing while frames are placed: one radial term and the focal length can stand for each other on a straight way,
    and run away together while there are few frames. At the end it is fitted, and kept where it explains clearly more.
    """
    import pycolmap

    total, tried = request["count"], []
    for number, start in enumerate(request["starts"]):
        options = _pipeline(request)
        options.multiple_models = False
        options.ba_refine_focal_length = request["refine_focal"]
        options.mapper.abs_pose_refine_focal_length = request["refine_focal"]
        options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = start["bend"]
        for name in ("init_max_forward_motion", "init_min_tri_angle", "init_min_num_inliers"):
            setattr(options.mapper, name, start[name])
        output = Path(request["output"]) / f"start{number}"
        output.mkdir(parents=True, exist_ok=True)
        placed = [2]

        def next_picture(placed: list[int] = placed, number: int = number) -> None:
            placed[0] += 1
            tell.progress(min(placed[0], total), total, f"placing cameras, start {number + 1}")

        _set_lens(request["database"], start["lenses"])
        models = pycolmap.incremental_mapping(
            request["database"], request["pictures"], str(output), options, next_image_callback=next_picture
        )
        tried += [(number, m, m.num_reg_images(), m.compute_mean_reprojection_error()) for m in models.values()]
        if _settled(tried, request["enough"], request["alike"], request["refine_focal"]):
            break
    if not tried:
        return {"registered": 0, "starts": []}
    most = max(t[2] for t in tried)
    number, best, _, _ = min((t for t in tried if t[2] >= request["nearly"] * most), key=lambda t: t[3])
    told = [[n, placed, round(e, 3), round(_focal(m), 1)] for n, m, placed, e in tried]
    best, lenses = _adjusted(best, request, tell)
    return {"start": number, "starts": told, "lenses": lenses, **_write(best, request["model"])}


def _focal(model: Any) -> float:
    return float(next(iter(model.cameras.values())).mean_focal_length())


def _settled(tried: list[tuple[int, Any, int, float]], enough: int, alike: float, free: bool) -> bool:
    """Whether two starts place enough frames, and agree on the focal length; of a known one a single start does."""
    good = [_focal(m) for _, m, placed, _ in tried if placed >= enough]
    if not free:
        return bool(good)
    return any(abs(a - b) < alike * a for k, a in enumerate(good) for b in good[k + 1 :])


def _adjusted(model: Any, request: dict[str, Any], tell: _Teller) -> tuple[Any, list[list[Any]]]:
    """All cameras and points together, with ever freer lenses; one counts where it explains clearly more than those before. Returns
    what each explains, too: whether it bends, whether its centre is free, error in pixels, whether it was taken; at the end the
    same of a free centre alone, its error as a share of that without."""
    import pycolmap

    def adjust(which: Any, bend: bool, centre: bool) -> float:
        options = pycolmap.BundleAdjustmentOptions()
        options.print_summary = False
        options.refine_focal_length = request["refine_focal"]
        options.refine_extra_params, options.refine_principal_point = bend, centre
        options.ceres.solver_options.num_threads = request["threads"]
        pycolmap.bundle_adjustment(which, options)
        which.update_point_3d_errors()
        return float(which.compute_mean_reprojection_error())

    adjust(model, False, False)
    pycolmap.ObservationManager(model).filter_all_points3D(request["most_px"], request["least_angle"])
    chosen, least = model, adjust(model, False, False)
    told: list[list[Any]] = []
    for number, (bend, centre) in enumerate(request["lenses"]):
        freer = copy.deepcopy(model)
        error = adjust(freer, bend, centre)
        taken = error < (1 - request["gain"]) * least or (bend and request["always_bent"] and not told)
        told.append([bend, centre, round(error, 4), taken])
        if taken:
            chosen, least = freer, error
        tell.progress(number + 1, len(request["lenses"]), "adjusting cameras and points")
    pycolmap.ObservationManager(chosen).filter_all_points3D(request["most_px"], request["least_angle"])
    if any(centre for _, centre, _, taken in told if taken):
        return chosen, told
    # Of what is left, where nothing wrong is in the error any more, a centre that is not in the middle shows by little.
    bend = any(taken for _, _, _, taken in told)
    least, freer = adjust(chosen, bend, False), copy.deepcopy(chosen)
    error = adjust(freer, bend, True)
    taken = error < (1 - request["centre_gain"]) * least
    return (freer if taken else chosen), [*told, [bend, True, round(error / least, 4), taken]]


def _pipeline(request: dict[str, Any]) -> Any:
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = request["threads"]
    options.random_seed = request["seed"]
    options.min_model_size = 3
    options.extract_colors = False
    # Adjusted less often than by default: half the time, the same cameras.
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 1.4
    options.ba_global_max_refinements = 2
    # On a street points ahead are seen at small angles for long, and few are seen by three frames.
    options.triangulation.min_angle = options.mapper.filter_min_tri_angle = request["least_angle"]
    options.mapper.abs_pose_min_num_inliers, options.mapper.abs_pose_min_inlier_ratio = 15, 0.15
    return options


def _set_lens(database: str, lenses: dict[str, list[float]]) -> None:
    """Begin again from other lenses; ``lenses``: parameters by the name of a picture of the camera."""
    import pycolmap

    with pycolmap.Database.open(database) as held:
        lens = {i.name: i.camera_id for i in held.read_all_images()}
        for name, parameters in lenses.items():
            camera = held.read_camera(lens[name])
            camera.params = parameters
            held.update_camera(camera)


def _write(model: Any, path: str) -> dict[str, Any]:
    """A model as arrays in ``path``, and its figures."""
    import numpy as np

    images = sorted((i for i in model.images.values() if i.has_pose), key=lambda i: i.name)
    number = {i.image_id: k for k, i in enumerate(images)}
    lenses = sorted({i.camera_id for i in images})
    poses = np.stack([np.vstack([i.cam_from_world().matrix(), [0, 0, 0, 1]]) for i in images])
    ids = sorted(model.points3D)
    where = {p: k for k, p in enumerate(ids)}
    seen, pixels, owner = [], [], []
    for image in images:
        for point in image.points2D:
            if point.has_point3D() and point.point3D_id in where:
                owner.append(number[image.image_id])
                seen.append(where[point.point3D_id])
                pixels.append(point.xy)
    points = [model.points3D[i] for i in ids]
    cameras = [model.cameras[c] for c in lenses]
    np.savez(
        path,
        names=np.array([i.name for i in images]),
        lens=np.array([lenses.index(i.camera_id) for i in images]),
        poses=poses,
        models=np.array([c.model.name for c in cameras]),
        sizes=np.array([[c.width, c.height] for c in cameras]),
        parameters=np.array([json.dumps([float(p) for p in c.params]) for c in cameras]),
        points=np.array([p.xyz for p in points]).reshape(-1, 3),
        errors=np.array([p.error for p in points]),
        seen_by=np.array(owner, dtype=np.int64),
        seen=np.array(seen, dtype=np.int64),
        pixels=np.array(pixels, dtype=np.float64).reshape(-1, 2),
    )
    return {
        "registered": len(images),
        "points": len(points),
        "error_px": float(model.compute_mean_reprojection_error()),
    }


WORK = {"features": _features, "match": _match, "map": _map}


def main() -> None:
    """Do what is asked for, and end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both; the other decides
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    request = json.loads(sys.stdin.readline())
    teller = _Teller()
    try:
        import pycolmap

        pycolmap.logging.minloglevel = 3
        pycolmap.set_random_seed(request["seed"])
        teller.tell(answer=WORK[request["do"]](request, teller))
    except Exception as error:  # whatever the library says
        teller.tell(error=f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
