"""How good the empty street is: metrics, baselines, and a whole workspace measured."""

from unveil_core.evaluate.evaluation import METHODS, run_evaluation, write_metrics
from unveil_core.evaluate.free_views import FREE_REGIONS
from unveil_core.evaluate.metrics import mask_iou, psnr, ssim

__all__ = ["FREE_REGIONS", "METHODS", "mask_iou", "psnr", "run_evaluation", "ssim", "write_metrics"]
