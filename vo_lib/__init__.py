"""Stereo visual odometry by solution selection, with features on vehicles removed."""
