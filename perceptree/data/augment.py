"""Random changes of a training frame that leave its labels true."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perceptree.data.frames import Sample
from perceptree.errors import SettingsError
from perceptree.models import KEYPOINT_FLIP_PAIRS, ModelSpec

Float = NDArray[np.floating[Any]]

_LEAST_PIXELS = 25
_LEAST_SHARE = 0.25


@dataclass(frozen=True)
class AugmentSettings:
    """How strong the changes are; each is drawn anew for every frame."""

    flip_share: float = 0.5
    scale: tuple[float, float] = (0.8, 1.4)
    brightness: float = 0.35
    contrast: float = 0.3
    saturation: float = 0.6
    tint: float = 0.12
    noise: float = 8.0
    depth_gain: float = 0.02
    depth_noise: float = 2.0
    holes: int = 6

    def __post_init__(self) -> None:
        if not 0 <= self.flip_share <= 1:
            raise SettingsError(f"flip_share is {self.flip_share}: expected 0 to 1")
        if not 0 < self.scale[0] <= self.scale[1]:
            raise SettingsError(f"scale is {self.scale}: expected 0 < least <= most")
        for name in ("brightness", "contrast", "saturation", "tint", "noise", "depth_gain",
                     "depth_noise", "holes"):  # fmt: skip
            if getattr(self, name) < 0:
                raise SettingsError(f"{name} is {getattr(self, name)}: expected at least 0")


def augment(
    rng: np.random.Generator, sample: Sample, spec: ModelSpec, settings: AugmentSettings
) -> Sample:
    """Flip, scale and shift, then colours or depth readings; trees cut away are dropped."""
    if rng.random() < settings.flip_share:
        sample = flip(sample)
    sample = _scale_and_shift(rng, sample, spec.pad_value, settings.scale)
    if spec.modality == "rgb":
        image = _recolour(rng, sample.image, settings)
    else:
        image = _disturb_depth(rng, sample.image, spec.pad_value, settings)
    return Sample(image, sample.boxes, sample.keypoints, sample.masks)


def flip(sample: Sample) -> Sample:
    """Mirror left and right; the left and right diameter keypoints change places."""
    width = sample.image.shape[1]
    boxes = sample.boxes.copy()
    boxes[:, [0, 2]] = width - sample.boxes[:, [2, 0]]
    keypoints = sample.keypoints.copy()
    labelled = keypoints[..., 2] > 0
    keypoints[..., 0] = np.where(labelled, width - keypoints[..., 0], keypoints[..., 0])
    for left, right in KEYPOINT_FLIP_PAIRS:
        keypoints[:, [left, right]] = keypoints[:, [right, left]]
    masks = np.empty_like(sample.masks)
    for row, mask in enumerate(sample.masks):
        masks[row] = cv2.flip(mask.view(np.uint8), 1)
    return Sample(np.asarray(cv2.flip(sample.image, 1), np.uint8), boxes, keypoints, masks)


def _scale_and_shift(
    rng: np.random.Generator, sample: Sample, pad_value: int, scales: tuple[float, float]
) -> Sample:
    height, width = sample.image.shape[:2]
    scale = float(np.exp(rng.uniform(*np.log(scales))))
    # The frame stays inside the picture when it shrinks, and covers it when it grows.
    slack = np.array([width, height]) * (1 - scale)
    shift = rng.uniform(0, 1, 2) * slack
    # Corner-based x' = s x + t is s x + t + (s - 1) / 2 on OpenCV's pixel centres.
    offset = shift + (scale - 1) / 2
    matrix = np.array([[scale, 0, offset[0]], [0, scale, offset[1]]])
    border = (pad_value,) * 3
    image = cv2.warpAffine(
        sample.image, matrix, (width, height), flags=cv2.INTER_LINEAR, borderValue=border
    )
    masks = np.zeros_like(sample.masks)
    boxes: list[list[int]] = []
    kept: list[int] = []
    for row, mask in enumerate(sample.masks):
        warped = cv2.warpAffine(
            mask.astype(np.uint8), matrix, (width, height), flags=cv2.INTER_NEAREST
        ).astype(bool)
        pixels = int(warped.sum())
        if pixels < max(_LEAST_PIXELS, _LEAST_SHARE * mask.sum() * scale**2):
            continue
        columns, rows = np.nonzero(warped.any(0))[0], np.nonzero(warped.any(1))[0]
        boxes.append([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
        masks[len(kept)] = warped
        kept.append(row)
    keypoints = sample.keypoints[kept].copy()
    keypoints[..., :2] = keypoints[..., :2] * scale + shift
    inside = (keypoints[..., :2] >= 0).all(-1) & (keypoints[..., :2] < (width, height)).all(-1)
    keypoints[~inside] = 0.0
    return Sample(
        np.asarray(image, np.uint8), np.array(boxes, float).reshape(-1, 4), keypoints,
        masks[: len(kept)],
    )  # fmt: skip


def _recolour(
    rng: np.random.Generator, image: NDArray[np.uint8], settings: AugmentSettings
) -> NDArray[np.uint8]:
    """Saturation, then per channel gain, contrast and gamma by one look-up table, then noise."""
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    keep = 1 + rng.uniform(-settings.saturation, 0.5 * settings.saturation)
    mixed = cv2.addWeighted(image, keep, grey, 1 - keep, 0)
    level = np.arange(256, dtype=np.float64)[:, None] / 255
    gain = np.exp(rng.uniform(-settings.brightness, settings.brightness))
    gains = gain * np.exp(rng.uniform(-settings.tint, settings.tint, 3))
    contrast = np.exp(rng.uniform(-settings.contrast, settings.contrast))
    gamma = np.exp(rng.uniform(-settings.contrast, settings.contrast))
    table = ((level**gamma * gains) - 0.4) * contrast + 0.4
    table8 = np.clip(table * 255, 0, 255).astype(np.uint8)[None]
    toned = cv2.LUT(mixed, table8)
    noise = _normal(rng, image.shape, float(rng.uniform(0, settings.noise)))
    return np.asarray(cv2.add(toned, noise, dtype=cv2.CV_8U), np.uint8)


def _normal(
    rng: np.random.Generator, shape: tuple[int, ...], deviation: float
) -> NDArray[np.int16]:
    """Rounded normal noise; OpenCV draws it ten times as fast as numpy, from a seed of ``rng``."""
    noise = np.empty(shape, np.int16)
    cv2.setRNGSeed(int(rng.integers(2**31)))
    zero, spread = np.zeros((4, 1)), np.full((4, 1), deviation)
    cv2.randn(noise, zero, spread)
    return noise


def _disturb_depth(
    rng: np.random.Generator, image: NDArray[np.uint8], invalid: int, settings: AugmentSettings
) -> NDArray[np.uint8]:
    """A small gain, noise on readings, and patches without any."""
    gain = 1 + rng.uniform(-settings.depth_gain, settings.depth_gain)
    noise = _normal(rng, image.shape, float(rng.uniform(0, settings.depth_noise)))
    noisy = cv2.add(cv2.convertScaleAbs(image, alpha=gain), noise, dtype=cv2.CV_8U)
    disturbed = np.where(image == invalid, image, noisy)
    height, width = image.shape
    for _ in range(int(rng.integers(settings.holes + 1))):
        x, y = rng.integers(width), rng.integers(height)
        w, h = rng.integers(2, 26), rng.integers(2, 26)
        disturbed[y : y + h, x : x + w] = invalid
    return np.asarray(disturbed, np.uint8)
