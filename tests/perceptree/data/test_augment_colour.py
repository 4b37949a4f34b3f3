"""Colour augmentation: each change has its effect and leaves the labels alone."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from augmentations import STILL

from perceptree.data import AugmentSettings, Sample, augment
from perceptree.data.augment import PAPER_AUGMENT, VARIED_AUGMENT
from perceptree.models import ModelSpec, make_spec

WIDTH_PX, HEIGHT_PX = 160, 96
SPEC: ModelSpec = make_spec("edge-n", "rgb", HEIGHT_PX, WIDTH_PX)
CHANGES: dict[str, dict[str, Any]] = {
    "shadow": {"shadow": 0.8},
    "vignette": {"vignette": 0.8},
    "saturation": {"saturation": 0.8},
    "hue": {"hue_deg": 90.0},
    "grey": {"grey_share": 1.0},
    "shuffle": {"channel_shuffle_share": 1.0},
    "brightness": {"brightness": 0.5},
    "contrast": {"contrast": 0.5},
    "gamma": {"gamma": 0.5},
    "tint": {"tint": 0.4},
    "curves": {"curves": 0.8},
    "blur": {"blur_px": 3.0},
    "motion": {"motion_blur_px": 9.0},
    "sharpening": {"sharpening": 1.5},
    "cutouts": {"cutouts": 9},
    "noise": {"noise": 9.0},
    "chroma noise": {"chroma_noise": 9.0},
    "jpeg": {"jpeg_share": 1.0},
}


def picture() -> Sample:
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), np.uint8), (5, 5), 1.5)
    image[:, : WIDTH_PX // 2] = (60, 110, 160)
    masks = np.zeros((1, HEIGHT_PX, WIDTH_PX), bool)
    masks[0, 10:80, 60:80] = True
    return Sample(image, np.array([[60.0, 10, 80, 80]]), np.ones((1, 5, 3)), masks)


def coloured(seed: int, **settings: Any) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return augment(rng, picture(), SPEC, replace(STILL, **settings)).image


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_affects_the_image_alone_and_follows_the_seed(name: str) -> None:
    settings, before = replace(STILL, **CHANGES[name]), picture()
    changed = 0
    for seed in range(8):
        first, again = (
            augment(np.random.default_rng(seed), picture(), SPEC, settings) for _ in range(2)
        )
        assert (first.image == again.image).all()
        assert first.image.dtype == np.uint8
        changed += bool((first.image != before.image).any())
        for label in ("boxes", "keypoints", "masks"):
            assert (getattr(first, label) == getattr(before, label)).all()
    assert changed >= 5
    others = [coloured(seed, **CHANGES[name]) for seed in range(8)]
    if name != "grey":
        assert any((others[0] != other).any() for other in others[1:])


def test_a_share_of_0_turns_a_group_of_changes_off() -> None:
    strong = {key: value for change in CHANGES.values() for key, value in change.items()}
    off = {name: 0 for name in strong if name.endswith("_share")}
    kept = ("shadow", "vignette", "hue_deg", "cutouts")
    groups = dict.fromkeys(("tone_share", "saturation_share", "blur_share", "noise_share"), 0.0)
    settings = strong | off | groups | dict.fromkeys(kept, 0)
    assert (coloured(1, **settings) == picture().image).all()


def test_grey_images_have_no_colour_and_keep_their_luma() -> None:
    image = coloured(0, grey_share=1.0).astype(int)
    assert np.ptp(image, axis=2).max() <= 1
    luma = cv2.cvtColor(picture().image, cv2.COLOR_BGR2GRAY)
    assert np.abs(image[..., 0] - luma).max() <= 1


def test_hue_rotation_keeps_the_luma() -> None:
    before = picture().image[50, 10]
    lumas = np.array([0.114, 0.587, 0.299])
    turned = [coloured(seed, hue_deg=40.0)[50, 10].astype(int) for seed in range(5)]
    assert np.abs(turned @ lumas - before @ lumas).max() < 1.5
    assert np.ptp(turned, axis=0).max() > 15


def test_channels_are_permuted() -> None:
    before = sorted(picture().image.reshape(-1, 3).astype(int).sum(0).tolist())
    orders = set()
    for seed in range(12):
        image = coloured(seed, channel_shuffle_share=1.0)
        assert sorted(image.reshape(-1, 3).astype(int).sum(0).tolist()) == before
        orders.add(tuple(image[50, 10].tolist()))
    assert len(orders) > 3


def test_tone_curves_increase_from_black_to_white() -> None:
    ramp = np.repeat(np.tile(np.linspace(0, 255, WIDTH_PX), (HEIGHT_PX, 1))[..., None], 3, 2)
    for seed in range(10):
        sample = replace(picture(), image=ramp.astype(np.uint8))
        rng = np.random.default_rng(seed)
        image = augment(rng, sample, SPEC, replace(STILL, curves=1.0)).image[0].astype(int)
        assert (np.diff(image, axis=0) >= 0).all()
        assert image[0].tolist() == [0, 0, 0]
        assert image[-1].tolist() == [255, 255, 255]


def test_vignetting_darkens_the_corners_only() -> None:
    grey = replace(picture(), image=np.full((HEIGHT_PX, WIDTH_PX, 3), 200, np.uint8))
    for seed in range(5):
        rng = np.random.default_rng(seed)
        image = augment(rng, grey, SPEC, replace(STILL, vignette=0.9)).image
        assert (image <= 200).all()
        assert image[0, 0, 0] <= image[HEIGHT_PX // 4, WIDTH_PX // 4, 0] <= image[48, 80, 0]
        assert image[48, 80, 0] > 190


def test_noise_has_zero_mean_and_the_drawn_standard_deviation() -> None:
    flat = replace(picture(), image=np.full((HEIGHT_PX, WIDTH_PX, 3), 128, np.uint8))
    deviations = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = augment(rng, flat, SPEC, replace(STILL, noise=10.0)).image.astype(float) - 128
        assert abs(noise.mean()) < 0.3
        deviations.append(noise.std())
    assert max(deviations) < 10.3
    assert 4 < np.mean(deviations) < 6


def test_a_blur_smooths_and_sharpening_does_not() -> None:
    def roughness(image: np.ndarray) -> float:
        return float(np.abs(np.diff(image[:, 90:].astype(float), axis=0)).mean())

    before = roughness(picture().image)
    for seed in range(5):
        assert roughness(coloured(seed, blur_px=4.0)) <= before
        assert roughness(coloured(seed, motion_blur_px=12.0)) <= before
        assert roughness(coloured(seed, sharpening=2.0)) >= before
    # A motion blur does not change a uniform area.
    assert (coloured(1, motion_blur_px=12.0)[30:60, 20:50] == (60, 110, 160)).all()


def test_the_papers_changes_have_their_shares() -> None:
    still = replace(
        PAPER_AUGMENT,
        flip_share=0,
        scale=(1, 1),
        crop_share=0,
        rotation_deg=0,
        shear_deg=0,
        perspective_share=0,
    )
    same = sum(
        (
            augment(np.random.default_rng(seed), picture(), SPEC, still).image == picture().image
        ).all()
        for seed in range(200)
    )
    assert 25 < same < 70  # 0.7 * 0.7 * 0.7 * 0.6, a fifth of the frames


def test_contrast_and_colourfulness_vary_more_in_varied_frames() -> None:
    still = {"flip_share": 0, "scale": (1, 1), "rotation_deg": 0, "perspective_share": 0}

    def spread(settings: AugmentSettings) -> np.ndarray:
        rows = []
        for seed in range(150):
            rng = np.random.default_rng(seed)
            image = augment(rng, picture(), SPEC, replace(settings, **still)).image.astype(float)
            rows.append([image.std(), np.ptp(image, axis=2).mean()])
        return np.array(rows).std(0)

    usual, varied = spread(AugmentSettings()), spread(VARIED_AUGMENT)
    assert (varied > 1.05 * usual).all(), (usual, varied)
