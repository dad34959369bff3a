"""A synthetic stereo street in KITTI's layout, with exact truth for everything.

folder = ensure_scene("parked")      # image_0, image_1, calib.txt, times.txt, poses.txt, labels, truth
truth = open_truth(folder)           # depth, instances, motion of every vehicle
"""

from .cache import cache_folder, ensure_scene, is_complete, scene_key
from .scenes import SCENES, SceneConfig, scene_config
from .truth import Truth, open_truth

__all__ = [
    "SCENES",
    "SceneConfig",
    "Truth",
    "cache_folder",
    "ensure_scene",
    "is_complete",
    "open_truth",
    "scene_config",
    "scene_key",
]
