"""Drives on disk and in memory; :func:`open_drive` reads every known format."""

from __future__ import annotations

from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.drives.formats.registry import open_drive

__all__ = ["Drive", "Frame", "PointCloud", "open_drive"]
