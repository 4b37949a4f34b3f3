"""``perceptree train``: the effect of its options on model and training."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from urllib.error import URLError

import pytest
import timm
import torch
from narrow_networks import narrow_spec
from torchvision.models._api import WeightsEnum

import perceptree.training
from perceptree.data import VARIED_AUGMENT, AugmentSettings
from perceptree.models import (
    PAPER_SAMPLING,
    ModelSpec,
    SampleSettings,
    TreeRCNN,
    load_checkpoint,
    make_spec,
    save_checkpoint,
)
from perceptree.training import DataSource, Engine, Init, TrainSettings, recipe_settings
from perceptree.training.state import write_state

Call = Callable[..., tuple[int, str, str]]


class Asked(NamedTuple):
    """The arguments with which the command started a training."""

    spec: ModelSpec
    settings: TrainSettings
    init: Init | None
    engine: Engine
    branch: Path | None
    source: DataSource


class Stopped(Exception):
    exit_code = 2


@pytest.fixture
def asked(
    call: Call, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Asked]:
    """Run the command up to the training, in a folder with a dataset ``posts``."""
    here = tmp_path_factory.mktemp("here")
    (here / "posts").mkdir()
    monkeypatch.chdir(here)
    told: list[Asked] = []

    def record(
        spec: Any,
        settings: Any,
        data: Any,
        out: Any,
        progress: Any,
        init: Any,
        engine: Any,
        branch: Any,
        preparing: Any,
        heads: Any,
    ) -> None:
        told.append(Asked(spec, settings, init, engine, branch, data))
        raise Stopped("far enough")

    def ask(*options: object) -> Asked:
        code, out, err = call("train", "posts", "--out", "run", *options)
        assert (code, out, err.splitlines()[-1]) == (2, "", "perceptree: far enough")
        return told[-1]

    monkeypatch.setattr(perceptree.training, "train", record)
    return ask


def write_start(path: Path, **changes: Any) -> ModelSpec:
    spec = narrow_spec("depth", 96, 160, **changes)
    save_checkpoint(path, TreeRCNN(spec), {})
    return spec


def test_without_options_the_light_depth_model_is_trained_whole_from_random(
    asked: Callable[..., Asked],
) -> None:
    spec, settings, init, engine, branch, source = asked()
    assert spec == make_spec("edge-n", "depth", 384, 640)
    assert settings == recipe_settings("scratch", steps=20_000)
    assert settings.schedule == "constant"
    assert (init, engine, branch) == (None, Engine(), None)
    assert source == DataSource(Path("posts"))


def test_the_varied_recipe_differs_in_the_augmentation_alone(asked: Callable[..., Asked]) -> None:
    _, settings, *_ = asked("--recipe", "varied", "--modality", "rgb")
    assert settings.augment == VARIED_AUGMENT
    assert replace(settings, augment=AugmentSettings()) == recipe_settings("scratch", steps=20_000)


def test_every_model_comes_with_its_size_and_sampling(asked: Callable[..., Asked]) -> None:
    for model in ("edge-s", "edge-m", "edge-l"):
        spec, settings, *_ = asked("--model", model, "--modality", "rgb")
        assert spec == make_spec(model, "rgb")
        assert settings.sampling == SampleSettings()
    spec, *_ = asked("--model", "edge-s")
    assert spec == make_spec("edge-s", "depth", 480, 800)
    for model in ("r50", "r101", "x101-32x8d", "x101-32x4d"):
        spec, settings, *_ = asked("--model", model, "--modality", "rgb")
        assert spec == make_spec(model, "rgb", 720, 1280)
        assert settings == recipe_settings("paper", steps=60_000)
        assert settings.sampling == PAPER_SAMPLING
        assert (settings.freeze_level, settings.frozen_norms) == (0, False)


def test_published_weights_freeze_the_papers_models_as_the_paper_did(
    asked: Callable[..., Asked],
) -> None:
    spec, settings, init, *_ = asked("--model", "r50", "--init", "coco")
    assert (settings.freeze_level, settings.frozen_norms, init) == (2, True, "coco")
    # The position of the stride in these weights.
    assert not spec.stride_in_1x1
    _, settings, init, *_ = asked("--model", "x101-32x8d", "--init", "imagenet")
    assert (settings.freeze_level, settings.frozen_norms, init) == (2, True, "imagenet")
    _, settings, *_ = asked("--model", "edge-l", "--init", "imagenet")
    assert (settings.freeze_level, settings.frozen_norms) == (0, False)
    _, settings, *_ = asked(
        "--model", "r50", "--init", "coco", "--freeze-level", 0, "--trained-norms"
    )
    assert (settings.freeze_level, settings.frozen_norms) == (0, False)
    _, settings, *_ = asked("--init", "imagenet", "--freeze-level", 3, "--frozen-norms")
    assert (settings.freeze_level, settings.frozen_norms) == (3, True)


def test_branches_and_size_are_as_asked(asked: Callable[..., Asked]) -> None:
    spec, *_ = asked("--no-masks", "--height", 90, "--width", 150)
    assert spec == make_spec("edge-n", "depth", 90, 150, masks=False)
    assert not asked("--no-keypoints").spec.keypoints


def test_a_files_model_is_taken_with_the_changes_asked_for(
    asked: Callable[..., Asked], tmp_path: Path
) -> None:
    file = tmp_path / "start.safetensors"
    own = write_start(file, masks=False)
    spec, settings, init, *_ = asked("--init", file)
    assert (spec, init) == (own, file)
    assert (settings.freeze_level, settings.frozen_norms) == (0, False)
    spec, *_ = asked("--init", file, "--model", "edge-n", "--height", 64, "--masks")
    assert (spec.height, spec.width, spec.masks) == (64, 160, True)
    assert spec.anchor_sizes_px == own.anchor_sizes_px
    spec, *_ = asked("--init", file, "--width", 320)
    assert spec.anchor_sizes_px == tuple((2 * side,) for (side,) in own.anchor_sizes_px)


def test_a_file_of_a_smaller_model_starts_a_larger_one(
    asked: Callable[..., Asked], tmp_path: Path
) -> None:
    file = tmp_path / "start.safetensors"
    own = write_start(file)
    spec, *_ = asked("--init", file, "--model", "edge-s")
    larger = make_spec("edge-s", "depth")
    assert (spec.name, spec.width, spec.height) == ("edge-s-depth", 800, 480)
    assert (spec.anchor_sizes_px, spec.fpn_width) == (larger.anchor_sizes_px, own.fpn_width)


def test_a_file_with_other_pyramid_levels_than_the_model_is_refused(
    call: Call, posts: Path, tmp_path: Path
) -> None:
    file = tmp_path / "start.safetensors"
    save_checkpoint(file, TreeRCNN(make_spec("edge-m", "depth", 96, 160, fpn_width=16)), {})
    out = tmp_path / "run"
    code, _, told = call("train", posts, "--out", out, "--model", "edge-l", "--init", file)
    assert code == 2
    assert "of levels (2, 3, 4, 5), but" in told
    assert not out.exists()


def test_a_files_training_without_masks_runs_to_its_end(
    call: Call, posts: Path, tmp_path: Path
) -> None:
    file = tmp_path / "start.safetensors"
    write_start(file)
    code, printed, told = call(
        "train",
        posts,
        "--out",
        tmp_path / "run",
        "--init",
        file,
        "--height",
        64,
        "--width",
        128,
        "--no-masks",
        "--freeze-level",
        2,
        "--steps",
        1,
        "--batch",
        2,
        "--json",
    )
    assert (code, told) == (0, "")
    report = json.loads(printed)
    model, record = load_checkpoint(report["checkpoint"])
    assert (model.spec.height, model.spec.masks, model.spec.keypoints) == (64, False, True)
    assert report["val"]["mask_ap"] is None
    assert record["training"]["init"]["name"] == "start.safetensors"
    assert record["training"]["settings"]["freeze_level"] == 2


MISTAKES = {
    "model": (("--model", "r51"), "model is 'r51', expected one of: edge-n"),
    "start": (
        ("--init", "imagnet"),
        "--init is 'imagnet': expected imagenet, coco or a checkpoint file",
    ),
    "not a checkpoint": (("--init", "{}/train_RGB.json"), "not a readable safetensors file"),
    "another model": (
        ("--init", "{}/start.safetensors", "--model", "r50"),
        "--model is r50, of backbone resnet50, but",
    ),
    "another modality": (
        ("--init", "{}/start.safetensors", "--modality", "rgb"),
        "--modality is rgb, but",
    ),
    "size": (("--height", 20), "the input is 20x640, expected 32 to 8192 px"),
    "freeze level": (("--freeze-level", 6), "freeze_level is 6: expected 0 to 5"),
    "share alone": (("--mix-share", 0.5), "--mix-share is given without --mix: expected a dataset"),
    "no mix": (("--mix", "{}/gone"), "gone: no such file or folder, expected a dataset"),
    "mix and simulate": (
        ("--mix", "{}", "--simulate", 9, "--minutes", 1),
        "--simulate excludes --mix",
    ),
    "frozen norms": (("--frozen-norms",), "frozen_norms is set without starting weights"),
    "coco": (
        ("--init", "coco", "--height", 64, "--width", 128),
        "backbone is mobilenetv4_conv_small: torchvision",
    ),
    "no network": (
        ("--init", "imagenet", "--height", 64, "--width", 128),
        "timm could not download the ImageNet weights mobilenetv4_conv_small.e2400_r224_in1k (<url",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_and_exit_code_two(
    call: Call, posts: Path, monkeypatch: pytest.MonkeyPatch, mistake: str
) -> None:
    make = timm.create_model

    def create(name: str, pretrained: bool, **settings: Any) -> Any:
        if pretrained:
            raise URLError("no route")
        return make(name, pretrained=False, **settings)

    def get(*_: object, **__: object) -> None:
        raise AssertionError("nothing to fetch")

    monkeypatch.setattr(timm, "create_model", create)
    monkeypatch.setattr(WeightsEnum, "get_state_dict", get)
    options, expected = MISTAKES[mistake]
    if any("start.safetensors" in str(option) for option in options):
        write_start(posts / "start.safetensors")
    given = (str(option).replace("{}", str(posts)) for option in options)
    code, printed, told = call("train", posts, "--out", posts / "run", *given)
    assert (code, printed) == (2, "")
    assert told.startswith("perceptree: ")
    assert told.count("\n") == 1
    assert expected in told


def test_options_reach_settings_and_engine(asked: Callable[..., Asked], tmp_path: Path) -> None:
    found = asked(
        "--recipe",
        "paper",
        "--minutes",
        3,
        "--patience",
        4,
        "--batch",
        12,
        "--accumulate",
        3,
        "--learning-rate",
        0.01,
        "--weight-bits",
        7,
        "--evaluate-every",
        70,
        "--seed",
        5,
        "--precision",
        "fp32",
        "--workers",
        2,
        "--cache",
        tmp_path,
        "--skip-broken",
        "--fold",
        3,
        "--entire-tree",
    )
    assert found.settings == recipe_settings(
        "paper",
        minutes=3.0,
        patience=4,
        batch=12,
        accumulate=3,
        learning_rate=0.01,
        weight_bits=7,
        evaluate_every_steps=70,
        seed=5,
    )
    assert found.source == DataSource(Path("posts"), 3, True)
    assert found.engine == Engine(
        precision="fp32", workers=2, cache=str(tmp_path), skip_broken=True
    )


def test_a_mix_takes_half_of_each_batch_unless_told(asked: Callable[..., Asked]) -> None:
    general = Path("general")
    general.mkdir()
    found = asked("--mix", general)
    assert found.source == DataSource(Path("posts"), mix=general)
    assert found.settings == recipe_settings("scratch", steps=20_000, mix_share=0.5)
    assert asked("--mix", general, "--mix-share", 0.25).settings.mix_share == 0.25


def write_run(folder: Path, spec: ModelSpec, settings: TrainSettings) -> None:
    """The state of a run of no steps."""
    folder.mkdir()
    state = dict.fromkeys(("step", "first_step", "stale", "evaluated_at"), 0)
    state |= dict.fromkeys(("elapsed_s", "waited_s"), 0.0)
    state |= {"model": {}, "average": None, "optimizer": {}, "precision": "fp32"}
    identity = {"model settings": spec.to_dict(), "settings": settings.to_dict()}
    write_state(folder / "state.pt", {**state, "means": {}, "best": None}, identity)


def test_a_branch_has_the_model_and_settings_of_its_run_and_its_rate_falls(
    asked: Callable[..., Asked], tmp_path: Path
) -> None:
    spec = narrow_spec("rgb", 96, 160, mask_score_weight=0.3)
    given = {"learning_rate": 0.0003, "batch": 4, "frozen_norms": True, "backbone_rate_share": 0.5}
    mixed_run = recipe_settings("varied", steps=9, seed=7, mix_share=0.25, **given)
    write_run(tmp_path / "run", spec, mixed_run)
    found = asked("--branch", tmp_path / "run", "--minutes", 20)
    assert (found.branch, found.spec) == (tmp_path / "run", spec)
    decay = {"minutes": 20.0, "schedule": "decay"}
    assert found.settings == recipe_settings("varied", **given, **decay)
    changed = asked("--branch", tmp_path / "run", "--backbone-rate", 0.1, "--minutes", 20)
    assert changed.settings == recipe_settings(
        "varied", **given | {"backbone_rate_share": 0.1}, **decay
    )
    Path("general").mkdir()
    mixed = asked("--branch", tmp_path / "run", "--mix", "general", "--minutes", 20)
    assert mixed.settings.mix_share == 0.25
    scratch = asked("--branch", tmp_path / "run", "--recipe", "scratch", "--minutes", 20)
    assert scratch.settings == recipe_settings("scratch", learning_rate=0.0003, **decay)


def test_a_branch_whose_run_is_gone_is_resumed(asked: Callable[..., Asked]) -> None:
    spec = narrow_spec("rgb", 96, 160)
    own = recipe_settings("scratch", steps=9, schedule="decay", learning_rate=0.0003)
    write_run(Path("run"), spec, own)
    found = asked("--branch", "gone", "--steps", 9)
    assert (found.spec, found.settings) == (spec, own)


@pytest.mark.parametrize("group", ["settings", "model settings"])
def test_a_state_that_lacks_what_a_branch_needs_is_one_line(
    call: Call, tmp_path: Path, group: str
) -> None:
    spec = narrow_spec("rgb", 96, 160)
    write_run(tmp_path / "run", spec, recipe_settings("scratch", steps=9))
    state = torch.load(tmp_path / "run/state.pt")
    identity = json.loads(state["identity"])
    del identity[group]
    torch.save({**state, "identity": json.dumps(identity)}, tmp_path / "run/state.pt")
    (tmp_path / "data").mkdir()
    given = ("--out", tmp_path / "out", "--branch", tmp_path / "run")
    code, _, err = call("train", tmp_path / "data", *given)
    assert code == 2
    assert f"state.pt: not a readable training state ({group} are missing)" in err
    assert len(err.splitlines()) == 1
