"""A map of stems as a GeoPackage, version 1.3 (OGC 12-128r17)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, TypeAlias

if TYPE_CHECKING:
    import sqlite3

_Stems: TypeAlias = Sequence[tuple[tuple[float, float, float], Mapping[str, Any]]]

_APPLICATION_ID: Final = 0x47504B47  # "GPKG"
_LOCAL, _WGS84 = -1, 4326
_TABLES: Final = """
CREATE TABLE gpkg_spatial_ref_sys (
    srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
    organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
    table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
    description TEXT DEFAULT '',
    last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
    min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
    CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
    table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
    srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
    CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
    CONSTRAINT uk_gc_table_name UNIQUE (table_name),
    CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
    CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
"""
_WGS84_WKT: Final = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,'
    'AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,'
    'AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],'
    'AUTHORITY["EPSG","4326"]]'
)
# The three systems that every GeoPackage must name.
_SYSTEMS: Final = (
    ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined", "local metres"),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined", ""),
    ("WGS 84 geodetic", _WGS84, "EPSG", 4326, _WGS84_WKT, "longitude and latitude in degrees"),
)


def geopackage(stems: _Stems, attributes: Mapping[str, str], *, is_local: bool) -> bytes:
    """The content of a file: a database made in memory, so that it is written whole.

    Args:
        stems: Coordinates and attributes of each stem.
        attributes: The attributes, with their types in SQL.
        is_local: Whether the coordinates are metres, not degrees of WGS 84.
    """
    import sqlite3

    srs_id = _LOCAL if is_local else _WGS84
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        database.execute("PRAGMA user_version = 10300")
        database.executescript(_TABLES)
        columns = ", ".join(f"{name} {kind}" for name, kind in attributes.items())
        database.execute(
            "CREATE TABLE stems (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,"
            f" geom POINT, {columns})"
        )
        marks = ", ".join("?" * len(_SYSTEMS[0]))
        database.executemany(f"INSERT INTO gpkg_spatial_ref_sys VALUES ({marks})", _SYSTEMS)
        _fill(database, stems, attributes, srs_id)
        database.commit()
        return database.serialize()


def _fill(
    database: sqlite3.Connection, stems: _Stems, attributes: Mapping[str, str], srs_id: int
) -> None:
    places = [place for place, _ in stems]
    bounds = [
        end(place[axis] for place in places) if places else None
        for end in (min, max)
        for axis in (0, 1)
    ]
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
    database.execute(
        "INSERT INTO gpkg_contents VALUES ('stems', 'features', 'stems', ?, ?, ?, ?, ?, ?, ?)",
        ("stems measured by edgetree", now, *bounds, srs_id),
    )
    database.execute(
        "INSERT INTO gpkg_geometry_columns VALUES ('stems', 'geom', 'POINT', ?, 1, 0)", (srs_id,)
    )
    names = ", ".join(("geom", *attributes))
    marks = ", ".join("?" * (1 + len(attributes)))
    database.executemany(
        f"INSERT INTO stems ({names}) VALUES ({marks})",
        [(_geometry(place, srs_id), *values.values()) for place, values in stems],
    )


def _geometry(place: tuple[float, float, float], srs_id: int) -> bytes:
    """A point as GeoPackage binary: "GP", version 0, little endian, the system, ISO WKB."""
    return struct.pack("<2sBBi", b"GP", 0, 1, srs_id) + struct.pack("<BI3d", 1, 1001, *place)
