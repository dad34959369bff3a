"""Errors of estimated paths, and what they prove (chapters 6 and 7).

Read `path_errors` first: its `evaluate` computes all errors of a path. Behind it are

- `kitti_errors`: TE and RE, the errors of KITTI's benchmark;
- `ate_rpe`: ATE, RPE and the alignment of paths;
- `path_facts`: what paths say without ground truth, and whether one is in doubtful axes or units.

Beside it is `statistics`, means over seeds.
"""
