"""The report page, videos, strips and the closing lines of a run."""

from unveil_core.report.page import write_report

__all__ = ["write_report"]
