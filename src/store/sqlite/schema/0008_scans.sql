-- Scans. Their stacks name them in the column `scan` of `jobs`.
CREATE TABLE scans (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT, -- order of creation, the cursor of lists
    name       TEXT    NOT NULL UNIQUE,
    rig        TEXT    NOT NULL,
    lens       TEXT    NOT NULL,
    body       TEXT    NOT NULL,                  -- ScanInput
    version    INTEGER NOT NULL,
    owner      BLOB,                              -- the token that created it; null: no token was required
    created_at INTEGER NOT NULL,
    updated_at INTEGER NOT NULL
) STRICT;

-- Before there was this table, a stack could name any scan. Rig and lens are those of its first stack.
INSERT INTO scans (name, rig, lens, body, version, owner, created_at, updated_at)
SELECT scan, rig, lens, json_object('rig', rig, 'lens', lens), 1, owner, created_at, created_at
FROM jobs
WHERE seq IN (SELECT MIN(seq) FROM jobs WHERE scan IS NOT NULL AND delete_requested = 0 GROUP BY scan)
ORDER BY seq;

-- An upload can also become the stacks of a scan, so the rule for `job_kind` changes, for which SQLite needs a new table.
CREATE TABLE uploads_with_scans (
    id           BLOB    NOT NULL PRIMARY KEY,
    length       INTEGER NOT NULL,
    received     INTEGER NOT NULL,             -- bytes on stable storage: what clients are told
    digest       BLOB    NOT NULL,             -- state of SHA-256 after these bytes
    metadata     TEXT    NOT NULL,             -- Upload-Metadata, as it came
    job_kind     TEXT CHECK (job_kind IN ('stack', 'calibration', 'scan')), -- set: the job, or the stacks, were made
    fault        TEXT,                         -- Fault; set: what arrived was refused, and is gone
    wanted       INTEGER NOT NULL,             -- grows with each request that wants to go on with it
    created_at   INTEGER NOT NULL,
    expires_at   INTEGER NOT NULL,
    owner        BLOB,
    last_byte_at INTEGER,
    CHECK (received BETWEEN 0 AND length)
) STRICT, WITHOUT ROWID;

INSERT INTO uploads_with_scans
SELECT id, length, received, digest, metadata, job_kind, fault, wanted, created_at, expires_at, owner, last_byte_at
FROM uploads;

DROP TABLE uploads;
ALTER TABLE uploads_with_scans RENAME TO uploads;

CREATE INDEX uploads_that_expire ON uploads (expires_at);

-- A client may have deleted the bytes that it was told are stored.
CREATE TRIGGER uploads_never_go_back
BEFORE UPDATE OF received ON uploads
WHEN NEW.received < OLD.received
BEGIN
    SELECT RAISE(ABORT, 'the offset of an upload never goes back');
END;
