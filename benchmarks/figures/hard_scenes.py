"""The table of ray-traced scenes that are hard to measure."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.figures.pages import stored, table

# Row of `benchmarks.metres`, value, and what the scene is.
SCENES = (
    ("exact", "diameter_m", "nothing hard: exact depth"),
    ("exact", "distance_m", "the same"),
    ("noisy", "diameter_m", "noise of a stereo camera"),
    ("branch", "distance_m", "branch before bark without depth"),
    ("brush", "cut_height_m", "brush around the foot"),
    ("netting", "distance_m", "netting over 30 to 80 %"),
    ("netting", "inclination_deg", "the same"),
    ("smoothed-given", "dbh_m", "depth smoothed over 3 to 11 px"),
    ("ghost-given", "dbh_m", "depth averaged with an older frame"),
    ("beside-given", "dbh_m", "depth 2 to 4 px beside the picture"),
    ("late-ahead", "distance_m", "depth taken up to 0.8 m earlier, driving ahead"),
    ("late-back", "distance_m", "depth taken up to 0.6 m earlier, driving back"),
    ("even-cover", "cut_height_m", "even plants or snow, 12 to 45 cm"),
    ("stated-cover", "cut_height_m", "the same with its height stated"),
    ("second-behind", "diameter_m", "second stem half behind, one mask"),
    ("second-behind", "distance_m", "the same"),
    ("second-beside", "diameter_m", "second stem beside, equally far, one mask"),
    ("second-in-front-keypoints", "distance_m", "second stem in front, in the mask of one behind"),
    ("fork-alone", "diameter_m", "fork, mask without keypoints"),
    ("leaning", "inclination_deg", "thin stems leaning 30 to 48 degrees"),
    ("oval", "diameter_m", "sections with axes of 1.1"),
    ("very-oval", "diameter_m", "sections with axes of 1.3"),
    ("rig-off", "inclination_deg", "depth scale, principal point or vertical off"),
    ("mask-alone", "dbh_m", "a mask alone, the foot in view"),
)
_VALUES = {
    "diameter_m": "diameter",
    "dbh_m": "breast height",
    "cut_height_m": "cut height",
    "distance_m": "distance",
    "inclination_deg": "inclination",
}


def hard_scenes() -> Iterator[str]:
    """What is given, how far off it is, and how often far beyond the stated error."""
    record = stored("metres")
    rows = []
    for scene, quantity, words in SCENES:
        found = record[scene][quantity]
        row = [words, _VALUES[quantity], f"{found['given']} of {found['stems']}"]
        if found["given"]:
            beyond, silent = found["beyond3"], found["beyond3_without_warning"]
            shares = f"{100 * beyond:.0f} ({100 * silent:.0f}) %" if beyond else "0"
            row += [_size(found["rmse"], quantity), f"{100 * found['inside'][3]:.0f} %", shares]
        else:
            row += ["", "", ""]
        rows.append(row)
    return table(["Scene", "Value", "Given", "RMS error", "Inside 95 %", "Beyond 3"], rows)


def _size(error: float, quantity: str) -> str:
    if quantity == "inclination_deg":
        return f"{error:.1f} degrees"
    return f"{error:.2f} m" if quantity == "distance_m" else f"{100 * error:.1f} cm"
