"""``synth --textures``: photographs on materials, and nothing but colours changes."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from basetree.errors import SettingsError
from perceptree.errors import DatasetError
from perceptree.simulator.dataset import generate
from perceptree.simulator.dataset.frames import Assets, simulate_frames
from perceptree.simulator.dataset.generate import generate_dataset
from perceptree.simulator.dataset.plan import settings_sha256
from perceptree.simulator.dataset.scene_job import draw_scene
from perceptree.simulator.labelling.annotate import frame_record
from perceptree.simulator.materials.layers import SIZE_PX, Layer
from perceptree.simulator.materials.textures import layer_texels
from perceptree.simulator.photographs.checking import check_photographs
from perceptree.simulator.photographs.choice import panoramas, photographs_for
from perceptree.simulator.photographs.dressing import dress, mean_colour
from perceptree.simulator.photographs.folder import (
    PhotoFolder,
    dataset_credits,
    open_photographs,
    with_photographs,
)
from perceptree.simulator.photographs.loading import (
    Material,
    load_cutout,
    load_material,
    seam_ratio,
    slope_of,
)
from perceptree.simulator.photographs.panoramas import load_panorama
from perceptree.simulator.photographs.variants import foliage_layer, material_layer
from perceptree.simulator.settings import (
    CameraSettings,
    PhotographSettings,
    SimulatorSettings,
    SplitSettings,
)
from perceptree.simulator.settings.files import FileSettings
from perceptree.simulator.settings.presets import PRESETS

Result = tuple[int, str, str]
Call = Callable[..., Result]
SMALL = ("--frames", 6, "--width", 128, "--height", 72, "--views", 2)
MEAN = np.array([0.12, 0.1, 0.07])


def waves(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """A coloured pattern that wraps around."""
    rng = np.random.default_rng(seed)
    y, x = np.meshgrid(*(np.arange(n) * 2 * np.pi / n for n in shape), indexing="ij")
    tones = [
        sum(np.sin(rng.integers(1, 9) * x + rng.integers(1, 9) * y + seed) for _ in range(4))
        for _ in range(3)
    ]
    return np.clip(np.stack(tones, -1) * 25 + 120, 0, 255).astype(np.uint8)


def write(path: Path, picture: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture)
    return path


def leaf(colour: tuple[int, int, int] = (40, 160, 60)) -> np.ndarray:
    picture = np.zeros((160, 96, 4), np.uint8)
    cv2.ellipse(picture, (48, 80), (30, 60), 0, 0, 360, (*colour, 255), -1)
    return picture


def fill(root: Path) -> Path:
    """A folder with one photograph of every kind."""
    write(root / "bark/mine/own_oak/color.png", waves((128, 128), 1))
    write(root / "bark/mine/own_oak/height.png", waves((128, 128), 2)[..., 0])
    write(root / "ground/mine/soil/color.png", waves((128, 128), 3))
    write(root / "rock/mine/granite/color.png", waves((128, 128), 4))
    write(root / "foliage/mine/oak.png", leaf())
    write(root / "foliage/mine/spruce.png", leaf((30, 90, 40)))
    write(root / "panorama/mine/clearing.png", waves((128, 256), 5))
    (root / "bark/mine/LICENCE.txt").write_text(
        "Oaks of the north slope\nCC BY 4.0, A. Forester\nmore\n"
    )
    return root


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    return fill(tmp_path / "photos")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> PhotoFolder:
    return open_photographs(fill(tmp_path_factory.mktemp("photos")))


@pytest.fixture
def fake_call(in_process: None, call: Call) -> Call:
    """Run ``perceptree ARGUMENTS`` with fake frames."""
    return call


def shown_everywhere(settings: SimulatorSettings, folder: PhotoFolder) -> SimulatorSettings:
    settings = replace(settings, photographs=PhotographSettings(share=1.0))
    return with_photographs(settings, folder)


def test_labels_and_depth_stay_and_colours_change(textures, prototypes, folder: PhotoFolder):
    small = CameraSettings.of_size(160, 90)
    settings = replace(PRESETS["field"].settings, camera=small)
    [plain] = simulate_frames(settings, 3_000_004, 1, Assets(textures, prototypes))
    dressed = shown_everywhere(settings, folder)
    [photographed] = simulate_frames(dressed, 3_000_004, 1, Assets(textures, prototypes, folder))
    assert len(plain.labels) >= 3
    records = [frame_record(frame, 0, FileSettings()) for frame in (plain, photographed)]
    assert records[0] == records[1]
    assert np.array_equal(plain.depth_m, photographed.depth_m)
    assert np.array_equal(plain.exact_depth_m, photographed.exact_depth_m)
    assert (plain.image != photographed.image).any(-1).mean() > 0.5


def test_two_workers_write_the_bytes_of_this_process(
    tmp_path: Path, folder: PhotoFolder, synth: ModuleType, textures, prototypes, monkeypatch
):
    settings = shown_everywhere(
        replace(
            PRESETS["paper"].settings,
            camera=CameraSettings.of_size(128, 72),
            splits=SplitSettings(val=0.0, test=1.0),
            views_per_scene=1,
        ),
        folder,
    )
    generate_dataset(tmp_path / "2", 2, settings, 3, 2, photographs=folder)
    assets = Assets(textures, prototypes, folder)
    monkeypatch.setattr(
        generate, "draw_scenes", lambda jobs, _: (draw_scene(job, assets) for job in jobs)
    )
    generate_dataset(tmp_path / "1", 2, settings, 3, 1, photographs=folder)
    assert synth.contents(tmp_path / "1") == synth.contents(tmp_path / "2")


def test_presets_name_no_photographs():
    for preset in PRESETS.values():
        assert "photographs" not in preset.settings.to_dict()


def test_the_dataset_names_its_photographs_and_no_path(
    fake_call: Call, tmp_path: Path, photos: Path
):
    out = tmp_path / "out"
    code, printed, told = fake_call("synth", "--out", out, *SMALL, "--textures", photos)
    assert code == 0
    assert printed.splitlines()[0].startswith("train: ")
    assert "textures: normals from the height: bark/mine/own_oak\n" in told
    text = (out / "settings.json").read_text()
    assert str(tmp_path) not in text
    assert json.loads(text)["settings"]["photographs"] == {
        "sha256": open_photographs(photos).sha256,
        "share": 0.7,
    }
    named = dataset_credits(out / "settings.json")
    assert named[0] == {
        "kind": "bark",
        "source": "mine",
        "licence": "CC BY 4.0, A. Forester",
        "names": ["own_oak"],
    }
    assert "textures: no LICENCE.txt: ground/mine, rock/mine, foliage/mine and 1 more" in told


def test_a_dataset_without_photographs_has_no_credits(fake_call: Call, tmp_path: Path):
    assert fake_call("synth", "--out", tmp_path, *SMALL)[0] == 0
    assert dataset_credits(tmp_path / "settings.json") == []
    with pytest.raises(DatasetError, match=r"none.json: cannot be read"):
        dataset_credits(tmp_path / "none.json")


def test_only_the_same_photographs_resume_a_dataset(fake_call: Call, tmp_path: Path, photos: Path):
    out, moved, other = tmp_path / "out", tmp_path / "moved", tmp_path / "other"
    command = ("synth", "--out", out, *SMALL, "--textures")
    assert fake_call(*command, photos)[0] == 0
    shutil.copytree(photos, moved)
    assert fake_call(*command, moved)[0] == 0
    shutil.copytree(photos, other)
    write(other / "bark/mine/own_oak/color.png", waves((128, 128), 9))
    for folder in (("--textures", other), ()):
        code, _, told = fake_call("synth", "--out", out, *SMALL, *folder)
        assert code == 2
        line = told.splitlines()[-1]
        assert line.startswith(f"perceptree: {out}/settings.json: has other settings or another")
    again = fake_call("synth", "--out", tmp_path / "b", *SMALL, "--settings", out / "settings.json")
    assert again[0] == 2
    assert "the settings name photographs (sha256" in again[2]
    assert "expected --textures" in again[2]


def test_shards_merge_to_the_dataset_of_one_machine(
    fake_call: Call, tmp_path: Path, photos: Path, synth: ModuleType
):
    options = (*SMALL, "--textures", photos)
    assert fake_call("synth", "--out", tmp_path / "whole", *options)[0] == 0
    for shard in ("1/2", "2/2"):
        out = tmp_path / shard[0]
        assert fake_call("synth", "--out", out, *options, "--shard", shard)[0] == 0
    merge = ("merge", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "merged")
    assert fake_call(*merge)[0] == 0
    assert synth.contents(tmp_path / "merged") == synth.contents(tmp_path / "whole")


def test_a_frozen_preset_takes_no_photographs(fake_call: Call, tmp_path: Path, photos: Path):
    code, _, told = fake_call("synth", "--out", tmp_path, "--preset", "test", "--textures", photos)
    assert code == 2
    assert "--preset test is frozen" in told


def test_a_share_is_part_of_the_settings_and_has_bounds(folder: PhotoFolder):
    settings = with_photographs(SimulatorSettings(), folder)
    half = replace(settings, photographs=replace(settings.photographs, share=0.5))
    assert settings_sha256(half, 0) != settings_sha256(settings, 0)
    with pytest.raises(SettingsError, match=r"photographs.share is 1.5: expected 0 to 1"):
        PhotographSettings(share=1.5)
    with pytest.raises(SettingsError, match=r"photographs.sha256 is 'abc': expected 64 digits"):
        PhotographSettings("abc")


def test_a_share_of_none_keeps_every_texture(forests, textures, folder: PhotoFolder):
    scene, mesh = forests[0]
    none = dress(scene, mesh.layer, textures, folder, PhotographSettings(share=0.0))
    assert np.array_equal(none.textures.albedo, textures.albedo)
    assert none.far_stand is None
    some = dress(scene, mesh.layer, textures, folder, PhotographSettings(share=1.0))
    assert not np.array_equal(some.textures.albedo, textures.albedo)
    assert np.array_equal(some.textures.alpha, textures.alpha)
    assert np.array_equal(some.textures.albedo[:, 3], textures.albedo[:, 3])
    assert some.far_stand is not None


def test_scenes_show_the_same_photograph_differently(forests, textures, folder: PhotoFolder):
    layers = []
    for scene, mesh in forests:
        own = dress(scene, mesh.layer, textures, folder, PhotographSettings(share=1.0)).textures
        layers.append(own.albedo[layer_texels(own, Layer.ROCK, 0)].astype(int))
    assert np.abs(layers[0] - layers[1]).mean() > 3


def test_tones_are_linear_light_as_in_procedural_textures():
    halves = np.full((128, 128, 3), 60, np.uint8)
    halves[:64] = 180
    flat = np.full((128, 128, 2), 128, np.uint8)
    linear, _ = material_layer(
        np.random.default_rng(3), Material(halves, flat, ()), MEAN, upright=True, mossy=False
    )
    red = np.sort(linear[..., 0].ravel())
    ratio = red[int(0.9 * red.size)] / red[int(0.1 * red.size)]
    assert ratio == pytest.approx((180 / 60) ** 2.2, rel=0.02)


def test_dark_and_bright_photographs_come_near_to_the_layer():
    means = []
    for level in (20, 230):
        picture = np.full((128, 128, 3), level, np.uint8)
        flat = np.full((128, 128, 2), 128, np.uint8)
        made = [
            material_layer(np.random.default_rng(n), Material(picture, flat, ()), MEAN, True, False)
            for n in range(8)
        ]
        means.append(np.mean([linear.mean() for linear, _ in made]))
    assert MEAN.mean() / 8 < means[0] < MEAN.mean() < means[1] < 8 * MEAN.mean()


def test_a_layer_wraps_around(folder: PhotoFolder):
    for kind in ("bark", "ground"):
        [photo] = folder.of_kind(kind)
        linear, normals = material_layer(
            np.random.default_rng(1), load_material(photo), MEAN, kind == "bark", True
        )
        for picture in (linear, normals):
            whole = (picture * 255).astype(np.uint8)
            assert picture.shape == (SIZE_PX, SIZE_PX, 3)
            assert max(seam_ratio(whole, 0), seam_ratio(whole, 1)) < 2.5


def test_normals_turn_with_their_picture():
    y, x = np.meshgrid(np.arange(128), np.arange(128), indexing="ij")
    height = np.exp(-((x - 40.0) ** 2 + (y - 70.0) ** 2) / 200)
    slope = slope_of(height, 0.3)
    assert slope[70, 48, 0] > 150, "right of a hill, the normal points right"
    assert slope[60, 40, 1] > 150, "above a hill in the picture, the normal points up"
    hills = waves((128, 128))[..., 0]
    colour, slope = np.repeat(hills[..., None], 3, -1), slope_of(hills.astype(float), 0.3)
    for seed in range(12):
        linear, normals = material_layer(
            np.random.default_rng(seed), Material(colour, slope, ()), MEAN, False, False
        )
        grey = cv2.GaussianBlur(linear.mean(-1), (0, 0), 3)
        right = np.roll(grey, -1, 1) - np.roll(grey, 1, 1)
        down = np.roll(grey, -1, 0) - np.roll(grey, 1, 0)
        assert np.corrcoef(-right.ravel(), normals[..., 0].ravel())[0, 1] > 0.5
        assert np.corrcoef(down.ravel(), normals[..., 1].ravel())[0, 1] > 0.5


def test_a_map_of_normals_comes_before_height_and_brightness(photos: Path):
    own = photos / "bark/mine/own_oak"
    assert load_material(open_photographs(photos).of_kind("bark")[0]).remarks == (
        "normals from the height",
    )
    (own / "height.png").unlink()
    assert load_material(open_photographs(photos).of_kind("bark")[0]).remarks == (
        "normals from the brightness",
    )
    normal = np.full((64, 64, 3), 128, np.uint8)
    normal[..., 2] = 200  # red, the last channel of a file
    write(own / "normal.png", normal)
    loaded = load_material(open_photographs(photos).of_kind("bark")[0])
    assert loaded.remarks == ()
    assert loaded.slope.shape == (128, 128, 2)
    assert (loaded.slope == [200, 128]).all()


def test_leaves_keep_their_colour_between_them_and_grey_ones_are_tinted(photos: Path):
    oak, _ = open_photographs(photos).of_kind("foliage")
    colour, grey = load_cutout(oak)
    assert not grey
    assert (colour == [60, 160, 40]).all(), "no black comes from transparent parts"
    write(photos / "foliage/mine/oak.png", leaf((120, 120, 120)))
    colour, grey = load_cutout(oak)
    assert grey
    linear = foliage_layer(np.random.default_rng(0), colour, grey, np.array([0.05, 0.1, 0.02]))
    assert linear[..., 1].mean() > 1.5 * linear[..., 0].mean() > 2 * linear[..., 2].mean()


def test_species_seasons_and_words_choose_the_photograph(photos: Path):
    write(photos / "bark/mine/birch_old/color.png", waves((128, 128), 6))
    write(photos / "ground/mine/snow_tracks/color.png", waves((128, 128), 7))
    write(photos / "panorama/mine/snowy_wood.png", waves((128, 256), 8))
    folder = open_photographs(photos)

    def names(layer: Layer, snow: float = 0.0) -> list[str]:
        return [photo.name for photo in photographs_for(layer, folder, snow)]

    assert names(Layer.BIRCH_WHITE) == ["birch_old", "own_oak"]
    assert names(Layer.FIR_GREY) == ["own_oak"]
    assert names(Layer.MUD) == ["soil"]
    assert names(Layer.MUD, snow=0.5) == ["snow_tracks", "soil"]
    assert names(Layer.SPRUCE_TWIG) == ["spruce"]
    assert names(Layer.BEECH_LEAVES) == ["oak"]
    assert names(Layer.CUT_WOOD) == names(Layer.PAINT) == names(Layer.FUR) == []
    assert [photo.name for photo in panoramas(folder, 0.0)] == ["clearing"]
    assert [photo.name for photo in panoramas(folder, 0.5)] == ["snowy_wood"]


def test_a_panorama_is_seen_where_nothing_stands(
    small_settings, forests, textures, prototypes, tmp_path: Path
):
    red = np.zeros((128, 256, 3), np.uint8)
    red[..., 2] = 200
    write(tmp_path / "panorama/mine/red.png", red)
    folder = open_photographs(tmp_path)
    seed = forests[0][0].seed
    settings = shown_everywhere(small_settings, folder)
    [plain] = simulate_frames(small_settings, seed, 1, Assets(textures, prototypes))
    [frame] = simulate_frames(settings, seed, 1, Assets(textures, prototypes, folder))
    open_ = cv2.erode((frame.exact_depth_m == 0).astype(np.uint8), np.ones((5, 5))) > 0
    assert open_.sum() > 100
    blue, _, red_seen = frame.image[open_].astype(int).mean(0)
    plain_blue, _, plain_red = plain.image[open_].astype(int).mean(0)
    assert red_seen - blue > plain_red - plain_blue + 20


def test_a_cube_map_becomes_a_panorama(tmp_path: Path):
    tones = {"posx": 40, "negx": 80, "posy": 120, "negy": 160, "posz": 200, "negz": 240}
    for name, tone in tones.items():
        write(tmp_path / f"panorama/park/{name}.png", np.full((64, 64, 3), tone, np.uint8))
    [photo] = open_photographs(tmp_path).photographs
    panorama, _ = load_panorama(photo)
    assert panorama.shape == (128, 256, 3)
    assert (panorama[0] == 120).all()
    assert (panorama[-1] == 160).all()
    assert list(panorama[64, [0, 64, 128, 192], 0]) == [200, 40, 240, 80]
    (tmp_path / "panorama/park/negz.png").unlink()
    with pytest.raises(SettingsError, match=r"park: is no cube map without negz, expected"):
        open_photographs(tmp_path)


NOISE = np.random.default_rng(0).integers(0, 255, (128, 128, 3)).astype(np.uint8)
USED = {
    "oblong": ("bark/mine/a/color.png", waves((256, 64)), "not square, repeated to a square"),
    "no wrap": (
        "bark/mine/a/color.png",
        np.repeat(np.linspace(0, 250, 128).astype(np.uint8)[:, None], 128, 1),
        "made to wrap around by blending its borders",
    ),
    "deep": (
        "bark/mine/a/color.png",
        waves((128, 128)).astype(np.uint16) * 257,
        "reduced to 8 bits a channel",
    ),
    "large": ("bark/mine/a/color.png", waves((1100, 1100)), "reduced to 1024 px"),
    "no normals": ("bark/mine/a/color.png", NOISE, "normals from the brightness"),
}


@pytest.mark.parametrize("name", USED)
def test_what_can_be_used_is_used_with_a_word(tmp_path: Path, name: str):
    file, picture, expected = USED[name]
    write(tmp_path / file, picture)
    lines = check_photographs(open_photographs(tmp_path))
    assert f"{expected}: bark/mine/a" in lines
    assert "no folder ground, rock, foliage, panorama: these stay procedural" in lines
    loaded = load_material(open_photographs(tmp_path).photographs[0])
    assert max(loaded.colour.shape) <= 1024
    assert max(seam_ratio(loaded.colour, 0), seam_ratio(loaded.colour, 1)) < 3


REFUSED = {
    "small": ("bark/m/a/color.png", np.zeros((20, 200, 3), np.uint8), r"is 200x20 px, expected"),
    "narrow": ("bark/m/a/color.png", np.zeros((900, 100, 3), np.uint8), r"is 100x900 px, expected"),
    "opaque": ("foliage/m/a.png", np.zeros((90, 90, 3), np.uint8), r"has no alpha channel, exp"),
    "empty": ("foliage/m/a.png", np.zeros((90, 90, 4), np.uint8), r"is transparent, expected"),
    "square": ("panorama/m/a.png", np.zeros((90, 90, 3), np.uint8), r"is 90x90 px, expected a pan"),
    "height": ("bark/m/a/height.png", np.zeros((90, 90, 3), np.uint8), r"has no color.jpg or"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_refused_by_name(tmp_path: Path, call: Call, name: str):
    file, picture, expected = REFUSED[name]
    write(tmp_path / file, picture)
    code, _, told = call("synth", "--out", tmp_path / "out", "--textures", tmp_path)
    assert code == 2
    assert told.count("\n") == 1
    assert expected in told
    assert str(tmp_path / "/".join(file.split("/")[:2])) in told
    assert not (tmp_path / "out").exists()


def test_missing_empty_and_broken_folders_are_one_line(tmp_path: Path, call: Call):
    command = ("synth", "--out", tmp_path / "out", "--textures")
    for folder in (tmp_path / "none", tmp_path):
        code, _, told = call(*command, folder)
        assert (code, told.count("\n")) == (2, 1)
        assert f"--textures is {folder}: expected a folder with photographs" in told
    broken = tmp_path / "bark/m/a/color.jpg"
    broken.parent.mkdir(parents=True)
    broken.write_bytes(b"no picture")
    code, _, told = call(*command, tmp_path)
    assert (code, told.count("\n")) == (2, 1)
    assert f"{broken}: cannot be read as a picture, expected a JPEG or PNG file" in told


def test_a_folder_that_changed_is_refused_on_another_machine(photos: Path):
    folder = open_photographs(photos)
    folder.check_unchanged()
    write(photos / "rock/mine/granite/color.png", waves((128, 128), 7))
    with pytest.raises(SettingsError, match="holds other photographs than at the start"):
        folder.check_unchanged()


def test_mean_colours_are_those_of_the_opaque_parts(textures):
    assert mean_colour(textures, Layer.BIRCH_WHITE).min() > 0.3
    red, green, blue = mean_colour(textures, Layer.BEECH_LEAVES)
    assert green > red > blue > 0.01


def test_the_collected_photographs_are_all_used(shared_path: Callable[[str], Path]):
    folder = open_photographs(shared_path("data/textures"))
    assert all(folder.of_kind(kind) for kind in ("bark", "ground", "rock", "foliage", "panorama"))
    assert not [line for line in check_photographs(folder) if "LICENCE" in line]
