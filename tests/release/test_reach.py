"""The reach of the labels in a model file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from edgetree import TreeDetector, default_model
from release import reach


def test_the_reach_of_a_dataset_is_written_into_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, model = tmp_path / "data", tmp_path / "model.onnx"
    data.mkdir()
    settings = {"settings": {"labels": {"reach_m": 14.0}}}
    (data / "settings.json").write_text(json.dumps(settings), "utf-8")
    shutil.copy(default_model("depth"), model)
    monkeypatch.setattr("sys.argv", ["reach", str(model), str(data)])

    reach.main()

    assert TreeDetector.load(model).manifest.reach_m == 14.0
