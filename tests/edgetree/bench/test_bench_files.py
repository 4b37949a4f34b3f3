"""The files of networks given by name."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import edgetree.export
from basetree.errors import InputError, MissingPackage
from edgetree.bench.files import NETWORKS, NetworkFiles, cache_folder
from edgetree.export import ExportSettings
from edgetree.model_file.manifest import Manifest


@pytest.fixture
def said() -> list[str]:
    """Progress messages."""
    return []


def files_of(folder: Path, *names: str, **changes: Any) -> NetworkFiles:
    """Files of 640x384 px."""
    return NetworkFiles(names, folder, **({"sizes": ((640, 384),)} | changes))


def test_existing_files_are_not_exported(
    tmp_path: Path, rgb_manifest: Manifest, write_model: Callable[..., Path], said: list[str]
) -> None:
    mine = write_model(rgb_manifest, "mine-fp32-640x384.onnx")
    files = files_of(tmp_path, "mine")
    files.export_missing(said.append)
    assert [file.path for file in files.files()] == [mine]
    assert said == []


def test_missing_files_are_exported_untrained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[str]
) -> None:
    asked: dict[str, ExportSettings] = {}

    def export_preset(preset: str, out: Path, *, settings: ExportSettings, say: object) -> None:
        asked[preset] = settings
        out.write_bytes(b"a model")

    monkeypatch.setattr(edgetree.export, "export_preset", export_preset)
    folder = tmp_path / "new"
    files = files_of(folder, "r50", "edge-n", precisions=("int8",), proposals=300)
    files.export_missing(said.append)
    assert files.files()[0].path == folder / "r50-int8-640x384-300p.onnx"
    assert all(file.path.is_file() for file in files.files())
    assert asked["edge-n"] == ExportSettings(384, 640, proposals=300, precision="int8")
    assert "untrained" in said[0]
    asked.clear()
    files.export_missing(said.append)
    assert asked == {}


def test_every_network_is_there_in_every_precision_and_size(tmp_path: Path) -> None:
    files = files_of(
        tmp_path, "r50", "edge-n", precisions=("fp32", "int8"), sizes=((640, 384), (800, 800))
    ).files()
    assert len({file.path for file in files}) == 8
    assert {(file.precision, file.width, file.height) for file in files} == {
        (precision, *size) for precision in ("fp32", "int8") for size in ((640, 384), (800, 800))
    }


def test_files_for_different_providers_have_different_names(tmp_path: Path) -> None:
    plain = files_of(tmp_path, "r50", provider="auto").files()[0]
    assert plain.path.name == "r50-fp32-640x384.onnx"
    for_gpu = files_of(tmp_path, "r50", provider="cuda", precisions=("fp16",)).files()[0]
    assert for_gpu.path.name == "r50-fp16-640x384-cuda.onnx"


def test_an_unknown_name_is_rejected_before_any_export(tmp_path: Path, said: list[str]) -> None:
    with pytest.raises(InputError, match=r"'r5' has no file .* expected one of edge-n, edge-s"):
        files_of(tmp_path, "r50", "r5").export_missing(said.append)
    assert said == []


def test_the_networks_are_those_of_perceptree() -> None:
    pytest.importorskip("torch")
    from perceptree.models import PRESETS

    assert set(NETWORKS) == set(PRESETS)


BAD_SETTINGS = {
    "no name": ({"networks": ("",)}, "--backbones is ''"),
    "a name twice": ({"networks": ("r50", "r50")}, "--backbones is 'r50,r50'"),
    "a precision": ({"precisions": ("fp4",)}, "--precision is 'fp4': expected fp32, fp16, int8"),
    "a precision twice": ({"precisions": ("int8", "int8")}, "--precision is 'int8,int8'"),
    "a provider": ({"provider": "npu"}, "--provider is 'npu': expected one of auto, cpu, cuda"),
    "a size": ({"sizes": ((800, 0),)}, "--size is 800x0: expected 32 px or more each way"),
}


@pytest.mark.parametrize("case", BAD_SETTINGS)
def test_invalid_settings_are_rejected(tmp_path: Path, case: str) -> None:
    changes, message = BAD_SETTINGS[case]
    with pytest.raises(InputError, match=message):
        NetworkFiles(**({"networks": ("r50",), "folder": tmp_path} | changes))


def test_files_are_stored_in_the_users_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder().parent == tmp_path / "edgetree"
    assert cache_folder().name.startswith("models-")


def test_exporting_without_the_training_packages_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from edgetree.export import export_preset

    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(MissingPackage, match=r'onnx is not installed: pip install "\.\[cpu,tr'):
        export_preset("edge-n", tmp_path / "model.onnx")
    assert list(tmp_path.iterdir()) == []
