-- A third kind of jobs. SQLite cannot change a CHECK, so the table is made anew; its numbers go on where they were.
CREATE TABLE jobs_of_three_kinds (
    seq              INTEGER PRIMARY KEY AUTOINCREMENT, -- order of acceptance: of the queue, and of lists
    id               BLOB    NOT NULL UNIQUE,
    kind             TEXT    NOT NULL CHECK (kind IN ('stack', 'calibration', 'reconstruction')),
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

INSERT INTO jobs_of_three_kinds (
    seq, id, kind, rig, lens, scan, request, state, stage, completed, total, fraction, attempt, lease_token,
    lease_until, lease_ms, claim_after, version, created_at, started_at, finished_at, keep_ms, cancel_requested,
    delete_requested, error, warnings, outcome, idempotency_key, fingerprint, owner, upload_bytes, result_bytes,
    upload_removed, background, share, turn, turn_end, trace)
SELECT
    seq, id, kind, rig, lens, scan, request, state, stage, completed, total, fraction, attempt, lease_token,
    lease_until, lease_ms, claim_after, version, created_at, started_at, finished_at, keep_ms, cancel_requested,
    delete_requested, error, warnings, outcome, idempotency_key, fingerprint, owner, upload_bytes, result_bytes,
    upload_removed, background, share, turn, turn_end, trace
FROM jobs;

-- The number of a row that was deleted is not given again.
UPDATE sqlite_sequence SET seq = (SELECT seq FROM sqlite_sequence WHERE name = 'jobs')
WHERE name = 'jobs_of_three_kinds' AND EXISTS (SELECT 1 FROM sqlite_sequence WHERE name = 'jobs');
INSERT INTO sqlite_sequence (name, seq)
SELECT 'jobs_of_three_kinds', seq FROM sqlite_sequence
WHERE name = 'jobs' AND NOT EXISTS (SELECT 1 FROM sqlite_sequence WHERE name = 'jobs_of_three_kinds');

DROP TABLE jobs;
ALTER TABLE jobs_of_three_kinds RENAME TO jobs;

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
