"""Appendix: the calibration of a rig.

`rig_estimate` gives matches the faults of a rig and lets variant `kit` learn them. `figures` has the pictures,
`exercises` what is handed in, and `panel` a rig with faults to choose.
"""

from .panel import CalibrationPanel as CalibrationPanel
