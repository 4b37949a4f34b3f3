"""The formats that are read: small valid files of each, and the function that reads a path."""

from __future__ import annotations

from formats import (
    cameras,
    clouds,
    datasets,
    models,
    page,
    phones,
    pictures,
    recordings,
    records,
    serve,
    setups,
    signing,
    tables,
    videos,
)

FORMATS = (
    cameras.FORMATS
    | clouds.FORMATS
    | datasets.FORMATS
    | models.FORMATS
    | page.FORMATS
    | phones.FORMATS
    | pictures.FORMATS
    | recordings.FORMATS
    | records.FORMATS
    | serve.FORMATS
    | setups.FORMATS
    | signing.FORMATS
    | tables.FORMATS
    | videos.FORMATS
)
