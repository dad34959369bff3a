"""Focal length, principal point and baseline in a text of unknown form, for the options of `from_folder`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from fetch.calibrations.values import MAX_SIDE_PX
from fetch.rectification import Size
from fetch.stereo_calibration import UNITS, other_size, usual_units

# A number and a space are matched whole (`(?>…)`, `*+`): if their parts were tried as well, a damaged file
# with a long row of digits, zeros or spaces would take hours.
NUMBER = r"[-+]?(?>\d+\.?\d*|\.\d+)(?:[eE][-+]?\d++)?"
ZERO = r"(?>0\.?0*)"
SPACE = r"[\s,;\[\]]++"  # between the numbers of a matrix
BETWEEN = r"[\"']?\s*+(?:[\[(]\s*+(?P<unit>m|cm|mm|px|pixels?)\s*+[\])])?\s*+[:=>,]?\s*+[\[\"(]?\s*+"
AFTER = r"(?:\s*(?P<after>m|cm|mm|px|pixels?)\b|(?![\w.]))"
NAMES = {
    "fx": r"fx|f_x|fu|focal(?:_?length)?_?x|focal(?:_?length)?|f",
    "fy": r"fy|f_y|fv|focal(?:_?length)?_?y",
    "cx": r"cx|c_x|ppx|cu|pu|u0|px|principal_?point_?x|center_?x",
    "cy": r"cy|c_y|ppy|cv|pv|v0|py|principal_?point_?y|center_?y",
    "baseline": r"(?:stereo_?)?baseline(?:_?(?P<suffix>m|cm|mm))?|base_?line|Stereo\.b|b|base",
    "bf": r"bf",
}
# A camera matrix in one line, as in Middlebury's calib.txt or a printed NumPy array: f 0 cx 0 f cy 0 0 1.
MATRIX = re.compile(
    rf"(?<![\d.])({NUMBER}){SPACE}{ZERO}{SPACE}({NUMBER}){SPACE}{ZERO}{SPACE}({NUMBER}){SPACE}({NUMBER})"
    rf"{SPACE}{ZERO}{SPACE}{ZERO}{SPACE}1"
)

# Names of numbers that both cameras have, also with the camera before or after them: right_cx, cx_r, cx1.
OF_BOTH = {"fx": r"fx|f_x|fu|focal(?:_?length)?_?x", "cx": NAMES["cx"], "cy": NAMES["cy"]}
CAMERA = r"left|right|l|r|cam(?:era)?_?\d?|\d"
SAME_PX = 0.01  # rectified cameras have equal numbers; files round them
DISPARITY_OFFSET = r"doffs?|d_?offsets?|disp(?:arity)?_?off(?:s|sets?)?"
# Sizes of images. MATLAB and NumPy give the height first.
# At most six words before the name, and each text in one way only: longer ones would take too long.
OF_IMAGES = (
    r"(?:(?:left|right|l|r|cam(?:era)?|\d|images?|img|im|frame|colou?r|raw|calib(?:ration)?)[_. ]?){0,6}"
)
PIXELS = r"(?:_?(?:px|pix|pixels))?"
WIDTH = rf"{OF_IMAGES}(?:width|cols|columns|w|nx|x_?res|res(?:olution)?_?x|size_?x){PIXELS}"
HEIGHT = rf"{OF_IMAGES}(?:height|rows|h|ny|y_?res|res(?:olution)?_?y|size_?y){PIXELS}"
PAIR = re.compile(
    rf"(?<![A-Za-z0-9_]){OF_IMAGES}"
    rf"(?:size|resolution|res|shape|dims?|dimensions?|sensor|S(?:_rect)?_\d+){PIXELS}"
    r"(?:\s*[\[(][A-Za-z, ]+[\])])?"
    rf"[\"'\s:=>,({{\[-]*(?P<first>{NUMBER})(?:[\s,;x×*-]+|\s+by\s+)(?P<second>{NUMBER})(?![\w.])",
    re.IGNORECASE,
)
CROSS = re.compile(
    r"(?<![\w.])(?P<first>\d+)\s*[x×*]\s*(?P<second>\d+)(?![\w.])(?!\s*(?:mm|cm|m)\b)", re.IGNORECASE
)
SMALLEST_SIDE_PX = 64  # smaller numbers are rows and columns of matrices and chessboards


@dataclass(frozen=True)
class TextNumbers:
    """Numbers of a camera in a text, pixels; the baseline in `unit`, which is None if nothing tells."""

    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    unit: str | None

    def options(self) -> str:
        """The options of `from_folder` with these numbers; both units if both are possible."""
        numbers = f"--focal {self.fx:.7g} --centre {self.cx:.7g},{self.cy:.7g} --baseline {self.baseline:.6g}"
        units = list(usual_units(self.baseline)) or ["m"]
        if self.unit:
            units = [self.unit]
        if units == ["m"]:
            return numbers
        others = "".join(f" (or --unit {unit})" for unit in units[1:])
        return f"{numbers} --unit {units[0]}{others}"


def numbers_in(text: str) -> TextNumbers | None:
    """The numbers of the first camera in a text, and the baseline; None if one of them is missing."""
    values: dict[str, float] = {}
    unit: str | None = None
    for key, names in NAMES.items():
        pattern = rf"(?<![A-Za-z0-9_])(?:Camera\d?\.)?(?:{names}){BETWEEN}(?P<value>{NUMBER}){AFTER}"
        match = re.search(pattern, text, re.IGNORECASE)
        if match is None:
            continue
        values[key] = float(match["value"])
        if key == "baseline":
            unit = (match["unit"] or match["suffix"] or match["after"] or "").lower() or None
    if not {"fx", "cx", "cy"} <= values.keys():
        found = MATRIX.search(text)
        if found is not None:
            values |= _numbers_of_matrix(found)
    if "baseline" not in values and "bf" in values and values.get("fx", 0.0) > 0:
        values["baseline"] = values["bf"] / values["fx"]  # ORB-SLAM's f times the baseline
        unit = "m"
    if not {"fx", "cx", "cy", "baseline"} <= values.keys() or values["fx"] <= 0 or values["baseline"] == 0:
        return None
    fy = values.get("fy", values["fx"])
    if unit not in UNITS:  # such as px
        unit = None
    return TextNumbers(values["fx"], fy, values["cx"], values["cy"], abs(values["baseline"]), unit)


def _numbers_of_matrix(found: re.Match[str]) -> dict[str, float]:
    """The numbers in a camera matrix, a match of `MATRIX`, by their names."""
    fx, cx, fy, cy = found.groups()
    return {"fx": float(fx), "cx": float(cx), "fy": float(fy), "cy": float(cy)}


def other_size_in(text: str, size: Size) -> str:
    """A sentence if a text names a size of images other than `size`, width and height in pixels; or ""."""
    for pattern in (PAIR, CROSS):
        for match in pattern.finditer(text):
            first = _side(match["first"])
            second = _side(match["second"])
            if first is None or second is None or size in ((first, second), (second, first)):
                continue
            is_height_first = (first < second) != (size[0] < size[1])
            named = (second, first) if is_height_first else (first, second)
            return other_size(named, size)
    widths = [side for side in map(_side, _values(text, WIDTH)) if side is not None]
    heights = [side for side in map(_side, _values(text, HEIGHT)) if side is not None]
    for named in zip(widths, heights, strict=False):  # a text may name only one of them
        if named != size:
            return other_size(named, size)
    for name, values, actual in (("width", widths, size[0]), ("height", heights, size[1])):
        for value in values:
            if value != actual:
                return (
                    f"the calibration is for images of {name} {value}, but these are {size[0]}×{size[1]}: "
                    "use images of the calibration's size or, if they are only scaled, multiply f, cx and cy "
                    f"by {actual / value:.4g}"
                )
    return ""


def differing_cameras(text: str) -> str:
    """What the cameras in a text do not share, as `cx 311.193 and 442.304` or `doffs 131.111`; "" if nothing.

    The options of `from_folder` have one focal length and one principal point for both cameras.
    """
    for value in _values(text, DISPARITY_OFFSET):
        if abs(float(value)) > SAME_PX:
            return f"doffs {float(value):g}"
    matrices = [_numbers_of_matrix(found) for found in MATRIX.finditer(text)]
    for key, names in OF_BOTH.items():
        with_camera = rf"(?:(?:{CAMERA})[_. ]?)?(?:{names})(?:[_. ]?(?:{CAMERA}))?"
        values = [float(value) for value in _values(text, with_camera)]
        values += [matrix[key] for matrix in matrices]
        other = next((value for value in values if abs(value - values[0]) > SAME_PX), None)
        if other is not None:
            return f"{key} {values[0]:g} and {other:g}"
    return ""


def _values(text: str, names: str) -> Iterator[str]:
    """All numbers that stand behind one of these names."""
    pattern = rf"(?<![A-Za-z0-9_])(?:{names}){BETWEEN}(?P<value>{NUMBER}){AFTER}"
    for match in re.finditer(pattern, text, re.IGNORECASE):
        yield match["value"]


def _side(number: str) -> int | None:
    """The side of an image in a number, pixels; None for every other number."""
    value = float(number)
    return int(value) if SMALLEST_SIDE_PX <= value <= MAX_SIDE_PX and value.is_integer() else None
