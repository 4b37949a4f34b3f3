"""ZED factory calibration, SNxxxx.conf: a section for each eye and resolution.

The sections hold the lenses of the raw pictures. The pictures and depth of the ZED SDK are
rectified: their cameras follow from both eyes and the section STEREO, and are offered under names
of their own, such as LEFT_CAM_HD_RECTIFIED.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import cv2
import numpy as np

from basetree.arrays import Float
from calib.camera import PinholeCamera
from calib.distortion import FISHEYE, RADTAN
from calib.errors import CameraError
from calib.files.fields import Values, camera, number, tell_choice

_SIZES = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "VGA": (672, 376),
    "FHD1200": (1920, 1200),
    "SVGA": (960, 600),
    "QHDPLUS": (3200, 1800),
    "4K": (3840, 2160),
}
_MOST_TURN_DEG = 20.0  # between the eyes; those of one housing look the same way
_EYES = ("LEFT_", "RIGHT_")
_SECTION = re.compile(r"(?P<eye>LEFT_|RIGHT_|)CAM_(?P<size>\w+)")
_FIVE = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL = (*_FIVE, "k4", "k5", "k6")
_FISHEYE = ("k1", "k2", "k3", "k4")
_PRISM = ("s1", "s2", "s3", "s4")
_REMEDY = "download the factory file again or calibrate with a board"


def find(values: Values) -> dict[str, Values]:
    """Return every eye at every known resolution, and the rectified eyes of every pair."""
    found: dict[str, Values] = {}
    for name, section in values.items():
        match = _SECTION.fullmatch(str(name))
        if match and match["size"].upper() in _SIZES and isinstance(section, Mapping):
            lens_name = f"{match['eye']}DISTO"
            lens = values.get(lens_name)
            found[name] = {
                "section": section,
                "size": match["size"].upper(),
                "lens_name": lens_name,
                "lens": lens if isinstance(lens, Mapping) else {},
            }
    return found | _rectified(found, values.get("STEREO"))


def _rectified(found: Mapping[str, Values], stereo: object) -> dict[str, Values]:
    """Return the rectified eyes of the pairs among the cameras."""
    pairs: dict[str, Values] = {}
    for name in found:
        eyes = [f"{eye}{name.removeprefix(_EYES[0])}" for eye in _EYES]
        whole = name.startswith(_EYES[0]) and eyes[1] in found
        if whole and isinstance(stereo, Mapping) and "baseline" in stereo:
            both = tuple(found[eye] for eye in eyes)
            for index, eye in enumerate(eyes):
                pairs[f"{eye}_RECTIFIED"] = {"eyes": both, "stereo": stereo, "index": index}
    return pairs


def build(values: Values) -> PinholeCamera:
    """Create the camera; the section's name gives the image size.

    Newer files hold two models of the same lens: five terms in each section of a resolution, for
    older programs, and the model of the manufacturer's own software in LEFT_DISTO, RIGHT_DISTO or
    DISTO. The second is used if there is one, and never mixed with the first. Sections without one
    may leave out terms that are 0, except k1 and k2.
    """
    return _rectify(values) if "eyes" in values else _raw(values)


def _rectify(values: Values) -> PinholeCamera:
    """Return the camera of an eye's rectified pictures, as the manufacturer's program does.

    The rotation between the eyes has the rotation vector RX, CV, RZ of the resolution; the zoom
    keeps only pixels that both eyes see.
    """
    eyes, stereo = [_raw(eye) for eye in values["eyes"]], values["stereo"]
    if any(eye.distortion_model == FISHEYE for eye in eyes):
        raise CameraError(
            "the eyes are fisheye lenses: expected radial-tangential ones; take the values of the"
            " rectified camera from the SDK (get_camera_information)"
        )
    size = values["eyes"][0]["size"]
    rotation = [_of_pair(stereo, name, size) for name in ("rx", "cv", "rz")]
    translation = [number(stereo, "baseline"), *(_of_pair(stereo, n, size) for n in ("ty", "tz"))]
    _check_pair(stereo, rotation, translation)
    projections = _stereo_projections(eyes, np.array(rotation), np.array(translation))
    fx, _, cx, _, _, fy, cy, *_ = projections[values["index"]].ravel().tolist()
    found = PinholeCamera(eyes[0].width, eyes[0].height, fx, fy, cx, cy)
    tell_choice(
        f"fx {fx:.1f}, cx {cx:.1f}, cy {cy:.1f} px of the rectified pictures are computed from both"
        " eyes; the SDK tells its own values (get_camera_information)"
    )
    return found


def _check_pair(stereo: Values, rotation: list[float], translation: list[float]) -> None:
    """Check that the eyes stand side by side and look nearly the same way."""
    across, *others = (abs(value) for value in translation)
    if not np.isfinite([*rotation, *translation]).all() or not across > max(others):
        raise CameraError(
            f"STEREO is {dict(stereo)}: expected finite numbers, and a baseline above TY and TZ"
        )
    turn_deg = float(np.degrees(np.linalg.norm(rotation)))
    if turn_deg > _MOST_TURN_DEG:
        raise CameraError(
            f"the eyes are turned by {turn_deg:.3g} degrees (RX, CV and RZ of STEREO): expected at"
            f" most {_MOST_TURN_DEG:g}"
        )


def _stereo_projections(
    eyes: list[PinholeCamera], rotation: Float, translation: Float
) -> tuple[Float, Float]:
    """Return the (3, 4) projection matrices of both rectified eyes."""
    matrices = [np.array([[e.fx, 0, e.cx], [0, e.fy, e.cy], [0, 0, 1]]) for e in eyes]
    terms = [np.array(eye.distortion or (0.0,) * 4) for eye in eyes]
    try:
        _, _, left, right, *_ = cv2.stereoRectify(
            *(matrices[0], terms[0], matrices[1], terms[1]),
            *(
                (eyes[0].width, eyes[0].height),
                cv2.Rodrigues(rotation)[0],
                translation.reshape(3, 1),
            ),
            flags=cv2.CALIB_ZERO_DISPARITY,
            alpha=0,
        )
    except cv2.error as error:
        raise CameraError("the eyes cannot be rectified: expected a pair of cameras") from error
    return np.asarray(left, np.float64), np.asarray(right, np.float64)


def _of_pair(stereo: Values, name: str, size: str) -> float:
    """Return a value of the section STEREO, of the resolution or else of all; 0 if missing."""
    own = f"{name}_{size.lower()}"
    return number({name: 0, **stereo}, own if own in stereo else name)


def _raw(values: Values) -> PinholeCamera:
    """Return the camera of an eye's raw pictures."""
    section = values["section"]
    lens = values["lens"] or section
    name = "the section" if lens is section else values["lens_name"]
    used, model = _model(name, lens)
    required = used[:2] if lens is section else used
    missing = [term for term in required if term not in lens]
    if missing:
        raise CameraError(
            f"{name} has no {', '.join(missing)}: expected k1 to k6, p1 and p2 (radial-tangential)"
            f" or k1 to k4 (fisheye); {_REMEDY}"
        )
    terms = [_term(lens, term) for term in used]
    if not any(terms) and any(_term(section, term) for term in _RATIONAL):
        raise CameraError(
            f"the terms of {name} are 0 and those of the section are not: expected one lens; remove"
            " the wrong terms from the file"
        )
    focal = [number(section, field) for field in ("fx", "fy", "cx", "cy")]
    return camera(_SIZES[values["size"]], focal, terms, model)


def _model(name: str, values: Values) -> tuple[tuple[str, ...], str]:
    """Return the names of the terms that are used, and the model.

    The files do not name the model. As in the manufacturer's calibration program, k3 and k4 without
    p1 and p2 are a fisheye lens, whose other terms are missing or 0.
    """
    prism = [term for term in _PRISM if _term(values, term)]
    if prism:
        raise CameraError(f"{prism[0]} is {values[prism[0]]}: expected no thin prism")
    k4 = _term(values, "k4")
    if not k4 or any(_term(values, term) for term in ("p1", "p2", "k5", "k6")):
        rational = any(_term(values, term) for term in ("k4", "k5", "k6"))
        return (_RATIONAL if rational else _FIVE), RADTAN
    if not _term(values, "k3"):
        raise CameraError(
            f"{name} has k4 {k4:g} without k3, p1, p2, k5 and k6, which is neither a whole fisheye"
            f" lens nor a whole radial-tangential one: expected all terms of one; {_REMEDY}"
        )
    return _FISHEYE, FISHEYE


def _term(values: Values, name: str) -> float:
    return number({name: 0, **values}, name)
