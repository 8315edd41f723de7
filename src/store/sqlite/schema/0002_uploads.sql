-- Uploads that arrive in pieces. The bytes lie in a file of their own until the last one is there; then the upload
-- becomes a job of the same id.
CREATE TABLE uploads (
    id         BLOB    NOT NULL PRIMARY KEY,
    length     INTEGER NOT NULL,
    received   INTEGER NOT NULL,             -- bytes on stable storage: what clients are told
    digest     BLOB    NOT NULL,             -- state of SHA-256 after these bytes
    metadata   TEXT    NOT NULL,             -- Upload-Metadata, as it came
    job_kind   TEXT CHECK (job_kind IN ('stack', 'calibration')), -- set: the job was made
    fault      TEXT,                         -- Fault; set: what arrived was refused, and is gone
    wanted     INTEGER NOT NULL,             -- grows with each request that wants to go on with it
    created_at INTEGER NOT NULL,
    expires_at INTEGER NOT NULL,
    CHECK (received BETWEEN 0 AND length)
) STRICT, WITHOUT ROWID;

CREATE INDEX uploads_that_expire ON uploads (expires_at);

-- A client may have thrown away what it was told is here.
CREATE TRIGGER uploads_never_go_back
BEFORE UPDATE OF received ON uploads
WHEN NEW.received < OLD.received
BEGIN
    SELECT RAISE(ABORT, 'the offset of an upload never goes back');
END;
