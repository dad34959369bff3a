"""Calibration."""

from .panel import CalibrationPanel as CalibrationPanel
