"""Draw a synthetic sequence.

examples:
  vo data render_synthetic parked
  vo data render_synthetic traffic --length 1000 --seed 7 --oncoming 4
"""

from __future__ import annotations

import argparse

from vo_lib.commands.common import add_cache, parse_frames, parse_jobs
from vo_lib.commands.console import add_settings, option_values, reporting
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import SCENES, SceneConfig, scene_config
from vo_lib.settings import declared


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script, one for every setting of a scene."""
    parser.add_argument("scene", help="named scene: " + ", ".join(SCENES))
    add_cache(parser)
    parser.add_argument(
        "--jobs", default="2", metavar="N", help="number of processes at the same time; default 2"
    )
    parser.add_argument("--frames", metavar="A:B", help="draw only frames A to B-1, in a folder of their own")
    group = parser.add_argument_group("settings; default: the settings of the named scene")
    add_settings(group, SceneConfig, defaults=False)


def run(options: argparse.Namespace) -> int:
    """Draw a scene."""
    config = scene_config(options.scene, **option_values(options, declared(SceneConfig)))
    frames = None if options.frames is None else range(*parse_frames(options.frames, 1_000_000))
    jobs = parse_jobs(options.jobs)
    with reporting(f"drawing {options.scene}") as report:
        print(ensure_scene(config, options.cache, report, jobs, frames))
    return 0
