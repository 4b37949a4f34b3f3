"""What all cameras with a maker's package have in common."""

from __future__ import annotations

import pytest

from edgetree.frames.frame import Frame
from edgetree.sources.cameras.device import Device
from edgetree.sources.source import SourceLost


class Unplugged(Device):
    """A camera that is pulled out, so that it can neither be read nor stopped."""

    stops = 0

    def _start(self) -> None:
        pass

    def _stop(self) -> None:
        self.stops += 1
        raise RuntimeError("no such device")

    def _poll(self) -> Frame | None:
        raise RuntimeError("no such device")


def test_an_unplugged_camera_is_lost_and_can_be_closed() -> None:
    camera = Unplugged("camera", None, (RuntimeError,))
    with pytest.raises(SourceLost, match=r"camera stopped \(no such device\)"):
        next(iter(camera))
    camera.close()
    camera.close()
    assert camera.stops == 1
