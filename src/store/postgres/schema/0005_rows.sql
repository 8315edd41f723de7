-- Times are milliseconds since 1970 (UTC) by the clock of the database. JSON columns are text, as serde writes it: jsonb
-- would refuse characters that JSON allows, and change numbers.

-- One row per (rig, lens): keeps the numbering, even after a delete.
CREATE TABLE profiles (
    rig              text COLLATE "C" NOT NULL,
    lens             text COLLATE "C" NOT NULL,
    last_revision    bigint NOT NULL,
    current_revision bigint,                     -- null: deleted
    PRIMARY KEY (rig, lens)
);

CREATE TABLE revisions (
    seq        bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, -- order of writing, the cursor of lists
    rig        text COLLATE "C" NOT NULL,
    lens       text COLLATE "C" NOT NULL,
    revision   bigint NOT NULL,
    body       text   NOT NULL,                  -- Profile
    deleted_at bigint,
    UNIQUE (rig, lens, revision),
    FOREIGN KEY (rig, lens) REFERENCES profiles (rig, lens)
);

CREATE INDEX revisions_that_are_there ON revisions (rig, lens, seq, revision) WHERE deleted_at IS NULL;

-- What lists show of a revision: ProfileSummary.
CREATE TABLE revision_heads (
    seq  bigint PRIMARY KEY REFERENCES revisions (seq),
    head text NOT NULL
);

-- Results name a revision; it must stay what it was.
CREATE FUNCTION refuse_change() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION '%', TG_ARGV[0];
END $$;

CREATE TRIGGER revisions_never_change
BEFORE UPDATE OF seq, rig, lens, revision, body ON revisions
FOR EACH ROW EXECUTE FUNCTION refuse_change('a profile revision never changes');

CREATE TRIGGER revisions_never_go
BEFORE DELETE ON revisions
FOR EACH ROW EXECUTE FUNCTION refuse_change('a profile revision is only marked as deleted');

CREATE TRIGGER revision_heads_never_change
BEFORE UPDATE ON revision_heads
FOR EACH ROW EXECUTE FUNCTION refuse_change('a profile revision never changes');

CREATE TRIGGER revision_heads_never_go
BEFORE DELETE ON revision_heads
FOR EACH ROW EXECUTE FUNCTION refuse_change('a profile revision is only marked as deleted');

CREATE TABLE jobs (
    seq              bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, -- order of acceptance: of the queue, and of lists
    id               uuid    NOT NULL UNIQUE,
    kind             text    NOT NULL CHECK (kind IN ('stack', 'calibration')),
    rig              text    NOT NULL,
    lens             text    NOT NULL,
    scan             text,
    request          text    NOT NULL,            -- JobRequest
    state            text    NOT NULL CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    stage            text    NOT NULL,
    completed        bigint  NOT NULL,
    total            bigint  NOT NULL,
    fraction         double precision NOT NULL,
    attempt          bigint  NOT NULL,
    lease_token      bigint  NOT NULL,            -- the fencing token: incremented by each claim
    lease_until      bigint,                      -- set while running
    lease_ms         bigint,                      -- length of the lease
    claim_after      bigint,                      -- not claimed before this time; null: at once
    version          bigint  NOT NULL,            -- incremented by each visible change
    created_at       bigint  NOT NULL,
    started_at       bigint,
    finished_at      bigint,
    keep_ms          bigint,                      -- retention time after the end; null: that of the server
    cancel_requested boolean NOT NULL DEFAULT false,
    delete_requested boolean NOT NULL DEFAULT false, -- hidden; the row is removed when its worker releases it
    error            text,                        -- Fault
    warnings         text    NOT NULL,            -- [Warning]
    outcome          text,                        -- JobOutcome
    idempotency_key  text UNIQUE,
    fingerprint      text,
    owner            uuid,                        -- the token that sent it; null: no token was required
    upload_bytes     bigint  NOT NULL DEFAULT 0,  -- 0 once it is removed
    result_bytes     bigint  NOT NULL DEFAULT 0,
    upload_removed   boolean NOT NULL DEFAULT false,
    -- the order of the queue: rigs take turns (see store/rows/turn.rs)
    background       bigint  NOT NULL,            -- 1: claimed only when no other job waits
    share            text    NOT NULL,            -- whose turn it takes: token, rig and priority
    turn             bigint  NOT NULL,            -- the work of its share before it, KiB
    turn_end         bigint  NOT NULL,            -- with its own work
    trace            text                         -- traceparent of W3C and, after a blank, tracestate; null: no traces
);

CREATE INDEX jobs_by_state ON jobs (state, seq);
CREATE INDEX jobs_by_kind ON jobs (kind, seq);
CREATE INDEX jobs_by_scan ON jobs (scan, seq) WHERE scan IS NOT NULL;
CREATE INDEX jobs_that_ended ON jobs (finished_at) WHERE finished_at IS NOT NULL;
CREATE INDEX jobs_by_owner ON jobs (owner) INCLUDE (upload_bytes, result_bytes) WHERE owner IS NOT NULL;
CREATE INDEX jobs_by_kind_and_state ON jobs (kind, state, created_at) INCLUDE (upload_bytes, result_bytes);
CREATE INDEX jobs_that_wait ON jobs (background, turn, seq) WHERE state = 'queued';
CREATE INDEX jobs_that_started ON jobs (background, turn) WHERE started_at IS NOT NULL;
CREATE INDEX jobs_by_share ON jobs (share, turn_end);

CREATE TABLE scans (
    seq        bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, -- order of creation, the cursor of lists
    name       text   NOT NULL UNIQUE,
    rig        text   NOT NULL,
    lens       text   NOT NULL,
    body       text   NOT NULL,                   -- ScanInput
    version    bigint NOT NULL,
    owner      uuid,                              -- the token that created it; null: no token was required
    created_at bigint NOT NULL,
    updated_at bigint NOT NULL
);

-- Resumable uploads. The bytes are in a file until the last one has arrived; then the upload becomes a job of the same
-- id, or the stacks of a scan.
CREATE TABLE uploads (
    id           uuid   PRIMARY KEY,
    length       bigint NOT NULL,
    received     bigint NOT NULL,                 -- bytes on stable storage
    digest       bytea  NOT NULL,                 -- state of SHA-256 after these bytes
    metadata     text   NOT NULL,                 -- Upload-Metadata, unchanged
    job_kind     text CHECK (job_kind IN ('stack', 'calibration', 'scan')), -- set: the job, or the stacks, exist
    fault        text,                            -- Fault; set: the content was refused and is removed
    wanted       bigint NOT NULL,                 -- incremented by each request that takes it over
    created_at   bigint NOT NULL,
    expires_at   bigint NOT NULL,
    owner        uuid,
    last_byte_at bigint,                          -- null: none arrived
    CHECK (received BETWEEN 0 AND length)
);

CREATE INDEX uploads_that_expire ON uploads (expires_at);

-- A client may have deleted the bytes that it was told are stored.
CREATE TRIGGER uploads_never_go_back
BEFORE UPDATE OF received ON uploads
FOR EACH ROW WHEN (NEW.received < OLD.received)
EXECUTE FUNCTION refuse_change('the offset of an upload never goes back');

-- The secret itself is not stored: only its SHA-256, which is enough for 256 random bits.
CREATE TABLE tokens (
    id          uuid   PRIMARY KEY,               -- the public part of the token
    name        text   NOT NULL UNIQUE,
    digest      bytea  NOT NULL CHECK (length(digest) = 32),
    scopes      text   NOT NULL,                  -- separated by blanks
    created_at  bigint NOT NULL,
    revoked_at  bigint,
    quota_bytes bigint CHECK (quota_bytes >= 0)   -- null: no limit
);

-- The time of the last garbage collection: one row.
CREATE TABLE clock_seen (
    id    bigint PRIMARY KEY CHECK (id = 1),
    at_ms bigint NOT NULL
);

-- By how much the clock jumped forward, or for how long no server ran. Such time does not count towards expiry.
CREATE TABLE clock_gaps (
    at_ms  bigint PRIMARY KEY,                    -- the time after the gap
    gap_ms bigint NOT NULL
);

-- Which store this is, and where its files are: a bucket belongs to one database, and a database to one bucket.
CREATE TABLE store (
    only_row boolean PRIMARY KEY DEFAULT true CHECK (only_row),
    id       uuid NOT NULL,
    bucket   text                                 -- storage_url of its bucket; null: a folder, or not decided yet
);
