"""Passwords and tokens in what is shown: messages, logs, names of sources, records and reports."""

from __future__ import annotations

import re
from typing import Final

HIDDEN: Final = "..."
"""What stands in place of a secret."""

_WORDS: Final = (
    r"pass(?:word|wd|phrase|code)?|pw|pwd|pswd|secret|token|credentials?|auth|signature|sig"
    r"|(?:api|access|secret|private)[-_]?key"
)
_NAME: Final = re.compile(rf"(?:[\w-]*[-_])?(?:{_WORDS})", re.IGNORECASE)
_VALUE: Final = re.compile(
    rf"(?<![\w-])({_NAME.pattern})(\s*=\s*)"
    r"""("(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*'|(?:\\.|[^\s&!;,'"\\])+)""",
    re.IGNORECASE,
)
_LOGIN: Final = re.compile(r"""//[^\s'"]*@""")
# Also where a path has taken one of the two strokes away.
_USER: Final = re.compile(r"""(?<![^\s/'"(=])[^\s/:@'"(=\\]+:[^\s/'"\\]*@(?=[\w\[])""")


def hide_secrets(text: str) -> str:
    """The text without the secrets that it shows by their form.

    These are user and password before the host of an address, and values of names such as
    `password`, `user-pw` or `token`, as in the query of an address or in a GStreamer pipeline.

    Examples:
        >>> hide_secrets("rtsp://forest:spruce@camera/1?token=larch&channel=2")
        'rtsp://camera/1?token=...&channel=2'
        >>> hide_secrets('rtspsrc location=rtsp://camera/1 user-pw="red spruce" ! appsink')
        'rtspsrc location=rtsp://camera/1 user-pw=... ! appsink'
    """
    if "@" in text:
        text = _USER.sub("", _LOGIN.sub("//", text))
    return _VALUE.sub(rf"\1\2{HIDDEN}", text) if "=" in text else text


def is_secret(name: str) -> bool:
    """Whether a setting of this name holds a secret; one that names a file with it does not."""
    return _NAME.fullmatch(name) is not None
