"""A kernel compiled from older sources is never loaded."""

from pathlib import Path

from numba.core import config

from perceptree.simulator.rendering.kernel_cache import sources_sha256, versioned_cache


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
