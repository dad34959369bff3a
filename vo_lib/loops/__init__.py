"""The closing of loops after a run (chapter 9): a place that is visited again corrects the path.

- `places` finds similar images. With them, `find_loops` in `find` compares pairs of places and measures the
  motion between the two visits. With its result `pairs`, the loops are `pairs[pairs.accepted(config)]`.
- `close_path` in `graph` corrects the path by these loops.
- `write_closure` in `closure_files` writes the corrected path and the loops.

`settings` has the thresholds of all of them.
"""
