"""Files: written whole, read within limits, with any name."""

from basetree.files.limits import Limits, current_limits, set_limits
from basetree.files.picture_size import check_picture_size, picture_size

__all__ = ["Limits", "check_picture_size", "current_limits", "picture_size", "set_limits"]
