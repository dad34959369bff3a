"""Focal length, principal point and baseline in a text of unknown form, for the options of `from_folder`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fetch.stereo_calibration import UNITS, usual_units

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
BETWEEN = r"[\"']?\s*(?:[\[(]\s*(?P<unit>m|cm|mm|px|pixels?)\s*[\])])?\s*[:=>,]?\s*[\[\"(]?\s*"
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
    rf"({NUMBER})[\s,;\[\]]+0\.?0*[\s,;\[\]]+({NUMBER})[\s,;\[\]]+0\.?0*[\s,;\[\]]+({NUMBER})[\s,;\[\]]+({NUMBER})"
    r"[\s,;\[\]]+0\.?0*[\s,;\[\]]+0\.?0*[\s,;\[\]]+1"
)


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
        units = [self.unit] if self.unit else list(usual_units(self.baseline)) or ["m"]
        if units == ["m"]:
            return numbers
        return f"{numbers} --unit {units[0]}" + "".join(f" (or --unit {unit})" for unit in units[1:])


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
    if not {"fx", "cx", "cy"} <= values.keys() and (found := MATRIX.search(text)):
        values |= dict(zip(("fx", "cx", "fy", "cy"), map(float, found.groups()), strict=True))
    if "baseline" not in values and "bf" in values and values.get("fx", 0.0) > 0:
        values["baseline"] = values["bf"] / values["fx"]  # ORB-SLAM's f times the baseline
        unit = "m"
    if not {"fx", "cx", "cy", "baseline"} <= values.keys() or values["fx"] <= 0 or values["baseline"] == 0:
        return None
    fy = values.get("fy", values["fx"])
    unit = unit if unit in UNITS else None
    return TextNumbers(values["fx"], fy, values["cx"], values["cy"], abs(values["baseline"]), unit)
