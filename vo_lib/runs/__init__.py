"""Runs: from a sequence to the files with its path, computed once and read again later.

Read `drive` first: the loop over the frames. Before it is `front_end`, the matches of every frame. Around
them are

- `match_cache`: these matches on disk, for runs with other thresholds behind them;
- `identity`: on which images, labels, settings and code a result depends;
- `folder`: the files of a run; `run_quality` has the errors and warnings that are written with them;
- `jobs`: a run that is done only if its folder lacks it, and many of them in several processes. `durations`
  estimates how long they will take, also from the times of `earlier_seconds`.
"""
