-- Which store this is, and where its files are: a bucket belongs to one database, and a database to one bucket.
CREATE TABLE store (
    only_row boolean PRIMARY KEY DEFAULT true CHECK (only_row),
    id uuid NOT NULL,
    -- storage_url of its bucket; NULL: a folder, or not decided yet
    bucket text
);
