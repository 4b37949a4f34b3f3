"""`edgetree config`: check and show the set-up file of `edgetree live`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from basetree.counts import counted
from basetree.program.command_line import show_help
from basetree.program.console import note, tell
from basetree.program.help import new_app
from basetree.program.options import expand_groups
from basetree.program.setup_file import lines_named, read_setup, setup_keys, setup_text
from basetree.program.talking import TalkOptions
from edgetree.commands.config_files import check_inputs, folder_warnings
from edgetree.commands.csv_options import CsvOptions
from edgetree.commands.live import ModelOptions, checked_set_up, live_command
from edgetree.commands.live_options import (
    LiveMetresOptions,
    LivePageOptions,
    LiveSourceOptions,
)
from edgetree.commands.live_outputs import LiveOutputs, LiveRecordOptions
from edgetree.commands.option_groups import SessionOptions
from edgetree.sinks.mqtt_settings import MqttSettings

config = new_app("Check and show the set-up file of `edgetree live --config`.")


@config.callback(invoke_without_command=True)
def options(context: typer.Context) -> None:
    """Print the help if no command is given."""
    show_help(context)


@config.command(epilog="edgetree config check edgetree.toml")
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The set-up file.")],
) -> None:
    """Check a set-up file: its keys and values, and the files that it names.

    Nothing is opened: neither camera nor model, port or broker. A folder of an output that does not
    exist here is a warning, as the file may be checked on another computer than the machine.
    """
    from basetree.errors import InputError

    setup = read_setup(file, live_command)
    with lines_named(setup):
        if "source" not in setup.values:
            raise InputError(f"{file}: source is missing: expected a camera or a recording")
        defaults = {key.parameter: key.default for key in setup_keys(live_command).values()}
        _check_options(**_typed({**defaults, **setup.values}))
    tell(f"{file}: {counted(len(setup.lines), 'setting')}, all valid")


@config.command(epilog="edgetree config show edgetree.toml")
def show(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="The set-up file; without it, all defaults are shown."),
    ] = None,
) -> None:
    """Print every setting with its meaning: as it is set, or the default as a comment.

    What it prints is a set-up file: `edgetree config show > edgetree.toml` begins one.
    """
    setup = None if file is None else read_setup(file, live_command)
    for line in setup_text(live_command, setup).splitlines():
        tell(line)


@expand_groups
def _check_options(
    source: str,
    *,
    model_options: ModelOptions,
    metres: LiveMetresOptions,
    source_options: LiveSourceOptions,
    page_options: LivePageOptions,
    outputs: LiveOutputs,
    mqtt: MqttSettings,
    csv_options: CsvOptions,
    record_options: LiveRecordOptions,
    session: SessionOptions,
    talk: TalkOptions,
) -> None:
    """Check what `edgetree live` checks before it opens anything."""
    page_options.check(source)
    csv_options.style(outputs.csv)
    checked_set_up(
        source, model_options.model, metres, source_options, outputs, mqtt, record_options
    )
    check_inputs(source, model_options.model, source_options.depth)
    for line in folder_warnings(outputs.paths):
        note(line)


def _typed(values: dict[str, Any]) -> dict[str, Any]:
    """The values as the command gets them: paths are texts in a set-up file."""
    keys = {key.parameter: key for key in setup_keys(live_command).values()}
    return {
        name: Path(value) if keys[name].kind is Path and value is not None else value
        for name, value in values.items()
    }
