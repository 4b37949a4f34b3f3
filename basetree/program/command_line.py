"""What the command lines of all programs have in common."""

from __future__ import annotations

from typing import Annotated, NoReturn, TypeAlias

import typer

from basetree.errors import MissingPackage
from basetree.program.process import run_command_line


def _print_version(context: typer.Context, asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"{context.info_name} {version('edgetree')}")
        raise typer.Exit


Version: TypeAlias = Annotated[
    bool,
    typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version."),
]
"""The option of a program's callback that prints its name and version."""


def show_help(context: typer.Context) -> None:
    """Print the help if no command is given."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run_app(app: typer.Typer, name: str, *, resume: str = "", extras: str = "") -> NoReturn:
    """Run the command line of a program and exit.

    Exit codes: 0 success, 1 a check failed, 2 wrong usage or bad input, 130 interrupted, 143 ended
    by SIGTERM.

    Args:
        app: The program.
        name: Its name.
        resume: What an interrupted command tells the user to do.
        extras: Extras of the project that a module that is not installed belongs to.
    """

    def run() -> object:
        try:
            return typer.main.get_command(app).main(prog_name=name, standalone_mode=False)
        except ModuleNotFoundError as error:
            if not extras:
                raise
            raise MissingPackage(f'{error}: install with pip install ".[{extras}]"') from error

    run_command_line(name, run, resume)
