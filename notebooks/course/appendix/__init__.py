"""Calibration."""

from .panel import CalibrationPanel

__all__ = ["CalibrationPanel"]
