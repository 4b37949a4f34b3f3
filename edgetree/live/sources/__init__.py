"""The old name of `edgetree.sources`, which goes on for one version with a warning."""

from basetree.deprecation import moved_names

__all__: list[str] = []

_NAMES = (
    "SOURCE_FORMS",
    "PushedFrames",
    "frame_from_arrays",
    "open_camera",
    "open_drive",
    "open_files",
    "open_live_source",
    "open_oak",
    "open_orbbec",
    "open_realsense",
    "open_recording",
)
__getattr__ = moved_names(__name__, {name: f"edgetree.sources.{name}" for name in _NAMES})
