"""`edgetree trust`: the keys whose models may be opened, and whether signatures are required."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.program.console import note, tell

if TYPE_CHECKING:
    from edgetree.signing import TrustFile


def trust(
    key: Annotated[
        Path | None,
        typer.Argument(metavar="KEY", help="Public key to trust, a .pub file.", show_default=False),
    ] = None,
    *,
    valid_until: Annotated[
        str | None,
        typer.Option(
            metavar="DATE",
            help="Last day on which KEY is trusted, in UTC.",
            show_default="no end",
        ),
    ] = None,
    remove: Annotated[
        str | None, typer.Option(metavar="ID", help="Id of a key to trust no longer.")
    ] = None,
    require: Annotated[
        bool | None,
        typer.Option(
            "--require/--no-require",
            help="Refuse models without a signature by a trusted key, or open them.",
        ),
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL", help="Check the signature of a model file, without opening it."
        ),
    ] = None,
) -> None:
    """Show or change the trusted keys, and whether models must be signed.

    Run as root, it changes the machine's file, which holds for all accounts. Otherwise it changes
    the file of your account; if the machine requires signatures, that file does not count.
    """
    from basetree.errors import InputError

    if valid_until is not None and key is None:
        raise InputError("--valid-until given without KEY: expected both")
    if check is not None:
        if key is not None or remove is not None or require is not None:
            raise InputError("--check given with a change: expected only one of them")
        _check_model(check)
        return
    if key is not None or remove is not None or require is not None:
        _change(key, valid_until, remove, require)
    for line in _listing():
        tell(line)


def _change(
    key: Path | None, valid_until: str | None, remove: str | None, require: bool | None
) -> None:
    from edgetree.signing.keys import ed25519, read_public_key
    from edgetree.signing.trust import TrustedKey, change_trust_file, own_file

    end = None if valid_until is None else _end_of(valid_until)

    def change(content: TrustFile) -> TrustFile:
        if key is not None:
            content = content.with_key(TrustedKey.of(read_public_key(key), key.stem, end))
        if remove is not None:
            content = content.without_key(remove)
        if require is not None:
            if require:
                ed25519()  # or no model could be opened
            content = dataclasses.replace(content, require_signature=require)
        return content

    path = own_file()
    change_trust_file(path, change)
    note(f"changed: {path}")


def _end_of(date: str) -> str:
    """The last second of a day that is not over."""
    from basetree.errors import InputError
    from edgetree.signing.statement import end_of_day, parse_time

    end = end_of_day(date)
    if parse_time(end) < datetime.now(UTC):
        raise InputError(f"--valid-until is {date}: expected today or a later day")
    return end


def _listing() -> Iterator[str]:
    """What holds for this account."""
    from edgetree.errors import SignatureError
    from edgetree.signing import current_trust
    from edgetree.signing.trust import account_file
    from edgetree.signing.used_versions import read_used, used_file

    holds = current_trust()
    by = holds.required_by
    yield f"signatures  {'not required' if by is None else f'required by {by}'}"
    for key in holds.keys.values():
        end = "" if key.valid_until is None else f"  valid until {key.valid_until}"
        yield f"key         {key.id}  {key.name}{end}"
    if not holds.keys:
        yield "key         none"
    own = account_file()
    if own is not None and own not in holds.files and own.exists():
        yield f"not in use  {own}, as {by} requires signatures by its own keys"
    try:
        state = used_file()
        for model in read_used(state).models:
            yield f"used        {model.name}  version {model.version}  ({state})"
    except SignatureError as error:
        yield f"used        not known: {error}"


def _check_model(model: Path) -> None:
    from edgetree.commands.sign import statement_lines
    from edgetree.model_file.safety_check import check_is_file
    from edgetree.signing import check_signature, current_trust

    check_is_file(model)
    accepted = check_signature(model, current_trust())
    tell(f"accepted   {model}")
    if accepted.key is not None and accepted.statement is not None:
        tell(f"key        {accepted.key.id}  {accepted.key.name}")
        for line in statement_lines(accepted.statement):
            tell(line)
