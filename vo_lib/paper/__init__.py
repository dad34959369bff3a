"""The method of the paper, as published.

Chapters are those of the course (notebooks 01 to 09), and sections are those of the paper. Read `odometry`
first, since it has the seven steps of a frame. The stages before it, and the modules of its steps, are

- `features` and `matching`: blobs and corners, matched in a loop through two stereo pairs (chapter 1);
- `box_removal` and `buckets`: which of these matches are used (chapters 5 and 1);
- `five_point` and `real_roots`: all essential matrices of five-point sets (chapter 2);
- `selection` and `sampson`: the choice of one of them, and its rotation (chapter 3);
- `translation`: equations (2) and (3) (chapter 4);
- `viso2`: another estimator, the first column of Table 1.

`settings` has the thresholds of all of them.
"""
