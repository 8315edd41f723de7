-- What people write about a stack, a scan or a profile: one of the three is set. The notes of stacks and scans are
-- deleted with their row.
CREATE TABLE notes (
    seq        bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY, -- order of writing, which is that of lists
    id         uuid   NOT NULL UNIQUE,
    stack      uuid   REFERENCES jobs (id) ON DELETE CASCADE,
    scan       text   REFERENCES scans (name) ON DELETE CASCADE,
    rig        text   COLLATE "C",                              -- of a profile
    lens       text   COLLATE "C",
    text       text   NOT NULL,
    author     text,                                            -- name of the token; null: no token was required
    created_at bigint NOT NULL,
    FOREIGN KEY (rig, lens) REFERENCES profiles (rig, lens),
    CHECK (num_nonnulls(stack, scan, rig) = 1 AND (rig IS NULL) = (lens IS NULL))
);

CREATE INDEX notes_of_stacks ON notes (stack);
CREATE INDEX notes_of_scans ON notes (scan);
CREATE INDEX notes_of_profiles ON notes (rig, lens);
