"""Reports: one self-contained HTML page a job, understandable without its makers."""

from __future__ import annotations

from drake_stiffness.report.compensation import compensation_report
from drake_stiffness.report.demo import DemoRow, RobustnessRow, demo_report
from drake_stiffness.report.identification import identification_report
from drake_stiffness.report.inspection import inspection_report

__all__ = [
    "DemoRow",
    "RobustnessRow",
    "compensation_report",
    "demo_report",
    "identification_report",
    "inspection_report",
]
