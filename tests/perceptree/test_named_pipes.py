"""A named pipe in place of a file is refused at once; nobody waits for a writer."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from basetree.errors import InputError
from perceptree.data.dataset import read_labels
from perceptree.data.layouts import LabelFile
from perceptree.simulator import SimulatorSettings
from perceptree.simulator.settings.reading import read_settings
from perceptree.training.run_log import read_log

READERS = {
    "settings": lambda path: read_settings(path, SimulatorSettings()),
    "labels": lambda path: read_labels(LabelFile("train", None, False, path, path.parent)),
    "log": lambda path: read_log(path.parent),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_a_named_pipe_is_refused(tmp_path: Path, read) -> None:
    path = tmp_path / "log.jsonl"
    os.mkfifo(path)
    with pytest.raises(InputError, match="a named pipe"):
        read(path)
