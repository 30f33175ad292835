"""Real drives: cameras out of images, clicks, planted cars, planted holes in charts."""

from __future__ import annotations

from typing import Any

from docs.tables.read import mean_se, percent, results, table

__all__ = ["beside_lidar", "chart_holes", "clicks", "points", "real", "real_against", "solved"]

SEQUENCES = {
    "kitti": "KITTI raw 0005",
    "nuscenes": "nuScenes 0916, front, key frames",
    "pandaset": "PandaSet 002, front",
    "lund": "lund, photographs on foot",
    "phone_clip": "`sample_scenes/phone_clip`",
}
DRIVES = {
    "kitti_0005": "KITTI 0005",
    "nuscenes_0916_front": "nuScenes 0916, front",
    "pandaset_002_front": "PandaSet 002, front",
    "parked_street": "parked street (rendered)",
    "all": "all three",
}


def solved() -> str:
    """Real sequences as plain images, against their true cameras."""
    found = results("solve")["sequences"]
    rows = []
    for key, name in SEQUENCES.items():
        s = found[key]
        rotation, focal, scale = (s.get(k) for k in ("rotation_deg", "focal_percent", "scale_percent"))
        rows.append(
            (
                f"{name}, {s['size']}",
                f"{s['placed']} of {s['frames']}",
                f"{s['error_percent_of_way']:.2f} %",
                None if rotation is None else f"{rotation:.2f}°",
                None if focal is None else f"{focal:+.1f} %",
                None if scale is None else f"{scale:+.1f} %",
                f"{s['points']:,}",
                f"{s['seconds_a_frame']:.1f} s",
            )
        )
    return table(("sequence", "placed", "error", "rotation", "focal length", "scale", "points", "a frame"), rows)


PLANTED = {"kitti": "kitti_0005", "nuscenes": "nuscenes_0916_front", "pandaset": "pandaset_002_front"}
"""Planted drives of sequences."""


def beside_lidar() -> str:
    """Planted drives unveiled from their images, beside the runs with LiDAR and true cameras."""
    found = results("beside_lidar")["drives"]
    rows = []
    for key, drive in PLANTED.items():
        row = found[f"{drive}, draft"]
        less = row["images_less_lidar"]
        dbs = [f"{row[k]['removed']['psnr']['mean']:.1f} dB" for k in ("images", "lidar")]
        by = [less[f"removed {n}"] for n in ("psnr", "lpips")]
        rows.append(
            (
                SEQUENCES[key],
                *dbs,
                f"{by[0]['mean']:+.1f} ±{by[0]['se']:.1f} dB",
                f"{by[1]['mean']:+.3f} ±{by[1]['se']:.3f}",
            )
        )
    return table(("drive", "from images", "with LiDAR", "PSNR", "LPIPS"), rows)


def points() -> str:
    """Points found by true poses, against the LiDAR that was taken away."""
    found = results("solve")["sequences"]
    spans = ("0 to 8 m", "8 to 15 m", "15 to 25 m", "25 to 50 m")
    rows = []
    for key in ("kitti", "pandaset"):
        s = found[f"{key}, points"]
        near = (f"{percent(s[span]['within_25_cm'])} ({100 * s[span]['median_m']:.0f} cm)" for span in spans)
        rows.append((SEQUENCES[key], f"{s['points']:,}", *near))
    return table(("drive", "points", *spans), rows)


def clicks() -> str:
    """Objects by three clicks in one frame, intersection over union in all frames."""
    names = {
        "parked_street": "parked street",
        "parked_street, reconstructed": "parked street, scene reconstructed at `draft`",
        "country_road": "country road",
        "phone_clip": "phone clip, solved from its pictures",
        "pandaset 002, approximate truth": "PandaSet 002, approximate truth",
    }
    document = results("clicks")
    rows = []
    for key, name in names.items():
        s = document[key]
        worst = (f"{s[k]:.2f}" for k in ("iou_mean", "iou_worst_object", "iou_worst_frame"))
        over = percent(s["share_of_objects_over_0.85"])
        rows.append((name, s["objects"], *worst, over, f"{s['seconds_median']:.0f} s"))
    return table(("", "cars", "mean", "worst car", "worst frame", "over 0.85", "one call"), rows)


def _latest() -> tuple[str, list[dict[str, Any]]]:
    runs = results("real")["runs"]
    tree = results("real")["comparisons"][0]["ours"]
    return tree, [run for run in runs if run["tree"] == tree]


def real() -> str:
    """Six planted cars in each of three real drives, mean and standard error over cars."""
    rows = []
    for run in _latest()[1]:
        for key, name in (("ours", "Unveil"), ("best_opencv", "best of OpenCV"), ("blurred", "photograph, blurred")):
            all_of, seen, unseen = (run["parts"][part][key] for part in ("removed", "seen_elsewhere", "unseen"))
            lines = " / ".join(f"{100 * all_of[k]['mean']:.0f} %" for k in ("line_recall", "false_lines"))
            rows.append(
                (
                    DRIVES[run["drive"]] if key == "ours" else "",
                    name,
                    f"{mean_se(all_of['psnr'])} dB",
                    mean_se(all_of["lpips"], 3),
                    lines,
                    f"{all_of['tint']['mean']:.1f}",
                    *(f"{part['psnr']['mean']:.1f} dB" for part in (seen, unseen)),
                )
            )
    return table(("drive", "", "PSNR", "LPIPS", "lines found / false", "tint", "seen elsewhere", "never seen"), rows)


def real_against() -> str:
    """The same minus an earlier state, paired over all cars, in one sentence."""
    pair = next(p for p in results("real")["comparisons"] if p["drive"] == "all")
    found = pair["figures"]
    return (
        f"State {pair['ours']} minus {pair['theirs']}, paired over all cars: {mean_se(found['removed psnr'], sign='+')} dB,"
        f" LPIPS {mean_se(found['removed lpips'], 3, sign='+')}, lines found"
        f" {mean_se(found['removed line_recall'], 0, 100, '+')} points, false lines"
        f" {mean_se(found['removed false_lines'], 0, 100, '+')} points; where another frame shows the place"
        f" {mean_se(found['seen_elsewhere psnr'], sign='+')} dB."
    )


def chart_holes() -> str:
    """Holes planted in the charts of finished workspaces."""
    rows = []
    for run in results("chart_holes")["runs"]:
        f = run["figures"]
        rows.append(
            (
                DRIVES[run["drive"]],
                f"{run['holes']}, {run['cells']}",
                f"{mean_se(f['psnr'])} dB",
                mean_se(f["ssim"], 2),
                mean_se(f["gradient"], 2),
                mean_se(f["lpips"], 3),
            )
        )
    return table(("chart", "holes, cells", "PSNR", "SSIM", "gradient", "LPIPS"), rows)
