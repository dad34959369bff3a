"""A run of variant `published` calls no function of variant `kit`; runs read every declared setting."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import HEIGHT, WIDTH, with_box

from vo_lib import open_sequence, run, settings
from vo_lib.config import CONFIG_CLASSES, VARIANTS, change
from vo_lib.runs.run_quality import path_lost

OF_THE_KIT = """
import sys
sys.setprofile(lambda frame, event, _: called.add(frame.f_code.co_filename) if event == "call" else None)
called = set()
from vo_lib import open_sequence, preset, run
for method in ("viso2", "feature_selection"):
    run(open_sequence(sys.argv[1]), preset(method))
sys.setprofile(None)
print(sorted(name for name in sys.modules if name.startswith("vo_lib.kit")))
print(sorted({path.rpartition("kit/")[2] for path in called if "vo_lib/kit/" in path.replace("\\\\", "/")}))
"""


def test_published_run_uses_nothing_of_the_kit(bands: Path) -> None:
    words = [sys.executable, "-c", OF_THE_KIT, str(with_box(bands, 6))]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    assert printed[0] == "['vo_lib.kit', 'vo_lib.kit.settings']"
    # The settings are declared at import.
    assert printed[1] in ("['__init__.py', 'settings.py']", "['settings.py']")


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_setting_is_read(bands: Path, variant: str) -> None:
    for side in ("image_0", "image_1"):
        shutil.copy(bands / side / "000003.png", bands / side / "000004.png")
        cv2.imwrite(str(bands / side / "000005.png"), np.zeros((HEIGHT, WIDTH), np.uint8))
    sequence, read = open_sequence(with_box(bands, 6)), set[str]()
    for config in VARIANTS[variant].values():
        with recorded(config, read):
            run(sequence, config)
    declared = {item.name for item in settings.declared(CONFIG_CLASSES[variant])}
    assert declared - read == set()


@contextmanager
def recorded(config: Any, read: set[str]) -> Iterator[None]:
    """A context that collects the dotted names of all settings that are read from a configuration."""

    def watch(prefix: str) -> Any:
        def getter(self: Any, name: str) -> Any:
            if not name.startswith("_"):
                read.add(prefix + name)
            return object.__getattribute__(self, name)

        return getter

    with pytest.MonkeyPatch.context() as patch:
        for prefix, part in parts(config):
            patch.setattr(type(part), "__getattribute__", watch(prefix), raising=False)
        yield


def parts(config: Any, prefix: str = "") -> list[tuple[str, Any]]:
    """The configuration and its sections, each with the prefix of its settings' names."""
    values = {field.name: getattr(config, field.name) for field in dataclasses.fields(config)}
    sections = [(f"{prefix}{name}.", part) for name, part in values.items() if dataclasses.is_dataclass(part)]
    return [(prefix, config), *(pair for prefix, part in sections for pair in parts(part, prefix))]


def test_eleven_frames_without_motion_are_lost_tracking(bands: Path) -> None:
    config = change(VARIANTS["published"]["solution_selection"], "min_matches", 1000)
    result = run(open_sequence(bands), config)
    assert not any(motion.measured for motion in result.motions)
    for frames, lost in ((10, False), (11, True)):
        longer = dataclasses.replace(result, motions=[result.motions[0]] * frames)
        assert path_lost(longer) == lost
