"""Strengths of the augmentations: frozen, validated settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import UNORDERED, Settings, limits
from perceptree.settings.cameras import CameraSettings

_SHARE = limits(0, 1)
_COUNT = limits(0, whole=True)
_LEVELS = limits(0, 40)
_ANY = limits(0)
_ASCENDING = limits(over=0, expected="0 < minimum <= maximum")
_QUALITIES = limits(over=0, most=100, expected="0 < minimum <= maximum <= 100")
_SIDES = limits(over=0, most=1, expected="two shares over 0, at most 1") | UNORDERED


@dataclass(frozen=True)
class GeometrySettings(Settings):
    """Geometric changes of image and labels."""

    flip_share: float = field(default=0.5, metadata=_SHARE)
    """Share of the frames that are mirrored horizontally."""
    scale: tuple[float, float] = field(default=(0.8, 1.4), metadata=_ASCENDING)
    """Minimum and maximum scale, drawn uniformly in its logarithm. A smaller frame stays inside the
    image, a larger one covers it."""
    crop_share: float = field(default=0.0, metadata=_SHARE)
    """Share of the frames that are cropped to a window first."""
    crop: tuple[float, float] = field(default=(0.5625, 1.0), metadata=_SIDES)
    """Width and height of that window as shares of the image. The window is enlarged to fit, and
    the rest of the image is padded."""
    rotation_deg: float = field(default=0.0, metadata=limits(0, 15))
    """Maximum rotation in either direction, about the centre; limited so that left stays left."""
    shear_deg: float = field(default=0.0, metadata=limits(0, 15))
    """Maximum shear in either direction, along rows, about the centre."""
    perspective_share: float = field(default=1.0, metadata=_SHARE)
    """Share of the frames to which `perspective` applies."""
    perspective: float = field(default=0.0, metadata=limits(0, 0.15))
    """Each corner is moved inwards by up to this share of the sides; the area between the corners
    is stretched to fill the image."""


@dataclass(frozen=True)
class ColourSettings(Settings):
    """Changes of RGB frames, applied in this order."""

    shadow: float = field(default=0.0, metadata=limits(0, 2))
    """Maximum log gain of a smooth field of shadows and bright patches."""
    vignette: float = field(default=0.0, metadata=_SHARE)
    """Maximum darkening of the corners, as a share."""
    saturation_share: float = field(default=1.0, metadata=_SHARE)
    """Share of the frames to which `saturation` applies."""
    saturation: float = field(default=0.6, metadata=_SHARE)
    """Maximum loss of saturation, as a share; the maximum gain is half of it."""
    hue_deg: float = field(default=0.0, metadata=limits(0, 180))
    """Maximum rotation of the hue in either direction."""
    grey_share: float = field(default=0.0, metadata=_SHARE)
    """Share of the frames that are turned to grey."""
    channel_shuffle_share: float = field(default=0.0, metadata=_SHARE)
    """Share of the frames whose channels are permuted."""
    tone_share: float = field(default=1.0, metadata=_SHARE)
    """Share of the frames to which `brightness`, `contrast`, `gamma`, `tint` and `curves`
    apply."""
    brightness: float = field(default=0.35, metadata=_ANY)
    """Maximum log gain in either direction."""
    contrast: float = field(default=0.3, metadata=_ANY)
    """Maximum log contrast in either direction, about 0.4 of full scale."""
    gamma: float = field(default=0.3, metadata=_ANY)
    """Maximum log gamma in either direction."""
    tint: float = field(default=0.12, metadata=_ANY)
    """Maximum log gain of each channel, drawn independently."""
    curves: float = field(default=0.0, metadata=_SHARE)
    """Maximum standard deviation of the log slope of each channel's tone curve; the curves are
    increasing."""
    blur_share: float = field(default=1.0, metadata=_SHARE)
    """Share of the frames to which one of `blur_px`, `motion_blur_px` and `sharpening`
    applies, drawn from those that are not 0."""
    blur_px: float = field(default=0.0, metadata=limits(0, 20))
    """Maximum standard deviation of a Gaussian blur."""
    motion_blur_px: float = field(default=0.0, metadata=limits(0, 50))
    """Maximum length of a straight motion blur, in any direction."""
    sharpening: float = field(default=0.0, metadata=_ANY)
    """Maximum gain of an unsharp mask with a standard deviation of 1 px."""
    cutouts: int = field(default=0, metadata=_COUNT)
    """Maximum number of single-coloured patches, like dirt on the lens; their sides are up to a
    tenth of the image's height. Labels do not change."""
    noise_share: float = field(default=1.0, metadata=_SHARE)
    """Share of the frames to which `noise` and `chroma_noise` apply."""
    noise: float = field(default=8.0, metadata=_LEVELS)
    """Maximum standard deviation of independent pixel noise, in levels of 255."""
    chroma_noise: float = field(default=0.0, metadata=_LEVELS)
    """Maximum standard deviation of colour noise in patches of 4 px, in levels of 255."""
    jpeg_share: float = field(default=0.0, metadata=_SHARE)
    """Share of the frames that are compressed as JPEG."""
    jpeg_quality: tuple[float, float] = field(default=(30, 95), metadata=_QUALITIES)
    """Minimum and maximum JPEG quality, on libjpeg's scale."""


@dataclass(frozen=True)
class DepthSettings(Settings):
    """Faults of a depth sensor, applied in this order.

    Trees that lose more than nine tenths of their readings are removed.
    """

    depth_gain: float = field(default=0.02, metadata=limits(0, 0.5))
    """Maximum scale error, as a share."""
    depth_noise: float = field(default=2.0, metadata=_LEVELS)
    """Maximum standard deviation of noise independent of distance, in levels of 255."""
    far_noise_m: float = field(default=0.0, metadata=_ANY)
    """Maximum standard deviation at 10 m of noise that grows with the square of the distance."""
    far_step_m: float = field(default=0.0, metadata=_ANY)
    """Maximum step between readings at 10 m. Steps are uniform in disparity, so they grow with the
    square of the distance."""
    range_loss: float = field(default=0.0, metadata=limits(0, 0.9))
    """Maximum share of the encoding's range, at its far end, without readings."""
    stereo_px_m: float = field(default=0.0, metadata=_ANY)
    """Maximum focal length in px times baseline in m of a stereo camera. Left of near objects is a
    strip without readings that the right camera cannot see, as wide as the step of disparity."""
    edge_loss_px: int = field(default=0, metadata=limits(0, 10, whole=True))
    """Maximum width of missing readings on each side of a depth edge; in patches."""
    hole_area: float = field(default=0.0, metadata=limits(0, 0.5))
    """Maximum share of the image that is lost to irregular holes."""
    holes: int = field(default=6, metadata=_COUNT)
    """Maximum number of rectangular holes with sides of up to 25 px."""


@dataclass(frozen=True)
class PairSettings(Settings):
    """What happens between colour and depth, for models of both.

    Trees stay labelled while one of the two shows them.
    """

    misaligned_px: float = field(default=4.0, metadata=limits(0, 32))
    """Maximum distance by which the colour image is moved against depth and labels, px."""
    misaligned_share: float = field(default=0.5, metadata=_SHARE)
    """Share of the frames to which `misaligned_px` applies."""
    without_colour_share: float = field(default=0.15, metadata=_SHARE)
    """Share of the frames whose colour image is left out."""
    without_depth_share: float = field(default=0.15, metadata=_SHARE)
    """Share of the frames whose depth is left out; never with the colour image."""

    def _check_together(self) -> None:
        super()._check_together()
        left_out = self.without_colour_share + self.without_depth_share
        if left_out > 1:
            self._refuse(
                f"without_colour_share and without_depth_share are together {left_out:g}",
                "at most 1",
            )


@dataclass(frozen=True)
class AugmentSettings(
    GeometrySettings, ColourSettings, DepthSettings, CameraSettings, PairSettings
):
    """Strengths of all changes; each change is drawn anew and uniformly for every frame.

    Colours change for RGB models, readings for depth models. 0 turns a change off.
    """

    copy_paste_share: float = field(default=0.0, metadata=_SHARE)
    """Share of the frames that receive one to three trees of another frame; needs masks."""


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
"""The augmentation of the paper's training, after `albumentations_mapper` in
`train_synth_RGB.py` of github.com/norlab-ulaval/PercepTreeV1 and the paper's text.

From the script, with the share of frames: horizontal flip (0.5), crops of 720x720 px of 1280x720
(1.0), brightness and contrast (0.3), sensor noise and ISO noise (0.2 each), glass blur (0.1),
motion blur up to 7 px (0.2), saturation (0.3), perspective (0.2). Differences:

- The paper's text also names resizing, shear and rotation, without strengths; the script has none
  of them. The strengths here are our choice.
- A crop is resized to fit the model's input, which has a fixed size. If the input has the frames'
  height, the scale does not change, as in the script.
- Brightness and contrast are log gains of up to 0.1 and 0.2 in either direction; in the script, an
  offset of up to 0.1 and a contrast of -0.1 to 0.3.
- Saturation changes by up to 0.25, the number in the script. The script's library reads it as 0.25
  of 255 levels, which has no visible effect.
- Perspective moves the corners uniformly by up to 0.12 of the sides; in the script, normally
  distributed with the same mean.
- Glass blur is replaced by Gaussian blur, ISO noise by colour noise in patches. A blurred frame
  gets one of the two blurs, a noisy frame both kinds of noise.
- A tree is removed if less than a quarter of it remains; in the script, less than a tenth of its
  box.
- Depth frames get the geometric changes only. The paper does not describe the augmentation of its
  depth models.
"""

VARIED_AUGMENT = AugmentSettings(
    scale=(0.75, 1.6),
    rotation_deg=5.0,
    perspective_share=0.2,
    perspective=0.06,
    shadow=0.45,
    vignette=0.4,
    saturation=0.8,
    hue_deg=8.0,
    grey_share=0.05,
    brightness=0.4,
    contrast=0.35,
    curves=0.2,
    blur_share=0.4,
    blur_px=1.2,
    motion_blur_px=5.0,
    sharpening=1.5,
    noise_share=0.5,
    chroma_noise=6.0,
    jpeg_share=0.5,
)
"""Stronger changes for RGB models that will see real cameras: light, tone, colour, sharpness and
compression vary more than in simulated frames, as between cameras and their settings.
"""
