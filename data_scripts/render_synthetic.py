"""Draw synthetic sequences into KITTI-layout folders, or all scenes on one sheet.

examples:
  python render_synthetic.py parked
  python render_synthetic.py traffic --length 1000 --seed 7 --oncoming 4
  python render_synthetic.py --contact-sheet scenes.jpg
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2

from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import OneLineParser, reporting
from vo_lib.commands.script import guarded
from vo_lib.core.errors import DataError
from vo_lib.core.settings import declared
from vo_lib.synthetic import SCENES, SceneConfig, contact_sheet, ensure_scene, scene_config


def parser() -> argparse.ArgumentParser:
    """Options: every setting of a scene has one."""
    made = OneLineParser(
        prog="render_synthetic.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("scene", nargs="?", help="scene to start from: " + ", ".join(SCENES))
    made.add_argument(
        "--cache", type=Path, metavar="DIR", help="where scenes are kept (default: the user's cache)"
    )
    made.add_argument("--jobs", default="2", metavar="N", help="processes that draw (default 2)")
    made.add_argument(
        "--contact-sheet", type=Path, metavar="FILE", help="draw one picture of all scenes instead"
    )
    group = made.add_argument_group("settings of the scene; default: those of the scene named")
    for item in declared(SceneConfig):
        words = f"{item.text} {item.describe()[0].upper()}{item.describe()[1:]}."
        option = "--" + item.name.replace("_", "-")
        group.add_argument(option, dest=f"set_{item.name}", metavar="VALUE", help=words.replace("%", "%%"))
    return made


def main(words: list[str] | None = None) -> int:
    """Run the command; the exit code is 2 for wrong input."""
    made = parser()
    options = made.parse_args(words)
    if options.scene is None and not options.contact_sheet:
        made.error("name a scene: " + ", ".join(SCENES))
    return guarded("render_synthetic.py", lambda: draw(options))


def draw(options: argparse.Namespace) -> int:
    """Draw a scene, or the sheet of all."""
    if options.contact_sheet:
        write_sheet(options.contact_sheet)
        return 0
    given = {item.name: (item, getattr(options, f"set_{item.name}")) for item in declared(SceneConfig)}
    changes = {name: item.parse(raw) for name, (item, raw) in given.items() if raw is not None}
    config = scene_config(options.scene, **changes)
    with reporting(f"drawing {options.scene}") as report:
        folder = ensure_scene(config, options.cache, report, parse_whole("--jobs", options.jobs))
    print(folder)
    return 0


def write_sheet(path: Path) -> None:
    """Draw all scenes on one sheet; JPEG or PNG by the name's ending."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, 78] if path.suffix.lower() in (".jpg", ".jpeg") else []
    try:
        written = cv2.imwrite(str(path), contact_sheet(), quality)
    except cv2.error:
        written = False
    if not written:
        raise DataError("the sheet cannot be written here; name a .jpg or .png in a folder that exists", path)


if __name__ == "__main__":
    sys.exit(main())
