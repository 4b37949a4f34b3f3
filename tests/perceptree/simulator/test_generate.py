"""Datasets: reproducible bytes, lossless resuming, and disjoint splits."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import SettingsError
from basetree.files import writing
from perceptree.errors import DatasetError
from perceptree.simulator.dataset import generate, pool, storage
from perceptree.simulator.dataset.generate import generate_dataset
from perceptree.simulator.dataset.scene_job import SceneJob
from perceptree.simulator.dataset.splits import assign_splits
from perceptree.simulator.settings import SimulatorSettings, SplitSettings
from perceptree.simulator.settings.files import FileSettings

SCRIPT = Path(__file__).parents[2] / "support" / "fake_synth.py"
SEED, FRAMES = 3, 7
PACE, DYING_SCENE = "FAKE_FRAME_SECONDS", "FAKE_DYING_SCENE"


@pytest.fixture(scope="module")
def dataset(fake_dataset: Callable[[int], Path]) -> Path:
    """A dataset of seven frames in four scenes, made without interruption."""
    return fake_dataset(FRAMES)


@pytest.fixture(scope="module")
def settings(synth: ModuleType) -> SimulatorSettings:
    return synth.small_settings()


@pytest.fixture(autouse=True)
def nothing_to_compile(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch):
    """Processes find compiled kernels, so that they do not say that they compile."""
    kernels = tmp_path_factory.mktemp("kernels")
    (kernels / "fake.nbi").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(kernels))


def command(out: Path, *more: object, frames: int = FRAMES) -> list[str]:
    options = {
        "--out": out,
        "--frames": frames,
        "--seed": SEED,
        "--views": 2,
        "--width": 128,
        "--height": 72,
    }
    words = [str(word) for option in options.items() for word in option]
    return [sys.executable, str(SCRIPT), "synth", *words, *map(str, more)]


def run(out: Path, *more: object, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(out, *more), env=os.environ | variables, capture_output=True, text=True, check=False
    )


def read(directory: Path, split: str) -> dict:
    return json.loads((directory / f"{split}_RGB.json").read_text())


def test_every_frame_is_on_disk_and_no_scene_is_in_two_splits(dataset: Path):
    scenes: dict[str, set[int]] = {}
    frames = 0
    for split in ("train", "val", "test"):
        images = read(dataset, split)["images"]
        scenes[split] = {image["scene"]["seed"] for image in images}
        frames += len(images)
        for image in images:
            depth_m = calib.read_depth(dataset / image["depth_file"])
            eight_bit = cv2.imread(str(dataset / image["depth8_file"]), cv2.IMREAD_UNCHANGED)
            encoding = calib.DepthEncoding.from_dict(image["depth_encoding"])
            assert depth_m.shape == (72, 128)
            assert np.array_equal(calib.encode_depth(depth_m, encoding), eight_bit)
            assert cv2.imread(str(dataset / image["file_name"])).shape == (72, 128, 3)
    assert frames == FRAMES
    assert not scenes["train"] & scenes["val"] | scenes["train"] & scenes["test"]
    assert not scenes["val"] & scenes["test"]


def test_the_exact_depth_lies_beside_the_measured_in_millimetres(
    dataset: Path, synth: ModuleType, settings: SimulatorSettings
):
    image = read(dataset, "train")["images"][0]
    exact_m = calib.read_depth(dataset / image["depth_exact_file"])
    frame = synth.fake_frame(settings, image["scene"]["seed"], 0)
    assert exact_m == pytest.approx(frame.exact_depth_m, abs=5.1e-4)
    assert (exact_m == 0).any()


def test_records_carry_the_scene_the_pose_the_sensors_and_every_metre(dataset: Path):
    content = read(dataset, "train")
    image, tree = content["images"][0], content["annotations"][0]
    assert set(image["scene"]) == {
        "seed",
        "terrain",
        "slope_deg",
        "stems_per_ha",
        "pattern",
        "weather",
        "weather_strength",
        "light",
        "overcast",
    }
    assert image["pose"] == {
        "carrier": "mast",
        "height_m": 2.5,
        "pitch_deg": -10.0,
        "roll_deg": 1.0,
    }
    assert image["depth_sensor"] == {
        "kind": "tof",
        "baseline_m": 0.0,
        "noise": 0.00025,
        "range_m": 9.0,
    }
    assert image["up_camera"] == [0.0, -1.0, 0.0]
    assert tree["position_m"] == [0.5, 1.0, 4.9]
    assert tree["position_world_m"] == [3.0, 4.0, 0.1]
    assert tree["keypoints"][:3] == [15.5, 57.5, 2]
    assert tree["keypoints"][12:] == [0, 0, 0]
    assert tree["num_keypoints"] == 4
    assert tree["bbox"] == [10, 8, 12, 52]
    assert (tree["species"], tree["model"]) == ("beech", "beech_smooth")
    assert tree["diameter_breast_m"] == pytest.approx(0.8 * tree["diameter_m"], abs=1e-5)
    expected = {
        "distance_m": 5.0,
        "diameter_height_m": 0.3,
        "cut_height_m": 0.2,
        "inclination_deg": 3.0,
        "area": 624,
        "iscrowd": 0,
    }
    assert {name: tree[name] for name in expected} == expected


def test_colour_images_are_lossless_as_png(
    tmp_path: Path, in_process: None, synth: ModuleType, settings: SimulatorSettings
):
    generate_dataset(tmp_path, FRAMES, settings, SEED, files=FileSettings("png"))
    image = read(tmp_path, "train")["images"][0]
    assert image["file_name"].endswith(".png")
    written = cv2.imread(str(tmp_path / image["file_name"]))
    assert np.array_equal(written, synth.fake_frame(settings, image["scene"]["seed"], 0).image)


def test_killed_in_the_middle_it_resumes_to_the_same_bytes(
    dataset: Path, tmp_path: Path, synth: ModuleType
):
    out, settings = tmp_path / "forest", ("--settings", dataset / "settings.json")
    process = subprocess.Popen(
        command(out, *settings, "--workers", 2),
        env=os.environ | {PACE: "0.15"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    images = out / "images"
    deadline_s = time.monotonic() + 60
    while not (images.is_dir() and len(list(images.glob("*.jpg"))) >= 3):
        assert process.poll() is None, "ended before it was killed"
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "train_RGB.json").exists()
    resumed = run(out, *settings, "--workers", 1)
    assert (resumed.returncode, resumed.stderr) == (0, "")
    assert synth.contents(out) == synth.contents(dataset)


def test_processes_end_with_the_one_that_started_them(tmp_path: Path):
    process = subprocess.Popen(
        command(tmp_path, "--workers", 1, "--json", frames=400),
        env=os.environ | {PACE: "0.05"},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    while not list((tmp_path / "scenes").glob("*.json")):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    started = time.monotonic()
    process.communicate(timeout=60)  # until all processes with this stdout have ended
    assert time.monotonic() - started < 30
    frames = len(list((tmp_path / "images").glob("*.jpg")))
    time.sleep(0.3)
    assert len(list((tmp_path / "images").glob("*.jpg"))) == frames


def test_leftovers_and_lost_files_of_a_run_before_are_made_good(
    dataset: Path, tmp_path: Path, in_process: None, synth: ModuleType, settings: SimulatorSettings
):
    generate_dataset(tmp_path, FRAMES, settings, SEED)
    for folder in ("images", "scenes"):
        (tmp_path / folder / ".calib-0123456789abcdef.part").write_bytes(b"half")
    (tmp_path / "depth/000002.png").unlink()
    (tmp_path / "images/000005.jpg").write_bytes(b"")
    (tmp_path / "scenes/000003.json").write_bytes(b"[")
    report = generate_dataset(tmp_path, FRAMES, settings, SEED)
    assert sum(report.frames.values()) == FRAMES
    assert synth.contents(tmp_path) == synth.contents(dataset)


@pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 on this system")
def test_a_folder_whose_name_is_not_utf8_holds_the_same_dataset(
    dataset: Path, tmp_path: Path, in_process: None, synth: ModuleType, settings: SimulatorSettings
):
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    generate_dataset(folder, FRAMES, settings, SEED)
    assert synth.contents(folder) == synth.contents(dataset)


def test_only_what_is_missing_is_drawn_again(
    tmp_path: Path, in_process: None, monkeypatch, synth: ModuleType, settings: SimulatorSettings
):
    generate_dataset(tmp_path, FRAMES, settings, SEED)
    (tmp_path / "scenes/000002.json").unlink()
    drawn = []

    def note(jobs: list[SceneJob], workers: int) -> Iterator[int]:
        drawn.extend(job.number for job in jobs)
        return synth.draw_here(jobs, workers)

    monkeypatch.setattr(generate, "draw_scenes", note)
    told = []
    generate_dataset(tmp_path, FRAMES, settings, SEED, progress=lambda *now: told.append(now))
    assert drawn == [2]
    assert told == [(5, 7), (7, 7)]


def test_a_longer_dataset_extends_a_shorter_one_without_moving_a_scene(
    dataset: Path, tmp_path: Path, in_process: None, synth: ModuleType, settings: SimulatorSettings
):
    before = {split: read(dataset, split)["images"] for split in ("train", "val", "test")}
    generate_dataset(tmp_path / "grown", FRAMES, settings, SEED)
    generate_dataset(tmp_path / "grown", 20, settings, SEED)
    generate_dataset(tmp_path / "fresh", 20, settings, SEED)
    assert synth.contents(tmp_path / "grown") == synth.contents(tmp_path / "fresh")
    for split, images in before.items():
        assert {i["id"] for i in images} <= {
            i["id"] for i in read(tmp_path / "grown", split)["images"]
        }


def test_a_full_disk_stops_with_one_line_and_the_rest_resumes(
    dataset: Path,
    tmp_path: Path,
    in_process: None,
    monkeypatch,
    synth: ModuleType,
    settings: SimulatorSettings,
):
    real = writing.replacing

    @contextmanager
    def fill(path: Path) -> Iterator[BinaryIO]:
        with real(path) as file:
            yield file
            if "000004" in path.name:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(writing, "replacing", fill)
    with pytest.raises(DatasetError) as caught:
        generate_dataset(tmp_path, FRAMES, settings, SEED)
    assert str(caught.value) == (
        f"{tmp_path}/images/000004.jpg: no space left on the disk; finished scenes are kept: free"
        " some space and run the same command again to resume"
    )
    assert not list(tmp_path.rglob("*.part"))
    monkeypatch.setattr(writing, "replacing", real)
    generate_dataset(tmp_path, FRAMES, settings, SEED)
    assert synth.contents(tmp_path) == synth.contents(dataset)


def test_a_full_disk_while_the_end_is_written_says_so_too(
    tmp_path, in_process, monkeypatch, settings: SimulatorSettings
):
    real = storage.write_atomically

    def fill(path: Path, data: bytes) -> None:
        if path.name == "train_RGB.json":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        real(path, data)

    monkeypatch.setattr(generate, "write_atomically", fill)
    with pytest.raises(DatasetError, match=r"train_RGB.json: no space left on the disk"):
        generate_dataset(tmp_path, FRAMES, settings, SEED)


def test_workers_make_no_difference_and_a_killed_one_is_one_line(
    dataset: Path, tmp_path: Path, synth: ModuleType
):
    options = ("--settings", dataset / "settings.json", "--workers", 2)
    done = run(tmp_path, *options, **{DYING_SCENE: str(SEED * 1_000_000 + 2)})
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert f"{tmp_path}: a simulating process was killed, perhaps for lack of memory" in done.stderr
    assert "run the same command again to resume" in done.stderr
    resumed = run(tmp_path, *options)
    assert (resumed.returncode, resumed.stderr) == (0, "")
    assert synth.contents(tmp_path) == synth.contents(dataset)


def test_sigterm_ends_the_simulation_at_once_and_leaves_whole_files(tmp_path: Path):
    process = subprocess.Popen(
        command(tmp_path, "--workers", 2, frames=400),
        env=os.environ | {PACE: "15"},  # 30 s for a scene
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (tmp_path / "images").is_dir():
        assert process.poll() is None
        time.sleep(0.01)
    (tmp_path / "images" / ".calib-0123456789abcdef.part").write_bytes(b"half")
    time.sleep(3)
    process.terminate()
    started = time.monotonic()
    told = process.communicate(timeout=60)  # until all processes with this stdout have ended
    assert time.monotonic() - started < 10
    assert told == ("", "perceptree: interrupted; run the same command again to resume\n")
    assert process.returncode == 143
    assert not list(tmp_path.rglob("*.part"))


def test_ctrl_c_ends_every_process_at_once_and_says_how_to_go_on(tmp_path: Path):
    process = subprocess.Popen(
        command(tmp_path, "--workers", 2, frames=400),
        env=os.environ | {PACE: "0.1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
        # A test runner in the background ignores the signal, which child processes inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while not list((tmp_path / "scenes").glob("*.json")):
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)
    told = process.communicate(timeout=60)
    assert told == ("", "perceptree: interrupted; run the same command again to resume\n")
    assert process.returncode == 130


@pytest.mark.parametrize(
    ("changes", "seed", "files"),
    [
        ({}, 4, FileSettings()),
        ({}, SEED, FileSettings("png")),
        ({"views_per_scene": 3}, SEED, FileSettings()),
    ],
)
def test_a_folder_of_other_settings_is_refused_by_name(
    dataset: Path,
    settings: SimulatorSettings,
    changes: dict[str, int],
    seed: int,
    files: FileSettings,
):
    others = replace(settings, **changes)
    with pytest.raises(DatasetError, match=r"settings.json: has other settings or another seed"):
        generate_dataset(dataset, 9, others, seed, files=files)


BOUNDS = {
    "frames": ({"frames": 0}, "frames is 0: expected 1 to 999999"),
    "seed": ({"seed": -1}, "seed is -1: expected 0 to 999999"),
    "workers": ({"workers": 0}, "workers is 0: expected 1 to 1024"),
    "few": (
        {"frames": 3},
        "frames is 3, which makes 2 scenes of 2 views: expected at least 5, for a scene in each of"
        " the splits train, val, test",
    ),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_number_out_of_bounds_is_named_with_them(
    tmp_path: Path, name: str, settings: SimulatorSettings
):
    changes, expected = BOUNDS[name]
    options = {"frames": FRAMES, "settings": settings, "seed": SEED, **changes}
    with pytest.raises(SettingsError) as caught:
        generate_dataset(tmp_path / "out", **options)
    assert str(caught.value) == expected
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, settings: SimulatorSettings):
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match=r"file.*cannot be written"):
        generate_dataset(tmp_path / "file" / "out", FRAMES, settings)


@pytest.mark.parametrize("scenes", [3, 4, 10, 100, 5375])
@pytest.mark.parametrize("shares", [(0.1, 0.1), (1 / 43, 2 / 43), (0.3, 0.2)])
def test_splits_keep_their_shares_and_none_is_empty(scenes: int, shares: tuple[float, float]):
    assigned = assign_splits(scenes, SplitSettings(*shares))
    for split, share in zip(("train", "val", "test"), (1 - sum(shares), *shares), strict=True):
        assert assigned.count(split) >= 1
        assert abs(assigned.count(split) - share * scenes) <= 2
    assert assign_splits(scenes + 50, SplitSettings(*shares))[:scenes] == assigned


def test_the_papers_split_comes_out_to_the_scene():
    assigned = assign_splits(5375, SplitSettings(1 / 43, 2 / 43))
    assert [assigned.count(split) for split in ("train", "val", "test")] == [5000, 125, 250]


def test_a_dataset_of_tests_alone_has_no_other_split(
    tmp_path: Path, in_process: None, settings: SimulatorSettings
):
    alone = replace(settings, splits=SplitSettings(0.0, 1.0))
    report = generate_dataset(tmp_path, 3, alone, SEED)
    assert report.frames == {"train": 0, "val": 0, "test": 3}
    assert not (tmp_path / "train_RGB.json").exists()


def test_nothing_to_draw_starts_no_process(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(pool, "ProcessPoolExecutor")
    assert list(pool.draw_scenes([], 4)) == []
