"""A stereo street, drawn into folders in KITTI's layout with exact truth: `cache.draw_scene`."""
