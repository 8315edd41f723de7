-- Times are milliseconds since 1970 (UTC). JSON columns hold the types of src/model as serde writes them.

-- One row per (rig, lens): remembers the numbering, even after a delete.
CREATE TABLE profiles (
    rig              TEXT    NOT NULL,
    lens             TEXT    NOT NULL,
    last_revision    INTEGER NOT NULL,
    current_revision INTEGER,          -- null: deleted
    PRIMARY KEY (rig, lens)
) STRICT, WITHOUT ROWID;

CREATE TABLE revisions (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT, -- order of writing, the cursor of lists
    rig        TEXT    NOT NULL,
    lens       TEXT    NOT NULL,
    revision   INTEGER NOT NULL,
    body       TEXT    NOT NULL,                  -- Profile
    deleted_at INTEGER,
    UNIQUE (rig, lens, revision),
    FOREIGN KEY (rig, lens) REFERENCES profiles (rig, lens)
) STRICT;

-- Results name a revision; it must stay what it was.
CREATE TRIGGER revisions_never_change
BEFORE UPDATE OF seq, rig, lens, revision, body ON revisions
BEGIN
    SELECT RAISE(ABORT, 'a profile revision never changes');
END;

CREATE TRIGGER revisions_never_go
BEFORE DELETE ON revisions
BEGIN
    SELECT RAISE(ABORT, 'a profile revision is only marked as deleted');
END;

CREATE TABLE jobs (
    seq              INTEGER PRIMARY KEY AUTOINCREMENT, -- order of acceptance: of the queue, and the cursor of lists
    id               BLOB    NOT NULL UNIQUE,
    kind             TEXT    NOT NULL CHECK (kind IN ('stack', 'calibration')),
    rig              TEXT    NOT NULL,
    lens             TEXT    NOT NULL,
    scan             TEXT,
    request          TEXT    NOT NULL,                  -- JobRequest
    state            TEXT    NOT NULL CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    stage            TEXT    NOT NULL,
    completed        INTEGER NOT NULL,
    total            INTEGER NOT NULL,
    fraction         REAL    NOT NULL,
    attempt          INTEGER NOT NULL,
    lease_token      INTEGER NOT NULL,                  -- the fence: grows with each claim
    lease_until      INTEGER,                           -- set while running
    version          INTEGER NOT NULL,                  -- grows with each visible change
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    finished_at      INTEGER,
    keep_ms          INTEGER,                           -- removed so long after the end; null: never
    cancel_requested INTEGER NOT NULL,
    delete_requested INTEGER NOT NULL,                  -- gone for clients; the row goes when its worker lets go
    error            TEXT,                              -- Fault
    warnings         TEXT    NOT NULL,                  -- [Warning]
    outcome          TEXT,                              -- JobOutcome
    idempotency_key  TEXT UNIQUE,
    fingerprint      TEXT
) STRICT;

CREATE INDEX jobs_by_state ON jobs (state, seq);
CREATE INDEX jobs_by_kind ON jobs (kind, seq);
CREATE INDEX jobs_by_scan ON jobs (scan, seq) WHERE scan IS NOT NULL;
CREATE INDEX jobs_that_expire ON jobs (finished_at) WHERE keep_ms IS NOT NULL;
