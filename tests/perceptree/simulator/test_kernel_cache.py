"""A kernel compiled from older sources is never loaded."""

from pathlib import Path

import pytest
from numba.core import config

from perceptree.simulator.dataset import pool
from perceptree.simulator.kernel_cache import is_compiled, sources_sha256, versioned_cache


def test_any_change_of_any_source_changes_the_version(tmp_path: Path):
    (tmp_path / "a.py").write_text("x = 1\n")
    (tmp_path / "b.py").write_text("y = 1\n")
    before = sources_sha256(tmp_path)
    assert sources_sha256(tmp_path) == before
    (tmp_path / "b.py").write_text("y = 2\n")
    changed = sources_sha256(tmp_path)
    (tmp_path / "b.py").rename(tmp_path / "c.py")
    assert len({before, changed, sources_sha256(tmp_path)}) == 3


def test_kernels_are_kept_by_version_and_other_code_is_left_alone(monkeypatch):
    monkeypatch.setattr(config, "CACHE_DIR", "")
    with versioned_cache():
        assert config.CACHE_DIR.endswith(sources_sha256()[:16])
    assert config.CACHE_DIR == ""


def test_a_cache_folder_that_the_user_set_is_used(monkeypatch):
    monkeypatch.setattr(config, "CACHE_DIR", "mine")
    with versioned_cache():
        assert config.CACHE_DIR == "mine"
    assert config.CACHE_DIR == "mine"


def test_whether_kernels_are_compiled_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not is_compiled()
    (tmp_path / "rendering_1").mkdir()
    (tmp_path / "rendering_1" / "rasterise.fill-12.py311.nbi").touch()
    assert is_compiled()


def test_the_first_simulation_says_that_it_compiles(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    class Started(Exception):
        pass

    def start(kind: str) -> None:
        raise Started

    monkeypatch.setattr(pool.multiprocessing, "get_context", start)
    for compiled, told in ((True, 0), (False, 1)):
        monkeypatch.setattr(pool, "is_compiled", lambda compiled=compiled: compiled)
        with pytest.raises(Started):
            next(pool.draw_scenes([object()], 1))
        assert caplog.text.count("the renderer is compiled before the first frame") == told
