"""Long drives, more cores, faults, formats, hostile files, Blender."""

from __future__ import annotations

from typing import Any

from docs.tables.read import percent, results, seconds, table

__all__ = [
    "batch",
    "blender",
    "faults",
    "formats",
    "fuzzing",
    "import_memory",
    "install",
    "kills",
    "long_drives",
    "long_stages",
] + ["mesh_fusion", "stage_costs", "threads", "whole_runs"]
LABELS = {
    "drive": "the drive's own",
    "dataset": "the dataset's segmentation",
    "boxes": "boxes and LiDAR points",
    "points": "labelled LiDAR points",
}


def long_drives() -> str:
    """Whole runs on ever longer drives."""
    rows = []
    for row in results("scale")["rows"]:
        busy = ", beside other work" if row.get("beside_other_work") else ""
        rows.append(
            (
                f"{row['frames']:,} of {'x'.join(map(str, row['size']))}",
                f"`{row['quality']}`, `--memory {row['memory']}`",
                f"{row['seconds']:,.0f} s{busy}",
                f"{row['peak_memory_mb']:,.0f} MB",
                row["blocks"],
                f"{row['psnr']:.1f} dB",
            )
        )
    return table(("frames", "settings", "time", "peak memory", "blocks", "removed pixels"), rows)


def long_stages() -> str:
    """200 frames of 1920x1080: forecast, what it took, and by stage."""
    found = results("full_size")
    expected = found["expected"]
    rows = [
        ("time", f"{expected['seconds_in_all']:,.0f} s", f"{found['seconds']:,.0f} s"),
        ("peak memory", f"{expected['memory_mb'] / 1000:.1f} GB", f"{found['peak_memory_mb'] / 1000:.1f} GB"),
        ("workspace", f"{expected['disk_mb']:.0f} MB", f"{found['workspace_mb']:.0f} MB"),
    ]
    for stage, took in sorted(found["stages"].items(), key=lambda item: -item[1]["seconds"])[:3]:
        rows.append((f"`{stage}`", f"{expected['seconds'][stage]:.0f} s", f"{took['seconds']:.0f} s"))
    return table(("", "forecast", "it took"), rows)


def stage_costs() -> str:
    """Stages before and after changes, by processor seconds."""
    rows = []
    for row in results("stage_cost")["rows"]:
        before, after = row["before"], row["after"]
        frames = row["frames"]
        rows.append(
            (
                f"`{row['stage']}`, {row['drive']}",
                frames,
                f"{before['seconds'] / frames:.2f} s",
                f"{after['seconds'] / frames:.2f} s",
                *(f"{of['main_seconds'] / frames:.2f} s" if "main_seconds" in of else None for of in (before, after)),
                f"{before['peak_memory_mb']:,} MB",
                f"{after['peak_memory_mb']:,} MB",
            )
        )
    head = ("stage", "frames", "a frame before", "after", "on one thread", "after", "peak memory before", "after")
    return table(head, rows)


def whole_runs() -> str:
    """Whole runs before and after changes, by wall time."""
    rows = []
    for row in results("whole_runs")["rows"]:
        before, after = row["before"], row["after"]
        shown = (f"{of['seconds']:.0f} s" for of in (before, after))
        memory = (f"{of['peak_memory_mb']:,} MB" for of in (before, after))
        rows.append((row["drive"], *shown, f"{row['share_of_time']:.2f}", *memory))
    return table(("run", "before", "after", "share", "peak memory before", "after"), rows)


def threads() -> str:
    """One processor against two, and what more can be expected to give."""
    found = results("threads")
    rows = []
    for stage, of in sorted(found["stages"].items(), key=lambda item: -item[1]["2"])[:3]:
        more = (f"{of['expected'][n]:.0f} s" for n in ("8", "16"))
        rows.append((f"`{stage}`", f"{of['1']:.0f} s", f"{of['2']:.0f} s", percent(of["serial_share"]), *more))
    whole = found["whole"]
    more = (f"{whole['expected'][n]:.0f} s" for n in ("8", "16"))
    rows.append(
        (
            "whole run",
            f"{whole['1']:.0f} s",
            f"{whole['2']:.0f} s",
            None,
            *more,
        )
    )
    return table(("", "1 core", "2 cores", "serial", "8, expected", "16, expected"), rows)


def batch() -> str:
    """Eight drives on local workers, in one sentence."""
    one, two, killed = results("batch")["runs"]
    return (
        f"Eight drives of 20 to 34 frames, as drafts on local workers: {seconds(one['seconds'])} with one worker,"
        f" {seconds(two['seconds'])} with two, {seconds(killed['seconds'])} with two of which one was killed at work. All eight"
        f" were done each time. A run keeps both processors busy, so a second worker on the same machine gains little."
    )


def faults() -> str:
    """Runs disturbed by real signals, limits and mounts, in one sentence."""
    found = results("faults")["faults"]
    times, lost, wrong, unclear = (sum(f[key] for f in found.values()) for key in ("times", "lost", "wrong", "unclear"))
    return (
        f"{len(found)} kinds of fault, {times} times: {lost} finished stages were lost, {wrong} files of the end result differed"
        f" from an undisturbed run, and {unclear} runs did not say in one line how they ended."
    )


def kills() -> str:
    """One run killed again and again, in one sentence."""
    found = results("kills")
    return (
        f"A draft of 36 frames was killed {found['kills']} times, at random moments in every stage, and begun again each time."
        f" Of {found['files']} files of the end result {len(found['different'])} differ from an undisturbed run. A kill cost"
        f" {found['lost_s_a_kill']:.0f} s, of which starting the program took {found['starting_s_a_kill']:.0f}."
    )


def formats() -> str:
    """Six frames in the encoding of each dataset: overlap of mask and true outline."""
    by_labels: dict[str, list[dict[str, Any]]] = {}
    for row in results("formats")["formats"]:
        by_labels.setdefault(LABELS[row["labels_come_from"]], []).append(row)
    rows = []
    for labels, of in by_labels.items():
        overlaps = [row["mask_iou"] for row in of]
        shown = (
            f"{min(overlaps):.2f} to {max(overlaps):.2f}"
            if max(overlaps) - min(overlaps) > 0.01
            else f"{overlaps[0]:.2f}"
        )
        rows.append((labels, ", ".join(row["format"] for row in of), shown))
    return table(("labels", "formats", "overlap (IoU)"), rows)


def fuzzing() -> str:
    """Hostile files by the kind of reader."""
    kinds: dict[str, list[dict[str, Any]]] = {}
    for row in results("fuzz")["readers"].values():
        kinds.setdefault(row["kind"], []).append(row)
    names = {"text": "text and JSON", "binary": "pictures, points, arrays", "drive": "whole drives"}
    rows = []
    for kind, of in kinds.items():
        inputs = sum(row["inputs"] for row in of)
        read = percent(sum(row["read"] for row in of) / max(inputs, 1))
        counts = (sum(row[key] for row in of) for key in ("crash", "hang", "memory", "wrong"))
        rows.append((names[kind], len(of), f"{inputs:,}", read, *counts))
    return table(("files", "readers", "inputs", "of these read", "crashes", "hangs", "too much memory", "wrong"), rows)


def blender() -> str:
    """A big drive in Blender, and what a run costs its window."""
    big = results("blender_big")["versions"]["now"]
    window, day = results("blender_window"), results("blender_day")
    rows = [
        (
            "timer during a run, mean / longest",
            f"{window['resumed']['callback_mean_ms']:.1f} / {window['resumed']['callback_longest_ms']:.1f} ms",
        ),
        ("*Cancel* to the end of the last process", f"{window['cancelled']['cancel_to_end_of_group_s']:.1f} s"),
        ("load 400 frames, 5 million points, two meshes of 5 million triangles", f"{big['load_s']:.1f} s"),
        ("load it again, nothing new", f"{big['load_again_s']:.1f} s"),
        ("peak memory with it", f"{big['peak_memory_mb'] / 1000:.1f} GB"),
        (".blend with it, plain / compressed", f"{big['blend_mb']:.0f} / {big['blend_compressed_mb']:.0f} MB"),
        ("sidebar redrawn with a mesh", f"{day['redraws']['mesh']['sidebar_ms']:.1f} ms"),
    ]
    return table(("", ""), rows)


def install() -> str:
    """Size of the packages, for a sentence."""
    found = results("install")
    parts = ", ".join(f"`{extra}` {mb:,.0f} MB" for extra, mb in found["extras_mb"].items())
    return f"Installed, the packages take {found['core_mb'] / 1000:.1f} GB with PyTorch for the processor; extras add: {parts}."


def import_memory() -> str:
    """The import of a long drive, in one sentence."""
    row = results("import_memory")["rows"][0]
    return (
        f"Importing {row['frames']} frames of {'x'.join(map(str, row['size']))} with as many sweeps of"
        f" {row['points_a_sweep']:,} points takes {row['seconds']:.0f} s and {row['peak_memory_mb'] / 1000:.1f} GB."
    )


def mesh_fusion() -> str:
    """Mesh fusion of a long street, in one sentence."""
    rows = results("long_street")["rows"]
    sizes = " or ".join(dict.fromkeys(f"{row['width']}x{row['height']}" for row in rows))
    most, error = (max(row[key] for row in rows) for key in ("peak_memory_mb", "error_95_percent_mm"))
    return (
        f"Fusing {rows[0]['length_m']} m of street at {100 * rows[0]['voxel_m']:.0f} cm, from 200 to 300 exact depth images of"
        f" {sizes}, takes {most / 1000:.1f} GB at most. 95 % of the vertices are within {error:.1f} mm of the true planes."
    )
