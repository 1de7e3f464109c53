"""The tables of a scene file.

``docs/scene.md`` describes each of them.
"""

from __future__ import annotations

# "CUBD": what the header of the file says that it is.
APPLICATION_ID = 0x43554244
# Version of the tables and of the states in them.
VERSION = 1

TABLES = """
CREATE TABLE scene (
    key TEXT PRIMARY KEY,
    value TEXT NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE recordings (
    id INTEGER PRIMARY KEY,
    path TEXT NOT NULL,
    format TEXT NOT NULL,
    poses TEXT NOT NULL,
    begun TEXT NOT NULL,
    ended TEXT,
    complete INTEGER NOT NULL DEFAULT 0,
    first_frame INTEGER NOT NULL,
    frames INTEGER NOT NULL,
    next_frame INTEGER NOT NULL DEFAULT 0,
    camera TEXT NOT NULL,
    settings TEXT NOT NULL,
    T_world_recording BLOB NOT NULL
) STRICT;

CREATE TABLE frames (
    recording INTEGER NOT NULL REFERENCES recordings (id) ON DELETE CASCADE,
    frame INTEGER NOT NULL,
    time_s REAL NOT NULL,
    tx REAL NOT NULL, ty REAL NOT NULL, tz REAL NOT NULL,
    qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL, qw REAL NOT NULL,
    PRIMARY KEY (recording, frame)
) STRICT, WITHOUT ROWID;

CREATE TABLE planes (
    identity INTEGER PRIMARY KEY,
    nx REAL NOT NULL, ny REAL NOT NULL, nz REAL NOT NULL,
    offset REAL NOT NULL,
    outline TEXT NOT NULL
) STRICT;

CREATE TABLE objects (
    label INTEGER PRIMARY KEY CHECK (label > 0),
    name TEXT,
    state TEXT NOT NULL CHECK (state IN ('present', 'gone', 'merged', 'forgotten')),
    merged_into INTEGER REFERENCES objects (label),
    plane INTEGER,
    cx REAL NOT NULL, cy REAL NOT NULL, cz REAL NOT NULL,
    length REAL NOT NULL, width REAL NOT NULL, height REAL NOT NULL,
    qw REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL,
    score REAL NOT NULL,
    heat REAL NOT NULL,
    points INTEGER NOT NULL,
    red REAL NOT NULL, green REAL NOT NULL, blue REAL NOT NULL,
    red_spread REAL NOT NULL, green_spread REAL NOT NULL, blue_spread REAL NOT NULL,
    first_frame INTEGER NOT NULL,
    last_frame INTEGER NOT NULL,
    frames_seen INTEGER NOT NULL,
    picture BLOB,
    picture_share REAL NOT NULL DEFAULT 0
) STRICT;

CREATE TABLE boxes (
    id INTEGER PRIMARY KEY,
    label INTEGER NOT NULL,
    cx REAL NOT NULL, cy REAL NOT NULL, cz REAL NOT NULL,
    length REAL NOT NULL, width REAL NOT NULL, height REAL NOT NULL,
    qw REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL
) STRICT;

CREATE TABLE sightings (
    recording INTEGER NOT NULL,
    frame INTEGER NOT NULL,
    label INTEGER NOT NULL,
    box INTEGER NOT NULL REFERENCES boxes (id),
    iou REAL,
    visible REAL NOT NULL,
    x0 REAL NOT NULL, y0 REAL NOT NULL, x1 REAL NOT NULL, y1 REAL NOT NULL,
    PRIMARY KEY (label, recording, frame),
    FOREIGN KEY (recording, frame) REFERENCES frames (recording, frame) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

CREATE TABLE blocks (
    number INTEGER PRIMARY KEY,
    cube INTEGER NOT NULL,
    visit INTEGER NOT NULL,
    rows INTEGER NOT NULL,
    living INTEGER NOT NULL,
    check_sum INTEGER NOT NULL,
    data BLOB NOT NULL
) STRICT;

CREATE TABLE parts (
    key TEXT PRIMARY KEY,
    check_sum INTEGER NOT NULL,
    fields BLOB NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE arrays (
    part TEXT NOT NULL,
    path TEXT NOT NULL,
    form TEXT NOT NULL,
    check_sum INTEGER NOT NULL,
    data BLOB NOT NULL,
    PRIMARY KEY (part, path)
) STRICT;

CREATE TABLE pending (
    id INTEGER PRIMARY KEY,
    recording INTEGER NOT NULL REFERENCES recordings (id) ON DELETE CASCADE,
    file TEXT NOT NULL,
    text TEXT NOT NULL
) STRICT;

CREATE TABLE known (
    label INTEGER PRIMARY KEY,
    cx REAL NOT NULL, cy REAL NOT NULL, cz REAL NOT NULL,
    length REAL NOT NULL, width REAL NOT NULL, height REAL NOT NULL,
    qw REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL,
    look BLOB NOT NULL,
    points BLOB NOT NULL,
    picture BLOB,
    number INTEGER NOT NULL
) STRICT;

CREATE TABLE ground (
    plane INTEGER PRIMARY KEY,
    first_row INTEGER NOT NULL,
    first_column INTEGER NOT NULL,
    rows INTEGER NOT NULL,
    columns INTEGER NOT NULL,
    seen BLOB NOT NULL
) STRICT;

CREATE TABLE changes (
    recording INTEGER NOT NULL REFERENCES recordings (id) ON DELETE CASCADE,
    label INTEGER NOT NULL,
    change TEXT NOT NULL CHECK (change IN ('unchanged', 'moved', 'gone', 'new', 'found', 'not looked at')),
    from_x REAL, from_y REAL, from_z REAL,
    to_x REAL, to_y REAL, to_z REAL,
    metres REAL,
    sure REAL NOT NULL,
    before BLOB,
    after BLOB,
    PRIMARY KEY (recording, label)
) STRICT;

CREATE TABLE occupied (
    check_sum INTEGER NOT NULL,
    cells BLOB NOT NULL
) STRICT;
"""
