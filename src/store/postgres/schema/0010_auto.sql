-- Scans that are reconstructed by themselves, and the state of their stacks that was examined last (see store/scans.rs).
ALTER TABLE scans ADD COLUMN reconstructs boolean NOT NULL DEFAULT false;
ALTER TABLE scans ADD COLUMN examined text;     -- null: not yet

CREATE INDEX scans_that_reconstruct ON scans (name) WHERE reconstructs;
CREATE INDEX jobs_of_scans ON jobs (scan, kind, state, seq, finished_at) WHERE scan IS NOT NULL;
