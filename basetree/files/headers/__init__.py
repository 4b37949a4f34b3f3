"""What the content of a picture file states, found before a decoder takes memory for its pixels.

One module for each family of formats. A picture whose size cannot be told with certainty is not
given to a decoder.
"""

from basetree.files.headers.formats import has_known_signature, picture_header
from basetree.files.headers.header import NotOffered, PictureHeader

__all__ = ["NotOffered", "PictureHeader", "has_known_signature", "picture_header"]
