-- The identity of the service: one row, made with the database and kept by backups. Clients know by it what they have
-- sent, whatever the address of the service.
CREATE TABLE service (
    id BLOB NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;

INSERT INTO service (id) VALUES (randomblob(16));
