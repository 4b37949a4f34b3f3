"""Which files and folders are recordings, by their names."""

from pathlib import Path
from typing import Final

BAG_SUFFIXES: Final = (".bag", ".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Whether a path looks like a recording by its name, or by the names in its folder."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(storage_files(path))
    return path.suffix.lower() in BAG_SUFFIXES


def storage_files(folder: Path) -> list[Path]:
    """The files of a ROS 2 bag in its folder."""
    return sorted(path for path in folder.iterdir() if path.suffix in (".mcap", ".db3"))
