-- Who may do what. The secret itself is nowhere: only its SHA-256, which is enough for 256 random bits.
CREATE TABLE tokens (
    id         BLOB    NOT NULL PRIMARY KEY, -- the public part of the token
    name       TEXT    NOT NULL UNIQUE,
    digest     BLOB    NOT NULL CHECK (length(digest) = 32),
    scopes     TEXT    NOT NULL,             -- with blanks between
    created_at INTEGER NOT NULL,
    revoked_at INTEGER
) STRICT, WITHOUT ROWID;

-- The token that sent it; null: nobody was asked.
ALTER TABLE jobs ADD COLUMN owner BLOB;
ALTER TABLE uploads ADD COLUMN owner BLOB;
