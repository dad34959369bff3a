"""Chapter 8: the student's functions drive.

`own` joins them to an odometry and has what the cells around the loop need; `stages` checks each call, `limits` ends
calls that never end, and `loop` finds the first step at which the student's loop differs from the library's.
`exercises` judges what is handed in.
"""
