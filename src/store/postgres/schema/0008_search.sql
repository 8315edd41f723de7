-- The terms under which jobs are found (see store/search.rs).
CREATE TABLE search_terms (
    term text   NOT NULL,
    seq  bigint NOT NULL REFERENCES jobs (seq) ON DELETE CASCADE,
    PRIMARY KEY (term, seq)
);

CREATE INDEX search_terms_of_a_job ON search_terms (seq);
CREATE INDEX jobs_in_state ON jobs (kind, state, seq);
CREATE INDEX jobs_by_time ON jobs (created_at, seq);

-- Which version of the program made the terms: one row. Another version makes them anew.
CREATE TABLE search_index (
    version bigint PRIMARY KEY
);

INSERT INTO search_index (version) VALUES (0);
