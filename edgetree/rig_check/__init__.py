"""Check from a drive whether calibration and the alignment of depth to colour still hold."""

from edgetree.rig_check.checks import RigCheck
from edgetree.rig_check.drive_check import RigReport, check_rig
from edgetree.rig_check.report import report_lines

__all__ = ["RigCheck", "RigReport", "check_rig", "report_lines"]
