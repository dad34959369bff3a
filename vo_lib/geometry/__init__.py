"""Geometry, and the data that passes between the stages of a frame: what `paper` and `kit` share.

- `motion` and `twist`: rotations, rigid motions and the essential matrix, with the kit's conventions;
- `camera`, `matches`, `boxes` and `result`: what the stages receive and return;
- `reprojection`: residuals of a motion in the current images, and a robust fit of a motion;
- `types`, `rows` and `symmetric`: types of arrays, arrays with corresponding rows, small symmetric matrices.
"""
