-- The order of the queue: rigs take turns (see store/rows/turn.rs).
ALTER TABLE jobs ADD COLUMN background INTEGER NOT NULL DEFAULT 0; -- 1: claimed only when no other job waits
ALTER TABLE jobs ADD COLUMN share TEXT NOT NULL DEFAULT '';        -- whose turn it takes: token, rig and priority
ALTER TABLE jobs ADD COLUMN turn INTEGER NOT NULL DEFAULT 0;       -- the work of its share before it, KiB
ALTER TABLE jobs ADD COLUMN turn_end INTEGER NOT NULL DEFAULT 0;   -- with its own work

CREATE INDEX jobs_that_wait ON jobs (background, turn, seq) WHERE state = 'queued';
CREATE INDEX jobs_that_started ON jobs (background, turn) WHERE started_at IS NOT NULL;
CREATE INDEX jobs_by_share ON jobs (share, turn_end);
