"""Renderer of stereo streets in KITTI's layout with exact truth; the entry point is `cache.draw_scene`."""
