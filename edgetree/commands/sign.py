"""`edgetree sign`: sign a model file, or make a pair of keys for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from basetree.program.console import note, tell
from basetree.program.quoting import quoted

if TYPE_CHECKING:
    from edgetree.signing import Statement


def sign(
    model: Annotated[
        Path | None,
        typer.Argument(metavar="MODEL", help="A file of `edgetree export`.", show_default=False),
    ] = None,
    *,
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Private key to sign with.")
    ] = None,
    version: Annotated[
        int | None,
        typer.Option(
            help="Version of the model. Machines refuse lower ones than they have used.",
            show_default="the time of signing, such as 20261123080000",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            help="Name of the model, whose versions are counted.",
            show_default="the name in the file",
        ),
    ] = None,
    valid_until: Annotated[
        str | None,
        typer.Option(
            metavar="DATE",
            help="Last day of the signature's validity, in UTC.",
            show_default="no end",
        ),
    ] = None,
    new_key: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Instead of signing: make a private key in FILE, and its public key beside it with"
            " the suffix .pub.",
        ),
    ] = None,
    encrypt: Annotated[
        bool, typer.Option("--encrypt", help="With --new-key: ask for a passphrase.")
    ] = False,
) -> None:
    """Sign a model file. The signature is written to MODEL.sig.

    Machines that require signatures open only models signed with a key that they trust, see
    `edgetree trust`.
    """
    from basetree.errors import InputError

    if new_key is not None:
        if model is not None or key is not None:
            raise InputError("--new-key given with MODEL or --key: expected only one of them")
        of_signature = {"--version": version, "--name": name, "--valid-until": valid_until}
        given = [option for option, value in of_signature.items() if value is not None]
        if given:
            raise InputError(
                f"{given[0]} given with --new-key: expected it with MODEL, as it is of a signature"
            )
        _make_key(new_key, encrypt)
        return
    if model is None or key is None:
        raise InputError("MODEL or --key is missing: expected both, or --new-key FILE")
    if encrypt:
        raise InputError("--encrypt given without --new-key: expected it when a key is made")
    _sign(model, key, version, name, valid_until)


def _make_key(path: Path, encrypt: bool) -> None:
    from edgetree.signing import new_key

    passphrase = None
    if encrypt:
        passphrase = typer.prompt(
            "passphrase", hide_input=True, confirmation_prompt=True, err=True, type=str
        )
    public, identity = new_key(path, passphrase)
    tell(f"private key  {path}  (keep it with the signer)")
    tell(f"public key   {public}  (for the machines)")
    tell(f"key id       {identity}")
    note(f"next: edgetree sign MODEL --key {quoted(path)}", whole=True)


def _sign(
    model: Path, key: Path, version: int | None, name: str | None, valid_until: str | None
) -> None:
    from edgetree.signing import read_private_key, sign_model
    from edgetree.signing.statement import end_of_day

    end = None if valid_until is None else end_of_day(valid_until)
    private = read_private_key(key, lambda: typer.prompt("passphrase", hide_input=True, err=True))
    file, statement = sign_model(model, private, version=version, name=name, valid_until=end)
    tell(f"signature  {file}")
    for line in statement_lines(statement):
        tell(line)
    note(f"next, on the machine: edgetree trust --check {quoted(model.name)}", whole=True)


def statement_lines(statement: Statement) -> list[str]:
    """What a signature says, as lines of text."""
    until = "without end" if statement.valid_until is None else f"until {statement.valid_until}"
    return [
        f"model      {statement.name}",
        f"version    {statement.version}",
        f"valid      from {statement.valid_from}, {until}",
        f"SHA-256    {statement.file_sha256}",
    ]
