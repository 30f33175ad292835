"""The differentiable 2D Gaussian rasterizer: one function, several backends."""

from unveil_core.raster.api import Rendered, render

__all__ = ["Rendered", "render"]
