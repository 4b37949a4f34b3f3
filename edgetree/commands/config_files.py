"""What `edgetree config check` asks of the files that a set-up file names, without opening them."""

from __future__ import annotations

from pathlib import Path

from basetree.errors import InputError
from edgetree.commands.live_options import names_no_path


def check_inputs(source: str, model: str | None, depth: Path | None) -> None:
    """Check that what is read exists.

    Args:
        source: The setting `source`: a camera, or the path of a recording or of files.
        model: The setting `model`, a name or a path; None for the packaged model.
        depth: The setting `depth`.

    Raises:
        InputError: A file or folder does not exist, or no model has this name.
    """
    from edgetree.catalogue import find_model
    from edgetree.sources.live import SOURCE_FORMS

    if model is not None and not find_model(model).is_file():
        raise InputError(f"--model is {model}, which does not exist: expected an .onnx file")
    if not (names_no_path(source) or Path(source).exists()):
        raise InputError(f"--source is {source}, which does not exist: expected {SOURCE_FORMS}")
    if depth is not None and not depth.exists():
        raise InputError(f"--depth is {depth}, which does not exist: expected depth images")


def folder_warnings(outputs: dict[str, Path]) -> list[str]:
    """A warning for each output whose folder does not exist.

    It is no error: the file may be checked on another computer than the machine.

    Args:
        outputs: The files and folders that are written, by option.
    """
    return [
        f"warning: {option.lstrip('-')} is {path}, whose folder does not exist on this computer"
        for option, path in outputs.items()
        if not path.parent.is_dir()
    ]
