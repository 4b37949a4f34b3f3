"""`edgetree demo --train`: missing packages, and the accuracy of its model (slow)."""

import json
import subprocess
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from basetree.errors import MissingPackage
from edgetree.demo import training

TIME_LIMIT_S = 15 * 60


def test_missing_packages_are_named_with_the_pip_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_two(name: str) -> ModuleSpec | None:
        return None if name in ("timm", "numba") else ModuleSpec(name, None)

    monkeypatch.setattr(training, "find_spec", without_two)
    with pytest.raises(MissingPackage) as caught:
        training.run_trained(tmp_path, lambda share, what: None)
    message = str(caught.value)
    assert message.startswith("demo --train needs timm, numba: pip install")
    assert 'pip install ".[cpu,train,export,sim]"' in message
    assert "\n" not in message
    assert caught.value.exit_code == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_newly_trained_model_finds_trees_in_held_out_scenes(tmp_path: Path) -> None:
    code = "from edgetree.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "demo", "--train", "--json", "--out", "made"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=2 * TIME_LIMIT_S,
    )
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    data = json.loads(line)
    figures = data["training"]
    assert figures["test"]["box_ap50"] >= 40.0
    assert figures["parity"]["box_px_max"] <= 0.5
    assert figures["parity"]["score_max"] <= 1e-3
    assert data["duration_s"] <= TIME_LIMIT_S
    (model,) = data["models"].values()
    assert model["found_trees"] >= 0.3 * model["true_trees"]
    assert model["errors"]["diameter_m"]["measured"] > 0
    html = (tmp_path / data["report"]).read_text("utf-8")
    assert "From nothing to this model" in html
    assert html.count("data:image/jpeg") == 6
