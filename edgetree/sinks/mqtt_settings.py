"""How messages go to an MQTT broker: topics, quality of service, user and encryption."""

from __future__ import annotations

import ssl
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Final

from basetree.errors import InputError, InputFileError
from basetree.settings import Settings, label, limits, option

_PASSWORD_BYTES: Final = 4096
_LONGEST_TOPIC: Final = 1000


@dataclass(frozen=True)
class MqttSettings(Settings, error=InputError):
    """How messages go to an MQTT broker."""

    option_prefix: ClassVar[str] = "mqtt_"
    panel: ClassVar[str] = "MQTT"

    topic: str = "edgetree/stems"
    """Topic of the stems of each frame, for --mqtt."""
    state_topic: str = "edgetree/state"
    """Topic of the state of the service, retained; if it vanishes, the broker says `gone`."""
    qos: int = field(default=0, metadata=limits(0, 2, whole=True) | label("--mqtt-qos"))
    """Quality of service of the stems."""
    user: str | None = None
    """Name at the broker."""
    password_file: Path | None = field(default=None, metadata=option(metavar="FILE"))
    """File whose first line is the password at the broker."""
    tls: bool = field(default=False, metadata=option("--mqtt-tls"))
    """Encrypt the connection, and trust the broker by the authorities of the system."""
    ca: Path | None = field(default=None, metadata=option(metavar="FILE"))
    """Encrypt the connection, and trust the broker by the authorities in this PEM file."""
    certificate: Path | None = field(default=None, metadata=option(metavar="FILE"))
    """PEM file with the certificate by which the broker knows this machine."""
    key: Path | None = field(default=None, metadata=option(metavar="FILE"))
    """PEM file with the key of the certificate, if that file does not hold it."""

    def _check_together(self) -> None:
        for name, topic in (("topic", self.topic), ("state-topic", self.state_topic)):
            if not topic or len(topic) > _LONGEST_TOPIC or set("+#\0") & set(topic):
                raise InputError(f"--mqtt-{name} is {topic!r}: expected a name without + and #")
        if self.topic == self.state_topic:
            raise InputError(
                f"--mqtt-topic and --mqtt-state-topic are both {self.topic!r}: expected two topics"
            )
        if self.password_file is not None and self.user is None:
            raise InputError("--mqtt-password-file given without --mqtt-user: expected both")
        if self.key is not None and self.certificate is None:
            raise InputError("--mqtt-key given without --mqtt-certificate: expected both")

    @property
    def is_encrypted(self) -> bool:
        """Whether the connection is encrypted."""
        return self.tls or self.ca is not None or self.certificate is not None

    def password(self) -> str | None:
        """The password; None without a file.

        Raises:
            InputFileError: The file cannot be read, or begins with an empty line.
        """
        if self.password_file is None:
            return None
        from basetree.files.reading import read_text

        path = self.password_file
        password = read_text(path, "a password in its first line", _PASSWORD_BYTES).split("\n")[0]
        if not password:
            raise InputFileError(f"{path}: the first line is empty, expected a password")
        return password

    def tls_context(self) -> ssl.SSLContext | None:
        """What checks the broker and knows this machine's certificate; None without encryption.

        Raises:
            InputFileError: A file cannot be read, or is no PEM file of its kind.
        """
        if not self.is_encrypted:
            return None
        context = ssl.create_default_context()
        if self.ca is not None:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            try:
                context.load_verify_locations(self.ca)
            except OSError as error:
                raise _unusable(self.ca, error, "certificates of authorities (PEM)") from error
        if self.certificate is not None:
            try:
                context.load_cert_chain(self.certificate, self.key, password=lambda: "")
            except OSError as error:
                path = self.key or self.certificate
                expected = "a certificate and its key without a passphrase (PEM)"
                raise _unusable(path, error, expected) from error
        return context


def _unusable(path: Path, error: OSError, expected: str) -> InputFileError:
    reason = "not such a file" if isinstance(error, ssl.SSLError) else error.strerror
    return InputFileError(f"{path}: cannot be used ({reason}), expected {expected}")
