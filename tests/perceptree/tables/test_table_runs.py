"""``perceptree tables``: finished runs are kept, interrupted ones resumed, errors one line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from narrow_networks import narrow_spec
from schema_check import check_schema

import perceptree.tables
from basetree.errors import SettingsError
from perceptree.errors import CheckpointError
from perceptree.models import TreeRCNN, load_checkpoint, save_checkpoint
from perceptree.tables import TableSettings, Watch, build_table
from perceptree.tables import results as runs
from perceptree.tables.plan import TableModel
from perceptree.training import Engine, Preparing, Status

Call = Callable[..., tuple[int, str, str]]
Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]

TINY: dict[str, Any] = {
    "table": 2,
    "models": ("edge-n",),
    "seeds": (0,),
    "height": 64,
    "width": 96,
    "batch": 2,
}
ENGINE = Engine(precision="fp32", workers=0)
ONE_SMALL_STEP = [
    "--steps",
    "1",
    "--height",
    "64",
    "--width",
    "96",
    "--batch",
    "2",
    "--precision",
    "fp32",
]
BOTH = "keypoint & mask"


def two_steps(**changes: Any) -> TableSettings:
    return TableSettings(**TINY | {"steps": 2} | changes)


class Told:
    """Records the runs that were started and the steps of each."""

    def __init__(self, stop_in: str = "", stop_at: int = 1) -> None:
        self.steps: dict[str, list[int]] = {}
        self.evaluated: list[str] = []
        self._stop = stop_in, stop_at
        self.watch = Watch(self._begin, self._step, evaluating=self._evaluate)

    def _begin(self, name: str, number: int, total: int) -> None:
        self.name = name
        self.steps[name] = []

    def _step(self, status: Status) -> None:
        self.steps[self.name].append(status.step)
        if (self.name, status.step) == self._stop:
            raise KeyboardInterrupt

    def _evaluate(self, done: int, total: int) -> None:
        if done == total:
            self.evaluated.append(self.name)


def test_finished_runs_are_kept_and_an_interrupted_one_is_resumed(
    posts: Path, tmp_path: Path, edit_split: Edit
) -> None:
    rgb, depth = "edge-n-rgb-both-seed0", "edge-n-depth-both-seed0"
    out, arguments = tmp_path / "out", (posts, posts, tmp_path / "out", ENGINE)
    told = Told(stop_in=depth)
    with pytest.raises(KeyboardInterrupt):
        build_table(two_steps(), *arguments, told.watch)
    assert told.steps == {rgb: [1, 2], depth: [1]}
    assert json.loads((out / "tables.json").read_text())["tables"]["2"]["finished_runs"] == 1
    told = Told()
    record = build_table(two_steps(), *arguments, told.watch)
    assert told.steps == {rgb: [], depth: [2]}
    assert told.evaluated == [depth]
    assert [row["steps"] for row in record["rows"]] == [[2], [2]]
    assert json.loads((out / "tables.json").read_text())["tables"]["2"] == record
    assert "edge-n, Depth" in (out / "tables.md").read_text()
    # For other test frames the existing weights are evaluated again.
    edit_split(posts, "test", lambda content: content["images"].reverse())
    told = Told()
    assert build_table(two_steps(), *arguments, told.watch)["rows"] == record["rows"]
    assert (told.steps, told.evaluated) == ({rgb: [], depth: []}, [rgb, depth])
    # A run with other settings is not reused.
    with pytest.raises(CheckpointError, match="other settings: steps was 2, is 3"):
        build_table(two_steps(steps=3), *arguments)
    (out / rgb / "result.json").write_text("{}")
    with pytest.raises(CheckpointError, match=r"result\.json: not a result of a table's run"):
        build_table(two_steps(), *arguments)


def test_a_result_equals_the_checkpoints_score_on_the_test_frames(
    call: Call, posts: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    options = ("--table", 3, "--seeds", 3, *ONE_SMALL_STEP)
    code, printed, told = call("tables", posts, "--out", out, *options)
    assert code == 0
    assert "| edge-n, Depth | keypoint-only" in printed
    assert printed.endswith(f"{out / 'tables.md'}\n")
    assert told.startswith("run 1 of 4: edge-n-depth-masks-seed3\n")
    run = out / "edge-n-rgb-both-seed3"
    result = json.loads((run / "result.json").read_text())
    _, record = load_checkpoint(run / "best.safetensors")
    tables = json.loads((out / "tables.json").read_text())
    assert [check_schema(each) for each in (result, record, tables)] == [
        *("perceptree.table-run/1", "perceptree.checkpoint/1", "perceptree.tables/1"),
    ]
    assert record["training"]["settings"] == result["training"]["settings"]
    assert result["training"]["settings"]["seed"] == 3
    code, printed, _ = call("eval", run / "best.safetensors", posts, "--json")
    boxes = json.loads(printed)["average_precision"]["boxes"]
    assert result["metrics"]["box_ap"] == pytest.approx(boxes["ap"], abs=1e-3)
    code, printed, told = call("tables", posts, "--out", out, *options, "--json")
    assert (code, told, len(json.loads(printed)["rows"])) == (0, "", 4)


@pytest.mark.slow
def test_the_papers_six_models_are_trained_and_listed(
    call: Call, posts: Path, tmp_path: Path
) -> None:
    options = ("--table", 2, "--seeds", 0, *ONE_SMALL_STEP)
    code, printed, _ = call("tables", posts, "--out", tmp_path / "out", *options, "--json")
    assert code == 0
    rows = json.loads(printed)["rows"]
    assert [(row["paper"]["backbone"], row["paper"]["modality"]) for row in rows] == [
        (backbone, modality)
        for backbone in ("R-50", "R-101", "X-101")
        for modality in ("RGB", "Depth")
    ]
    assert all(row["scores"]["mask_ap50"]["mean"] >= 0 for row in rows)


def test_the_models_of_table_3_differ_only_in_their_branches() -> None:
    settings = TableSettings(table=3, minutes=10.0, modality="rgb")
    specs = {row.model.name: settings.spec(row.model) for row in settings.rows()}
    assert {name: (s.modality, s.masks, s.keypoints) for name, s in specs.items()} == {
        "edge-n-rgb-masks": ("rgb", True, False),
        "edge-n-rgb-both": ("rgb", True, True),
        "edge-n-rgb-keypoints": ("rgb", False, True),
        "edge-n-depth-both": ("depth", True, True),
    }
    plan, *others = (settings.training(row.model, 1) for row in settings.rows())
    assert all(other == plan for other in others)
    assert (plan.minutes, plan.schedule, plan.seed) == (10.0, "cosine", 1)
    assert plan.evaluate_every_steps > 1_000_000


def test_starting_files_are_found_by_model_and_modality(tmp_path: Path) -> None:
    torch.manual_seed(0)
    model = TreeRCNN(narrow_spec("rgb", 96, 160))
    save_checkpoint(tmp_path / "edge-n-rgb.safetensors", model, {})
    settings = two_steps(init=str(tmp_path / "{model}-{modality}.safetensors"))
    rgb, depth = (row.model for row in settings.rows())
    assert settings.start(rgb) == tmp_path / "edge-n-rgb.safetensors"
    assert settings.spec(rgb).fpn_width == 16
    assert (settings.spec(rgb).height, settings.spec(rgb).width) == (64, 96)
    with pytest.raises(SettingsError, match=r"edge-n-depth\.safetensors': expected imagenet"):
        settings.spec(depth)
    one = two_steps(init=str(tmp_path / "edge-n-rgb.safetensors"))
    with pytest.raises(SettingsError, match="holds efficientnet_lite0 for rgb, expected"):
        one.spec(depth)


def test_published_weights_freeze_what_the_paper_freezes() -> None:
    settings = TableSettings(table=2, steps=5, init="coco")
    model = TableModel("r50", "depth", BOTH)
    plan = settings.training(model, 0)
    assert (plan.freeze_level, plan.frozen_norms, plan.optimizer) == (2, True, "sgd")
    assert not settings.spec(model).stride_in_1x1


def test_a_training_that_was_finished_but_not_evaluated_is_evaluated(
    posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    model = TableModel("edge-n", "depth", BOTH)
    data = runs.TableData.open(posts, posts, Preparing())
    arguments = (two_steps(steps=1), model, 0, data, tmp_path, ENGINE)
    with monkeypatch.context() as patched:
        patched.setattr(runs, "evaluate", killed)
        with pytest.raises(KeyboardInterrupt):
            runs.make_result(*arguments, Watch())
    told = Told()
    told.watch.run("again", 1, 1)
    assert runs.make_result(*arguments, told.watch)["made"]["steps"] == 1
    assert told.steps == {"again": []}


MISTAKES = {
    "table": (("--table", 4, "--steps", 1), "table is 4: expected one of 2, 3"),
    "no end": (("--table", 3), "expected exactly one of them"),
    "two ends": (("--table", 3, "--steps", 1, "--minutes", 1), "expected exactly one of them"),
    "model": (("--table", 3, "--steps", 1, "--model", "edge-x"), "model is 'edge-x', expected one"),
    "models": (("--table", 3, "--steps", 1, "--model", "r50,r101"), "expected one for table 3"),
    "twice": (("--table", 2, "--steps", 1, "--model", "r50,r50"), "expected at least one, without"),
    "modality": (("--table", 3, "--steps", 1, "--modality", "x"), "modality is 'x'"),
    "both": (("--table", 2, "--steps", 1, "--modality", "rgb"), "table 2 has both"),
    "seeds": (
        ("--table", 3, "--steps", 1, "--seeds", "0;1"),
        "--seeds is '0;1': expected integers",
    ),
    "negative": (("--table", 3, "--steps", 1, "--seeds", "-1"), "seed is -1"),
    "recipe": (("--table", 3, "--steps", 1, "--recipe", "x"), "recipe is 'x': expected one of"),
    "init": (("--table", 3, "--steps", 1, "--init", "x"), "init is 'x': expected imagenet, coco"),
    "size": (("--table", 3, "--steps", 1, "--height", 8), "expected 32 to 8192 px"),
    "device": (("--table", 3, "--steps", 1, "--device", "x"), "device is 'x'"),
    "test": (("--table", 3, "--steps", 1, "--test", "{}/none"), "none"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_invalid_settings_are_one_line_before_any_training(
    call: Call, posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    options, expected = MISTAKES[name]
    monkeypatch.setattr(runs, "train", None)
    filled = [str(option).replace("{}", str(tmp_path)) for option in options]
    code, printed, told = call("tables", posts, "--out", tmp_path / "out", *filled)
    assert (code, printed, told.count("\n")) == (2, "", 1)
    assert expected in told


def test_data_without_masks_or_depth_are_rejected_before_training(
    call: Call, posts: Path, tmp_path: Path, edit_split: Edit
) -> None:
    def strip(content: dict[str, Any]) -> None:
        for tree in content["annotations"]:
            del tree["segmentation"]
        for image in content["images"]:
            del image["depth8_file"]

    edit_split(posts, "test", strip)
    code, _, told = call("tables", posts, "--out", tmp_path / "out", "--table", 3, "--steps", 1)
    assert (code, told.count("\n")) == (2, 1)
    assert "test_RGB.json: masks and depth missing or incomplete; expected masks" in told


def test_several_processes_are_rejected(
    posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(SettingsError, match="expected a single process for tables"):
        build_table(two_steps(), posts, posts, tmp_path / "out", ENGINE)


def test_the_commands_options_become_settings(
    call: Call, posts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def record(*arguments: Any) -> None:
        asked.extend(arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(perceptree.tables, "build_table", record)
    other = tmp_path / "other"
    code, _, told = call(
        "tables",
        posts,
        "--out",
        "o",
        "--table",
        2,
        "--model",
        "r50,edge-m",
        "--minutes",
        3,
        "--seeds",
        "4,5",
        "--recipe",
        "scratch",
        "--init",
        "coco",
        "--batch",
        4,
        "--test",
        other,
        "--device",
        "cuda",
        "--precision",
        "bf16",
    )
    assert (code, told) == (130, "perceptree: interrupted; run the same command again to resume\n")
    assert asked[:5] == [
        TableSettings(
            table=2,
            models=("r50", "edge-m"),
            seeds=(4, 5),
            minutes=3.0,
            recipe="scratch",
            init="coco",
            batch=4,
        ),
        posts,
        other,
        Path("o"),
        Engine(device="cuda", precision="bf16"),
    ]
