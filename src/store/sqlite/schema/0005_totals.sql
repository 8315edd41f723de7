-- Sums over all jobs are read from these indexes alone.
CREATE INDEX jobs_by_kind_and_state ON jobs (kind, state, created_at, upload_bytes, result_bytes);

DROP INDEX jobs_by_owner;
CREATE INDEX jobs_by_owner ON jobs (owner, upload_bytes, result_bytes) WHERE owner IS NOT NULL;
