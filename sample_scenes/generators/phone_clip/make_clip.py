"""Film a street as a phone would, and write it as a phone does: rolling shutter, shaking hand, automatic exposure, HEVC.

    python sample_scenes/generators/phone_clip/make_clip.py [--seconds 8] [-o FOLDER]

Keeps frames/ as PNG, goes on where it was ended, and writes clip.mp4, labels/ (PNGs of Cityscapes trainIds, exact) and truth.json (the lens, and where the phone was at each middle row).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[2]))
from sample_scenes.generators.phone_clip import film, street  # noqa: E402

TICKS = 600
"""Of the clip's clock, a second, as phones have it."""
CRF = "26"


def encode(pictures: Iterable[np.ndarray], path: Path, rate: float, codec: str = "libx265") -> None:
    """Write RGB pictures as a clip."""
    import av

    options = {"crf": CRF, "preset": "medium"} | ({"x265-params": "log-level=none"} if codec == "libx265" else {})
    with av.open(str(path), "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream(codec, rate=Fraction(rate).limit_denominator(1001), options=options)
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, TICKS)
        if codec == "libx265":
            stream.codec_context.codec_tag = "hvc1"
        stream.codec_context.color_primaries = stream.codec_context.color_trc = stream.codec_context.colorspace = 1
        for number, rgb in enumerate(pictures):
            if number == 0:
                stream.width, stream.height = rgb.shape[1], rgb.shape[0]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
            frame.pts, frame.time_base = round(number * TICKS / rate), Fraction(1, TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def write_truth(phone: film.Phone, count: int, path: Path) -> None:
    """The lens, and camera-to-world poses with OpenCV axes at each frame's middle row."""
    poses = [np.round(film.pose(phone, n / phone.rate + phone.readout_s / 2), 6).tolist() for n in range(count)]
    path.write_text(json.dumps({**asdict(phone), "camera_to_world": poses}) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--only", type=int, nargs="*", help="write these frames as PNG, and stop")
    parser.add_argument("-o", "--output", type=Path, default=HERE.parents[1] / HERE.name)
    given = parser.parse_args()
    phone = film.Phone()
    count = math.ceil(given.seconds * phone.rate)
    given.output.mkdir(parents=True, exist_ok=True)
    if given.only:
        boxes = street.make_street().arrays(crowded=True)
        for number in given.only:
            shown, _ = film.picture(phone, boxes, number / phone.rate)
            cv2.imwrite(str(given.output / f"frame_{number:04d}.png"), shown[..., ::-1])
        return
    (given.output / "labels").mkdir(exist_ok=True)

    boxes = street.make_street().arrays(crowded=True)

    def pictures() -> Iterator[np.ndarray]:
        for number in range(count):
            labels, kept = given.output / f"labels/{number:06d}.png", given.output / f"frames/{number:06d}.png"
            if not (labels.is_file() and kept.is_file()):
                kept.parent.mkdir(exist_ok=True)
                shown, kinds = film.picture(phone, boxes, number / phone.rate)
                cv2.imwrite(str(labels), kinds, [cv2.IMWRITE_PNG_COMPRESSION, 9])
                cv2.imwrite(str(kept), shown[..., ::-1])
                print(f"frame {number + 1} of {count}", flush=True)
            yield cv2.imread(str(kept))[..., ::-1]

    encode(pictures(), given.output / "clip.mp4", phone.rate)
    write_truth(phone, count, given.output / "truth.json")


if __name__ == "__main__":
    main()
