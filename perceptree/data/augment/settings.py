"""What may change in a training frame, and how strongly: frozen, checked settings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from perceptree.errors import SettingsError


def _up_to(default: float, most: float = math.inf) -> Any:
    """A field from 0 to ``most``."""
    return field(default=default, metadata={"most": most})


def _pair(least: float, most: float, limit: float = math.inf) -> Any:
    """A field of two numbers over 0, the second not smaller, none above ``limit``."""
    return field(default=(least, most), metadata={"limit": limit})


def _sides(width: float, height: float) -> Any:
    """A field of two shares of a picture's sides."""
    return field(default=(width, height), metadata={"sides": True})


class _Checked:
    def __post_init__(self) -> None:
        for entry in fields(self):  # type: ignore[arg-type]
            value = getattr(self, entry.name)
            expected = _complaint(value, entry.metadata, whole=entry.type == "int")
            if expected:
                raise SettingsError(f"{entry.name} is {value}: expected {expected}")


def _complaint(value: Any, rules: Any, whole: bool) -> str:
    """What a value should have been; empty where it is so."""
    if "most" in rules:
        fits = math.isfinite(value) and 0 <= value <= rules["most"]
        top = f"0 to {rules['most']:g}" if math.isfinite(rules["most"]) else "at least 0"
        if whole and not isinstance(value, int):
            return f"a whole number, {top}"
        return "" if fits else top
    if "sides" in rules:
        fits = all(0 < share <= 1 for share in value)
        return "" if fits else "two shares over 0, at most 1"
    limit = rules["limit"]
    top = f" <= {limit:g}" if math.isfinite(limit) else ""
    fits = all(math.isfinite(bound) for bound in value) and 0 < value[0] <= value[1] <= limit
    return "" if fits else f"0 < least <= most{top}"


@dataclass(frozen=True)
class GeometrySettings(_Checked):
    """Where the parts of a frame come to lie; the labels go with them."""

    flip_share: float = _up_to(0.5, 1)
    """Share of the frames that are mirrored left and right."""
    scale: tuple[float, float] = _pair(0.8, 1.4)
    """Least and most scale, drawn evenly in its logarithm. A smaller frame stays inside the
    picture, a larger one covers it."""
    crop_share: float = _up_to(0.0, 1)
    """Share of the frames of which a window is cut out first."""
    crop: tuple[float, float] = _sides(0.5625, 1.0)
    """Width and height of that window as shares of the picture. It is made as large as fits, and
    what remains of the picture is padded."""
    rotation_deg: float = _up_to(0.0, 15)
    """Most rotation to either side, about the centre; small enough that left stays left."""
    shear_deg: float = _up_to(0.0, 15)
    """Most shear to either side, along rows, about the centre."""
    perspective_share: float = _up_to(1.0, 1)
    """Share of the frames that ``perspective`` changes."""
    perspective: float = _up_to(0.0, 0.15)
    """The corners are moved inwards by up to this share of the sides, each on its
    own, and what lies between them fills the picture."""


@dataclass(frozen=True)
class ColourSettings(_Checked):
    """What happens to the colours of an RGB frame, group by group in this order."""

    shadow: float = _up_to(0.0, 2)
    """Most strength of a smooth field of shadows and patches of light, as a logarithm of its
    gain."""
    vignette: float = _up_to(0.0, 1)
    """Most darkening of the corners, as a share."""
    saturation_share: float = _up_to(1.0, 1)
    """Share of the frames that ``saturation`` changes."""
    saturation: float = _up_to(0.6, 1)
    """Most loss of saturation; half of it is the most gain."""
    hue_deg: float = _up_to(0.0, 180)
    """Most turn of the hues to either side."""
    grey_share: float = _up_to(0.0, 1)
    """Share of the frames that lose their colours."""
    channel_shuffle_share: float = _up_to(0.0, 1)
    """Share of the frames whose channels change places."""
    tone_share: float = _up_to(1.0, 1)
    """Share of the frames that ``brightness``, ``contrast``, ``gamma``, ``tint`` and ``curves``
    change."""
    brightness: float = _up_to(0.35)
    """Most gain up or down, as a logarithm."""
    contrast: float = _up_to(0.3)
    """Most contrast up or down, about 0.4 of full scale, as a logarithm."""
    gamma: float = _up_to(0.3)
    """Most gamma up or down, as a logarithm."""
    tint: float = _up_to(0.12)
    """Most gain of each channel on its own, as a logarithm."""
    curves: float = _up_to(0.0, 1)
    """Most deviation of the slope of each channel's tone curve, as a logarithm; the curves rise
    everywhere."""
    blur_share: float = _up_to(1.0, 1)
    """Share of the frames that one of ``blur_px``, ``motion_blur_px`` and ``sharpening`` changes,
    those that are on in turn."""
    blur_px: float = _up_to(0.0, 20)
    """Most standard deviation of a normal blur."""
    motion_blur_px: float = _up_to(0.0, 50)
    """Most length of a straight motion blur, in any direction."""
    sharpening: float = _up_to(0.0)
    """Most gain of what a blur of 1 px takes away."""
    cutouts: int = _up_to(0)
    """Most patches of one colour, as dirt on a lens makes them: up to a tenth of the picture's
    height each way. Labels stay as they are."""
    noise_share: float = _up_to(1.0, 1)
    """Share of the frames that ``noise`` and ``chroma_noise`` change."""
    noise: float = _up_to(8.0, 40)
    """Most standard deviation of noise, drawn for each pixel and channel, in levels of 255."""
    chroma_noise: float = _up_to(0.0, 40)
    """Most standard deviation of colour noise in patches of about 4 px, in levels of 255."""
    jpeg_share: float = _up_to(0.0, 1)
    """Share of the frames that are compressed as JPEG."""
    jpeg_quality: tuple[float, float] = _pair(30, 95, 100)
    """Least and most quality of that, as libjpeg counts."""


@dataclass(frozen=True)
class DepthSettings(_Checked):
    """What a depth sensor does to its readings, in this order.

    Trees that lose more than nine tenths of their readings are dropped.
    """

    depth_gain: float = _up_to(0.02, 0.5)
    """Most error of scale, as a share."""
    depth_noise: float = _up_to(2.0, 40)
    """Most standard deviation of noise that is the same at every distance, in levels of 255."""
    far_noise_m: float = _up_to(0.0)
    """Most standard deviation, at 10 m, of noise that grows with the square of the distance."""
    far_step_m: float = _up_to(0.0)
    """Most step between readings at 10 m; steps are even in disparity, so that they too grow with
    the square of the distance."""
    range_loss: float = _up_to(0.0, 0.9)
    """Most share of the encoding's range, from its far end, without readings."""
    stereo_px_m: float = _up_to(0.0)
    """Most focal length in px times baseline in m. Left of near things, the second camera does not
    see what the first sees: a strip without readings, as wide as the step of disparity."""
    edge_loss_px: int = _up_to(0, 10)
    """Most width of missing readings to each side of a step in depth; in patches."""
    hole_area: float = _up_to(0.0, 0.5)
    """Most share of the picture that is lost to holes of irregular shape."""
    holes: int = _up_to(6)
    """Most number of rectangular holes of up to 25 px each way."""


@dataclass(frozen=True)
class AugmentSettings(GeometrySettings, ColourSettings, DepthSettings):
    """How strong the changes are; each is drawn anew, and evenly, for every frame.

    Colours change where the model sees RGB, readings where it sees depth. 0 turns a change off.
    """

    copy_paste_share: float = _up_to(0.0, 1)
    """Share of the frames that get one to three trees of another frame; needs masks."""


PAPER_AUGMENT = AugmentSettings(
    flip_share=0.5,
    scale=(0.8, 1.25),
    crop_share=1.0,
    crop=(0.5625, 1.0),
    rotation_deg=5.0,
    shear_deg=5.0,
    perspective_share=0.2,
    perspective=0.12,
    saturation_share=0.3,
    saturation=0.25,
    tone_share=0.3,
    brightness=0.1,
    contrast=0.2,
    gamma=0.0,
    tint=0.0,
    blur_share=0.3,
    blur_px=1.0,
    motion_blur_px=7.0,
    noise_share=0.4,
    noise=7.0,
    chroma_noise=7.0,
    depth_gain=0.0,
    depth_noise=0.0,
    holes=0,
)
"""The augmentation of the paper's training, after ``albumentations_mapper`` in
``train_synth_RGB.py`` of github.com/norlab-ulaval/PercepTreeV1 and the paper's text.

From the script: mirroring (half of the frames), windows of 720x720 px of 1280x720 (all), brightness
and contrast (0.3), noise as of a sensor and of high ISO (0.2 each), blur by glass (0.1) and by
motion up to 7 px (0.2), saturation (0.3), perspective (0.2). What differs:

- The paper's text also names resizing, shear and rotation, without their strengths; the script has
  none of them. Theirs here are chosen.
- A window is fitted into the model's input, which is always of one size. Where the input has the
  frames' height it keeps its scale, as there.
- Brightness and contrast are gains of up to 0.1 and 0.2 up or down; there, an offset of up to 0.1
  and a contrast of -0.1 to 0.3.
- Saturation changes by up to 0.25, the share that the script writes. Its library reads that as a
  quarter of one of 255 levels, which changes nothing.
- Perspective moves the corners evenly by up to 0.12 of the sides, on average as far as there, where
  it is normal.
- Glass blur is a normal one, and ISO noise is noise of colour in patches; with each frame that is
  to be blurred one of the two blurs is drawn, and noise has both kinds.
- A tree is dropped when less than a quarter of it is left; there, a tenth of its box.
- Frames of depth get its geometry only. The paper does not say what its depth models were given.
"""
