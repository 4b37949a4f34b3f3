"""An evaluation as a folder: ``report.json`` and a page that needs nothing else."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.writing import write_whole
from perceptree.data import FrameStore
from perceptree.errors import DatasetError
from perceptree.evaluation.figures import About, figures_of
from perceptree.evaluation.metrics import Measured, Progress, measure
from perceptree.evaluation.predictions import Predict

JSON_FILE, PAGE_FILE = "report.json", "report.html"


@dataclass(frozen=True, eq=False)
class Report:
    """``figures`` is JSON-ready; ``measured`` what they were taken from."""

    figures: dict[str, Any]
    measured: Measured

    def write(self, folder: Path) -> Path:
        """Write both files into ``folder`` and return the page's path.

        Raises InputFileError where they cannot be written.
        """
        from perceptree.evaluation.report_page import report_page

        text = json.dumps(self.figures, indent=1, allow_nan=False)
        page = report_page(self)
        write_whole(folder / JSON_FILE, text.encode())
        write_whole(folder / PAGE_FILE, page.encode())
        return folder / PAGE_FILE


def make_report(
    predict: Predict,
    store: FrameStore,
    about: About,
    batch: int = 1,
    progress: Progress = lambda frames: None,
) -> Report:
    """All that is to be said of ``predict`` on the frames of ``store``.

    ``progress`` gets the number of frames done since its last call. Raises DatasetError where
    ``store`` has no labelled tree.
    """
    measured = measure(predict, store, batch, progress)
    return Report(figures_of(measured, about), measured)


def report_folder(folder: Path) -> None:
    """Make the folder of a report, before any work is done.

    Raises DatasetError where it cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise DatasetError(
            f"{folder}: cannot be written ({error.strerror}), expected a folder that is there or"
            " can be made"
        ) from error
