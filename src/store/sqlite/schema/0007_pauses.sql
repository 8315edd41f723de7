-- A job that met an error of the machine is not claimed before this time; null: at once.
ALTER TABLE jobs ADD COLUMN claim_after INTEGER;

-- When bytes came last; null: none did.
ALTER TABLE uploads ADD COLUMN last_byte_at INTEGER;
