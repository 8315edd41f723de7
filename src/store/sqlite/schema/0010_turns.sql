-- The order of the queue: by priority, then rigs in turn (see store/rows/turn.rs).
ALTER TABLE jobs ADD COLUMN priority INTEGER NOT NULL DEFAULT 1; -- 0 high, 1 normal, 2 low
ALTER TABLE jobs ADD COLUMN share TEXT NOT NULL DEFAULT '';      -- whose turn it takes: the rig, and the token if there is one
ALTER TABLE jobs ADD COLUMN turn INTEGER NOT NULL DEFAULT 0;     -- the work that its share had sent before, KiB
ALTER TABLE jobs ADD COLUMN turn_end INTEGER NOT NULL DEFAULT 0; -- with its own work

CREATE INDEX jobs_that_wait ON jobs (priority, turn, seq) WHERE state = 'queued';
CREATE INDEX jobs_that_started ON jobs (priority, turn) WHERE started_at IS NOT NULL;
CREATE INDEX jobs_by_share ON jobs (share, priority, turn_end);
