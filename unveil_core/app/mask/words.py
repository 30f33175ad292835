"""The options of ``unveil mask`` that say what an object is, kept in their order: a name holds for what follows it."""

from __future__ import annotations

import argparse
from typing import Any

__all__ = ["add_words"]


class _InOrder(argparse.Action):
    """Appends (option, value) to one list of all such options."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, values: Any, option: str | None = None) -> None:
        said = [*(getattr(namespace, "said", None) or []), (self.const, str(values))]
        namespace.said = said


def add_words(p: argparse.ArgumentParser) -> None:
    """Add the options; ``said`` gets a list of (word, value): "object", "inside", "outside", "stroke", "matte", "mattes"."""
    p.set_defaults(said=[])
    for option, word, metavar, text in (
        ("--object", "object", "NAME", "of the object that the clicks and strokes after it are of"),
        ("--click", "inside", "[CAMERA/]FRAME:X,Y", "a pixel of the object, in a frame as it was filmed"),
        ("--not", "outside", "[CAMERA/]FRAME:X,Y", "a pixel that is not the object"),
        (
            "--stroke",
            "stroke",
            "FRAME:PNG|FILE.json",
            "a picture that is white, or opaque, over a part of the object; or a file of strokes",
        ),
        ("--matte", "matte", "FRAME:PNG", "a picture that is white, or opaque, over the whole object"),
        ("--mattes", "mattes", "FOLDER", "such pictures of one frame or more, named like the frames"),
    ):
        p.add_argument(option, action=_InOrder, const=word, metavar=metavar, help=text)
