"""The formats of pictures, told by their first bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable

from basetree.files.headers import heif, jpeg, plain, png, tiff, webp
from basetree.files.headers.header import NotOffered, PictureHeader

_READERS: dict[bytes, Callable[[bytes], PictureHeader | None]] = {
    b"\x89PNG\r\n\x1a\n": png.read_header,
    b"\xff\xd8\xff": jpeg.read_header,
    b"II*\0": tiff.read_header,
    b"MM\0*": tiff.read_header,
    b"II+\0": tiff.read_header,
    b"MM\0+": tiff.read_header,
    b"BM": plain.read_bmp,
    b"RIFF": webp.read_header,
    b"GIF8": plain.read_gif,
    **{b"P%d" % number: plain.read_pnm for number in range(1, 7)},
    b"PF": plain.read_pfm,
    b"Pf": plain.read_pfm,
}
# Formats that OpenCV reads in some builds, or that cameras write: pictures, but not read here.
_NOT_READ = {
    b"\0\0\0\x0cjP  ": "JPEG 2000",
    b"\xff\x4f\xff\x51": "JPEG 2000",
    b"\0\0\0\x0cJXL ": "JPEG XL",
    b"\xff\x0a": "JPEG XL",
    b"\x76\x2f\x31\x01": "OpenEXR",
    b"#?RADIANCE": "Radiance HDR",
    b"#?RGBE": "Radiance HDR",
    b"\x59\xa6\x6a\x95": "Sun raster",
    b"P7": "PAM",
    b"8BPS": "Photoshop",
    b"FUJIFILM": "camera raw",
}
_ISO_BRANDS = {b"avif": "AVIF", b"avis": "AVIF", b"crx ": "camera raw (CR3)"} | dict.fromkeys(
    (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"), heif.FORMAT_NAME
)


def picture_header(data: bytes) -> PictureHeader | None:
    """Read what a picture states about itself; its first bytes decide on the format.

    Args:
        data: The whole content of the file.

    Returns:
        The header; None if the content is not a picture, is cut off, or contradicts itself.

    Raises:
        NotOffered: If it is a picture of a kind that is not read.
    """
    for signature, read in _READERS.items():
        if data.startswith(signature):
            try:
                header = read(data)
            except struct.error:  # it ends early
                return None
            return header if header and header.width > 0 and header.height > 0 else None
    format_name = _other_format(data)
    if format_name == heif.FORMAT_NAME:
        return heif.read_header(data)
    if format_name is not None:
        raise NotOffered(
            f"a {format_name} picture, expected JPEG, PNG, TIFF, BMP, WebP, GIF, PNM or PFM:"
            " convert it to PNG"
        )
    return None


def has_known_signature(start: bytes) -> bool:
    """Whether a file is a picture by its first 16 bytes, of a format that is read or not."""
    if start.startswith(b"RIFF"):
        return start[8:12] == b"WEBP"
    return start.startswith(tuple(_READERS)) or _other_format(start) is not None


def _other_format(data: bytes) -> str | None:
    for signature, name in _NOT_READ.items():
        if data.startswith(signature):
            return name
    return _ISO_BRANDS.get(data[8:12]) if data[4:8] == b"ftyp" else None
