-- What people write about a stack, a scan or a profile: one of the three is set. The notes of stacks and scans are
-- deleted with their row; a migration that replaces a table `jobs` or `scans` must keep them.
CREATE TABLE notes (
    seq        INTEGER PRIMARY KEY AUTOINCREMENT,       -- order of writing, which is that of lists
    id         BLOB    NOT NULL UNIQUE,
    stack      BLOB    REFERENCES jobs (id) ON DELETE CASCADE,
    scan       TEXT    REFERENCES scans (name) ON DELETE CASCADE,
    rig        TEXT,                                    -- of a profile
    lens       TEXT,
    text       TEXT    NOT NULL,
    author     TEXT,                                    -- name of the token; null: no token was required
    created_at INTEGER NOT NULL,
    FOREIGN KEY (rig, lens) REFERENCES profiles (rig, lens),
    CHECK ((stack IS NOT NULL) + (scan IS NOT NULL) + (rig IS NOT NULL) = 1 AND (rig IS NULL) = (lens IS NULL))
) STRICT;

CREATE INDEX notes_of_stacks ON notes (stack);
CREATE INDEX notes_of_scans ON notes (scan);
CREATE INDEX notes_of_profiles ON notes (rig, lens);
