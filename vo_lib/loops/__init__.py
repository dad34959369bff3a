"""The closing of loops after a run (chapter 9): a place that is visited again corrects the path.

`places` finds similar images, `find` the motion between two visits of a place, and `graph` the corrected
path. `closure_files` writes the result, and `settings` has the thresholds.
"""
