"""The command line that the truth scenes share."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import capture
import numpy as np
from build_street import removable
from free_views import write_free_views


def command(description: str | None, build, offset: np.ndarray, *, samples: int, folder: Path) -> None:  # type: ignore[no-untyped-def]
    """The command line of a truth scene: build, render crowded and empty, cast the LiDAR, derive masks, write; then the free views."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--frames", type=int, default=28)
    parser.add_argument("--samples", type=int, default=samples)
    parser.add_argument("--only", type=int, nargs="*", help="render just these frames, as PNG, and stop")
    parser.add_argument("--free", action="store_true", help="render just truth/free/, views beside and above the path, and stop")
    parser.add_argument("--unseen", action="store_true", help="find what no frame shows anew, for recorded and free views, and stop")
    parser.add_argument("-o", "--output", type=Path, default=folder)
    arguments = parser.parse_args(sys.argv[1:])
    scene = build()
    capture.configure(scene, samples=arguments.samples)
    cameras = capture.drive(scene, frames=arguments.frames)
    if arguments.only:
        for frame in arguments.only:
            capture.render_color(scene, cameras, frame, arguments.output / f"preview_{frame:04d}.png")
        return
    if arguments.unseen:
        print(json.dumps({"unseen_pixels": capture.write_unseen(scene, cameras, arguments.output)}))
        print(json.dumps(write_free_views(scene, cameras, arguments.output, offset, pictures=False)))
        return
    if arguments.free:
        print(json.dumps(write_free_views(scene, cameras, arguments.output, offset)))
        return
    capture.write_drive(scene, cameras, arguments.output, offset)
    write_free_views(scene, cameras, arguments.output, offset)
    print(json.dumps({"frames": arguments.frames, "objects": len(removable(scene))}))
