-- The terms under which jobs are found (see store/search.rs).
CREATE TABLE search_terms (
    term TEXT    NOT NULL,
    seq  INTEGER NOT NULL REFERENCES jobs (seq) ON DELETE CASCADE,
    PRIMARY KEY (term, seq)
) STRICT, WITHOUT ROWID;

CREATE INDEX search_terms_of_a_job ON search_terms (seq);
CREATE INDEX jobs_in_state ON jobs (kind, state, seq);
CREATE INDEX jobs_by_time ON jobs (created_at, seq);

-- Which version of the program made the terms: one row. Another version makes them anew.
CREATE TABLE search_index (
    version INTEGER NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;

INSERT INTO search_index (version) VALUES (0);
