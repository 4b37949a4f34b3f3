"""Public names of the last version that are elsewhere now."""

from __future__ import annotations

import importlib

import pytest

from edgetree.frames import Frame

OLD = {
    "edgetree.frames": ("FrameSource", "open_source"),
    "edgetree.live": ("LiveSource", "SourceLost"),
    "edgetree.live.sources": ("PushedFrames", "frame_from_arrays", "open_live_source"),
    "edgetree.live.sinks": ("CsvTracksSink", "MapOrigin", "live_record", "stems_message"),
}


@pytest.mark.parametrize("module", OLD)
def test_old_names_go_on_with_a_warning(module: str) -> None:
    for name in OLD[module]:
        with pytest.warns(DeprecationWarning, match=rf"{module}\.{name} is edgetree\."):
            assert getattr(importlib.import_module(module), name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = importlib.import_module(module).nothing


def test_a_live_frame_is_made_as_before() -> None:
    with pytest.warns(DeprecationWarning, match="is edgetree.frames.stream_frame now"):
        from edgetree.live import LiveFrame
    frame = LiveFrame(3, 0.5, None, depth_fault="broken")
    assert isinstance(frame, Frame)
    assert (frame.name, frame.number, frame.time_s, frame.depth_fault) == (
        "frame_000003",
        3,
        0.5,
        "broken",
    )
