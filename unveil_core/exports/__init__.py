"""Results in the files of other programs: splats, meshes, cameras, points, plates.

:data:`~unveil_core.exports.registry.FORMATS` lists the formats, and :func:`~unveil_core.exports.registry.export` writes them.
"""

from unveil_core.exports.job import Job
from unveil_core.exports.registry import FORMATS, ExportFormat
from unveil_core.exports.writing import export

__all__ = ["FORMATS", "ExportFormat", "Job", "export"]
