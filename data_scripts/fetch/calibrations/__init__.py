"""Stereo calibrations of other tools, one module per tool; `files.read_calibration` chooses the module."""
