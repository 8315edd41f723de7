-- Times are milliseconds since 1970 (UTC). JSON columns are text, as serde writes it. Flags are 0 or 1, ids 16 bytes.

-- One row per (rig, lens): keeps the numbering, even after a delete.
CREATE TABLE profiles (
    rig              TEXT    NOT NULL,
    lens             TEXT    NOT NULL,
    last_revision    INTEGER NOT NULL,
    current_revision INTEGER,                           -- null: deleted
    PRIMARY KEY (rig, lens)
) STRICT, WITHOUT ROWID;

CREATE TABLE revisions (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT,       -- order of writing, the cursor of lists
    rig        TEXT    NOT NULL,
    lens       TEXT    NOT NULL,
    revision   INTEGER NOT NULL,
    body       TEXT    NOT NULL,                        -- Profile
    deleted_at INTEGER,
    UNIQUE (rig, lens, revision),
    FOREIGN KEY (rig, lens) REFERENCES profiles (rig, lens)
) STRICT;

CREATE INDEX revisions_that_are_there ON revisions (rig, lens, seq, revision) WHERE deleted_at IS NULL;

-- What lists show of a revision: ProfileSummary. A table of its own, because a column behind a body of a megabyte is
-- read with the body.
CREATE TABLE revision_heads (
    seq  INTEGER PRIMARY KEY REFERENCES revisions (seq),
    head TEXT NOT NULL
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

CREATE TRIGGER revision_heads_never_change
BEFORE UPDATE ON revision_heads
BEGIN
    SELECT RAISE(ABORT, 'a profile revision never changes');
END;

CREATE TRIGGER revision_heads_never_go
BEFORE DELETE ON revision_heads
BEGIN
    SELECT RAISE(ABORT, 'a profile revision is only marked as deleted');
END;

CREATE TABLE jobs (
    seq              INTEGER PRIMARY KEY AUTOINCREMENT, -- order of acceptance: of the queue, and of lists
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
    lease_token      INTEGER NOT NULL,                  -- the fencing token: incremented by each claim
    lease_until      INTEGER,                           -- set while running
    lease_ms         INTEGER,                           -- length of the lease
    claim_after      INTEGER,                           -- not claimed before this time; null: at once
    version          INTEGER NOT NULL,                  -- incremented by each visible change
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    finished_at      INTEGER,
    keep_ms          INTEGER,                           -- retention time after the end; null: that of the server
    cancel_requested INTEGER NOT NULL DEFAULT 0,
    delete_requested INTEGER NOT NULL DEFAULT 0,        -- hidden; the row is removed when its worker releases it
    error            TEXT,                              -- Fault
    warnings         TEXT    NOT NULL,                  -- [Warning]
    outcome          TEXT,                              -- JobOutcome
    idempotency_key  TEXT UNIQUE,
    fingerprint      TEXT,
    owner            BLOB,                              -- the token that sent it; null: no token was required
    upload_bytes     INTEGER NOT NULL DEFAULT 0,        -- 0 once it is removed
    result_bytes     INTEGER NOT NULL DEFAULT 0,
    upload_removed   INTEGER NOT NULL DEFAULT 0,
    -- the order of the queue: rigs take turns (see store/rows/turn.rs)
    background       INTEGER NOT NULL,                  -- 1: claimed only when no other job waits
    share            TEXT    NOT NULL,                  -- whose turn it takes: token, rig and priority
    turn             INTEGER NOT NULL,                  -- the work of its share before it, KiB
    turn_end         INTEGER NOT NULL,                  -- with its own work
    trace            TEXT                               -- traceparent of W3C and, after a blank, tracestate; null: no traces
) STRICT;

CREATE INDEX jobs_by_state ON jobs (state, seq);
CREATE INDEX jobs_by_kind ON jobs (kind, seq);
CREATE INDEX jobs_by_scan ON jobs (scan, seq) WHERE scan IS NOT NULL;
CREATE INDEX jobs_that_ended ON jobs (finished_at) WHERE finished_at IS NOT NULL;
-- Sums over all jobs are read from these two alone.
CREATE INDEX jobs_by_owner ON jobs (owner, upload_bytes, result_bytes) WHERE owner IS NOT NULL;
CREATE INDEX jobs_by_kind_and_state ON jobs (kind, state, created_at, upload_bytes, result_bytes);
CREATE INDEX jobs_that_wait ON jobs (background, turn, seq) WHERE state = 'queued';
CREATE INDEX jobs_that_started ON jobs (background, turn) WHERE started_at IS NOT NULL;
CREATE INDEX jobs_by_share ON jobs (share, turn_end);

-- Their stacks name them in the column `scan` of `jobs`.
CREATE TABLE scans (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT,       -- order of creation, the cursor of lists
    name       TEXT    NOT NULL UNIQUE,
    rig        TEXT    NOT NULL,
    lens       TEXT    NOT NULL,
    body       TEXT    NOT NULL,                        -- ScanInput
    version    INTEGER NOT NULL,
    owner      BLOB,                                    -- the token that created it; null: no token was required
    created_at INTEGER NOT NULL,
    updated_at INTEGER NOT NULL
) STRICT;

-- Resumable uploads. The bytes are in a file until the last one has arrived; then the upload becomes a job of the same
-- id, or the stacks of a scan.
CREATE TABLE uploads (
    id           BLOB    NOT NULL PRIMARY KEY,
    length       INTEGER NOT NULL,
    received     INTEGER NOT NULL,                      -- bytes on stable storage
    digest       BLOB    NOT NULL,                      -- state of SHA-256 after these bytes
    metadata     TEXT    NOT NULL,                      -- Upload-Metadata, unchanged
    job_kind     TEXT CHECK (job_kind IN ('stack', 'calibration', 'scan')), -- set: the job, or the stacks, exist
    fault        TEXT,                                  -- Fault; set: the content was refused and is removed
    wanted       INTEGER NOT NULL,                      -- incremented by each request that takes it over
    created_at   INTEGER NOT NULL,
    expires_at   INTEGER NOT NULL,
    owner        BLOB,
    last_byte_at INTEGER,                               -- null: none arrived
    CHECK (received BETWEEN 0 AND length)
) STRICT, WITHOUT ROWID;

CREATE INDEX uploads_that_expire ON uploads (expires_at);

-- A client may have deleted the bytes that it was told are stored.
CREATE TRIGGER uploads_never_go_back
BEFORE UPDATE OF received ON uploads
WHEN NEW.received < OLD.received
BEGIN
    SELECT RAISE(ABORT, 'the offset of an upload never goes back');
END;

-- The secret itself is not stored: only its SHA-256, which is enough for 256 random bits.
CREATE TABLE tokens (
    id          BLOB    NOT NULL PRIMARY KEY,           -- the public part of the token
    name        TEXT    NOT NULL UNIQUE,
    digest      BLOB    NOT NULL CHECK (length(digest) = 32),
    scopes      TEXT    NOT NULL,                       -- separated by blanks
    created_at  INTEGER NOT NULL,
    revoked_at  INTEGER,
    quota_bytes INTEGER CHECK (quota_bytes >= 0)        -- null: no limit
) STRICT, WITHOUT ROWID;

-- The time of the last garbage collection: one row.
CREATE TABLE clock_seen (
    id    INTEGER PRIMARY KEY CHECK (id = 1),
    at_ms INTEGER NOT NULL
) STRICT;

-- By how much the clock jumped forward, or for how long no server ran. Such time does not count towards expiry.
CREATE TABLE clock_gaps (
    at_ms  INTEGER PRIMARY KEY,                         -- the time after the gap
    gap_ms INTEGER NOT NULL
) STRICT;
