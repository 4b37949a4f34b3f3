"""Write an evaluation to a folder: `report.json` and a self-contained HTML page."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from basetree.files.writing import write_text
from perceptree.data import FrameStore
from perceptree.errors import DatasetError
from perceptree.evaluation.figures import About, figures_of
from perceptree.evaluation.metrics import Measured, Progress, measure
from perceptree.evaluation.predictions import Chances, Predict
from perceptree.evaluation.report_page import report_page

JSON_FILE, PAGE_FILE = "report.json", "report.html"


@dataclass(frozen=True, eq=False)
class Report:
    """Result of an evaluation.

    Attributes:
        figures: JSON-ready results.
        measured: Predictions and intermediate results.
    """

    figures: dict[str, Any]
    measured: Measured

    def write(self, folder: Path) -> Path:
        """Write both files into `folder`.

        Returns:
            Path of the HTML page.

        Raises:
            InputFileError: If a file cannot be written.
        """
        text = json.dumps(self.figures, indent=1, allow_nan=False)
        page = report_page(self.figures, self.measured)
        write_text(folder / JSON_FILE, text)
        write_text(folder / PAGE_FILE, page)
        return folder / PAGE_FILE


def make_report(
    predict: Predict,
    store: FrameStore,
    about: About,
    batch: int = 1,
    progress: Progress = lambda frames: None,
    chances: Chances | None = None,
) -> Report:
    """Evaluate a detector on all frames.

    Args:
        predict: The detector.
        store: Labelled frames.
        about: Description of model and data.
        batch: Batch size.
        progress: Called with the number of frames done since its last call.
        chances: By which the scores are multiplied, as for `predict_frames`.

    Raises:
        DatasetError: If no tree is labelled.
    """
    measured = measure(predict, store, batch, progress, chances)
    return Report(figures_of(measured, about), measured)


def report_folder(folder: Path) -> None:
    """Create a report's folder and check that it is writable, before any work is done.

    Raises:
        DatasetError: If it cannot be created or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise DatasetError(
            f"{folder}: cannot be written ({error.strerror}), expected a writable folder or one"
            " that can be created"
        ) from error
