"""The page for the cab: live picture, stems and plan view, served by the machine itself.

It is a display, not a safety function.
"""

from edgetree.live.page.records import PAGE_SCHEMA, page_record
from edgetree.live.page.server import PageServer

__all__ = ["PAGE_SCHEMA", "PageServer", "page_record"]
