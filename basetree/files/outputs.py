"""The old name of `basetree.files.writing`, which goes on for one version with a warning."""

from basetree.deprecation import moved_names

__all__: list[str] = []

_NAMES = ("check_paths", "output_folder", "replacing", "text_file")
__getattr__ = moved_names(__name__, {name: f"basetree.files.writing.{name}" for name in _NAMES})
