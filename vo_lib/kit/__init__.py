"""Variant `kit`: additions to the paper's method, one idea per file.

Read `kit_odometry` first: it replaces whole steps of the paper's odometry. Behind these steps are

- `klt`, `corners`, `surface` and `alignment`: the front end, by Lucas-Kanade (chapter 1);
- `refined_selection` and `refinement`: the rotation (chapter 3);
- `weighted_translation`: the translation (chapter 4);
- `box_rules`, `box_states` and `moving`: which vehicles move (chapter 5);
- `rig`, `parallax` and `calibration`: calibration errors, learnt during the drive (appendix).

`settings` has the thresholds of all of them.
"""
