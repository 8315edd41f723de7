-- What each job has on the disk, and what of it is gone on purpose.
ALTER TABLE jobs ADD COLUMN upload_bytes INTEGER NOT NULL DEFAULT 0;   -- 0 once it is gone
ALTER TABLE jobs ADD COLUMN result_bytes INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN upload_removed INTEGER NOT NULL DEFAULT 0; -- its time was over; the results stay

UPDATE jobs SET
    upload_bytes = COALESCE(json_extract(request, '$.upload.bytes'), 0),
    result_bytes = COALESCE((SELECT SUM(json_extract(value, '$.bytes')) FROM json_each(outcome, '$.artifacts')), 0);

CREATE INDEX jobs_by_owner ON jobs (owner) WHERE owner IS NOT NULL;
CREATE INDEX jobs_that_ended ON jobs (finished_at) WHERE finished_at IS NOT NULL;

-- Bytes that the stacks and uploads of a token may take together; null: as many as there is room for.
ALTER TABLE tokens ADD COLUMN quota_bytes INTEGER CHECK (quota_bytes >= 0);
