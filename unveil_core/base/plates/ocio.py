"""Colours of plates by a studio's configuration of OpenColorIO."""

from __future__ import annotations

import json
import re
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.disk.open_safely import LARGEST_FILE, LARGEST_TEXT, RefusedFileError, check_file
from unveil_core.base.errors import SettingsError
from unveil_core.base.types import Float32

__all__ = ["applied", "space_of_file"]

OF_LIGHT = ("Linear Rec.709 (sRGB)", "lin_rec709_scene", "lin_rec709", "lin_srgb", "Utility - Linear - sRGB", "Linear")
"""Names under which configurations have linear light with the primaries of Rec. 709."""
ROLES = {"openexr": "scene_linear", "dpx": "compositing_log"}
"""What a file is in that no rule of the configuration knows."""
BUILT_IN = "ocio://"
TABLE = re.compile(r'!<FileTransform> \{src: ("(?:[^"\\]|\\.)*"|[^",}]+)')
"""A file in the text of a configuration, as the library writes it."""
MEND = "mend OCIO, or unset it for what the files say themselves"


def _library(configuration: str) -> Any:
    if find_spec("PyOpenColorIO") is None:
        mend = "pip install '.[plates]' in the folder of Unveil, or unset OCIO"
        raise SettingsError("Not installed: OpenColorIO, and OCIO names a configuration", mend=mend)
    import PyOpenColorIO

    return PyOpenColorIO


@lru_cache(maxsize=4)
def _configuration(configuration: str) -> Any:
    ocio = _library(configuration)
    try:
        if not configuration.startswith(BUILT_IN):
            check_file(configuration, LARGEST_TEXT)
        config = ocio.Config.CreateFromFile(configuration)
        _check_tables(ocio, config)
        return config
    except RefusedFileError as error:
        problem = f"Not a configuration of OpenColorIO: {error.strerror}"
        raise SettingsError(problem, path=error.filename or configuration, mend=MEND) from error
    except (OSError, ocio.Exception, ocio.ExceptionMissingFile) as error:
        raise SettingsError(f"Not a configuration of OpenColorIO: {error}", path=configuration, mend=MEND) from error


def _check_tables(ocio: Any, config: Any) -> None:
    """Check the files that transforms name: the library opens them by itself, and would wait for a pipe.

    Raises:
        RefusedFileError: one is no regular file, or too large.
    """
    context = config.getCurrentContext()
    for text in dict.fromkeys(TABLE.findall(config.serialize())):
        name = json.loads(text) if text[0] == '"' else text
        try:
            check_file(Path(config.getWorkingDir()) / context.resolveFileLocation(name), LARGEST_FILE)
        except RefusedFileError:
            raise
        except (OSError, ocio.Exception, ocio.ExceptionMissingFile):
            continue  # the library says so where it needs it


def space_of_file(configuration: str, path: Path, kind: str) -> str:
    """The colour space of a plate: by the configuration's rules for files, else by the role of its kind.

    Raises:
        SettingsError: the configuration cannot be read, or has neither.
    """
    config = _configuration(configuration)
    rules = config.getFileRules()
    name, rule = config.getColorSpaceFromFilepath(str(path))
    if rules.getNumEntries() and rule < rules.getNumEntries() - 1 and config.getColorSpace(name) is not None:
        return str(config.getColorSpace(name).getName())
    role = config.getColorSpace(ROLES[kind])
    if role is None:
        raise SettingsError(f"has no role {ROLES[kind]}, and no rule for {path.name}", path=configuration, mend=MEND)
    return str(role.getName())


@lru_cache(maxsize=8)
def _processor(configuration: str, space: str, back: bool) -> Any:
    ocio, config = _library(configuration), _configuration(configuration)
    light = next((name for name in OF_LIGHT if config.getColorSpace(name) is not None), None)
    if light is None:
        raise SettingsError("has no linear light of Rec. 709", path=configuration, mend=MEND)
    ways = (light, space) if back else (space, light)
    try:
        return config.getProcessor(*ways).getDefaultCPUProcessor()
    except ocio.Exception as error:
        raise SettingsError(
            f"has no way from {ways[0]} to {ways[1]}: {error}", path=configuration, mend=MEND
        ) from error


def applied(values: np.ndarray, configuration: str, space: str, *, back: bool = False) -> Float32:
    """(..., 3) float32 linear light of Rec. 709 of values in a space; ``back``: the other way round.

    Raises:
        SettingsError: the configuration has no such way.
    """
    pixels = np.ascontiguousarray(values, dtype=np.float32).copy()
    _processor(configuration, space, back).applyRGB(pixels.reshape(-1, 3))
    return pixels
