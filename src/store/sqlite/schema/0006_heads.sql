-- What lists show of a revision: ProfileSummary. A table of its own, because whoever reads a column behind a body of a
-- megabyte reads the body. No row: written by a program of before there were heads, or not to be read.
CREATE TABLE revision_heads (
    seq  INTEGER PRIMARY KEY REFERENCES revisions (seq),
    head TEXT NOT NULL
) STRICT;

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

CREATE INDEX revisions_that_are_there ON revisions (rig, lens, seq, revision) WHERE deleted_at IS NULL;

-- For how long the lease was given: its worker goes by that, whatever the length is where somebody looks.
ALTER TABLE jobs ADD COLUMN lease_ms INTEGER;

-- The time by the machine's clock at the last clean-up: one row.
CREATE TABLE clock_seen (
    id    INTEGER PRIMARY KEY CHECK (id = 1),
    at_ms INTEGER NOT NULL
) STRICT;

-- By how much the clock leapt forward, or for how long no server ran. Such time does not count towards expiry.
CREATE TABLE clock_gaps (
    at_ms  INTEGER PRIMARY KEY, -- the time after the gap
    gap_ms INTEGER NOT NULL
) STRICT;
