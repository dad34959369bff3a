"""Draw a synthetic sequence.

examples:
  vo data render_synthetic parked
  vo data render_synthetic traffic --length 1000 --seed 7 --oncoming 4
"""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext

from street.cache import draw_scene
from vo_lib.commands.common import add_cache, parse_frames, parse_whole
from vo_lib.commands.console import reporting
from vo_lib.commands.data import run_script
from vo_lib.commands.setting_options import add_settings, given
from vo_lib.core.settings import declared
from vo_lib.data.drawn import cache_folder
from vo_lib.data.scenes import SCENES, SceneConfig, scene_config


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options: every setting of a scene has one."""
    parser.add_argument("scene", help="scene to start from: " + ", ".join(SCENES))
    add_cache(parser)
    parser.add_argument("--jobs", default="2", metavar="N", help="processes that draw (default 2)")
    parser.add_argument("--frames", metavar="A:B", help="draw only frames A … B-1, in a folder of their own")
    parser.add_argument("--count", action="store_true", help="print '1 of 260', … in place of a bar")
    group = parser.add_argument_group("settings of the scene; default: those of the scene named")
    add_settings(group, SceneConfig, defaults=False)


def run(options: argparse.Namespace) -> int:
    """Draw a scene."""
    config = scene_config(options.scene, **given(options, declared(SceneConfig)))
    cache = options.cache or cache_folder()
    frames = None if options.frames is None else range(*parse_frames(options.frames, 1_000_000))
    with nullcontext(count) if options.count else reporting(f"drawing {options.scene}") as report:
        folder = draw_scene(config, cache, report, parse_whole("--jobs", options.jobs), frames)
    print(folder)
    return 0


def count(done: int, total: int) -> None:
    """Say how many frames are drawn, for a program that reads it."""
    print(f"{done} of {total}", flush=True)


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
