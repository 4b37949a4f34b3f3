"""Results in other forms: JSON objects, rows of tables, texts and pictures."""

from edgetree.results.json_records import (
    LIVE_SCHEMA,
    STEMS_SCHEMA,
    frame_record,
    live_record,
    stems_message,
)

__all__ = ["LIVE_SCHEMA", "STEMS_SCHEMA", "frame_record", "live_record", "stems_message"]
