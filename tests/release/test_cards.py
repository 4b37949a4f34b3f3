"""Cards of the shipped models, and the scenes that a new one begins with."""

import json
from pathlib import Path

import pytest

from release import scenes
from release.card_page import page
from release.cards import SAME_WEIGHTS, training_record

ROOT = Path(__file__).resolve().parents[2]
CARDS = sorted((ROOT / "edgetree/assets/models").glob("*.json"))
MODELS = sorted((ROOT / "models").glob("*.json"))


@pytest.mark.parametrize("path", CARDS, ids=lambda path: path.stem)
def test_the_page_of_a_card_is_that_of_its_figures(path: Path) -> None:
    assert page(json.loads(path.read_text("utf-8"))) == path.with_suffix(".md").read_text("utf-8")


@pytest.mark.parametrize("path", CARDS, ids=lambda path: path.stem)
def test_a_card_tells_the_training_of_the_checkpoint_with_its_weights(path: Path) -> None:
    record = training_record(path, ROOT / "checkpoints")
    assert record is not None
    told = json.loads(path.read_text("utf-8"))["training"]
    assert (told["steps"], told["seed"]) == (record["steps"], record["settings"]["seed"])


def test_models_with_the_same_weights_share_a_checkpoint() -> None:
    kept = {path.stem for path in (ROOT / "checkpoints").glob("*.safetensors")}
    assert kept == {path.stem for path in (*CARDS, *MODELS)} - set(SAME_WEIGHTS)


def test_a_card_begins_with_the_scenes_of_the_datasets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tmp_path / "paper-7"
    (data / "scenes").mkdir(parents=True)
    (data / "settings.json").write_text('{"seed": 7}')
    for number, split in enumerate(("train", "val", "test")):
        (data / "scenes" / f"{number}.json").write_text("[]")
        (data / f"{split}_RGB.json").write_text('{"images": [{}, {}]}')
    before = {"training_scenes": [{"use": "training", "seed": 1}, {"use": "ranges of INT8"}]}
    (tmp_path / "before.json").write_text(json.dumps(before))
    card = tmp_path / "after.json"
    words = [str(card), "--after", str(tmp_path / "before.json")]
    words += ["--training", str(data), "--ranges", str(data)]
    monkeypatch.setattr("sys.argv", ["scenes", *words])
    scenes.main()
    found = json.loads(card.read_text("utf-8"))["training_scenes"]
    entry = {"data": "paper-7", "seed": 7, "scenes": 3, "frames": 6}
    assert found == [
        {"use": "training", "seed": 1},
        {"use": "training", **entry},
        {"use": "ranges of INT8", **entry},
    ]
