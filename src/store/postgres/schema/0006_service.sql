-- The identity of the service: one row, made with the database and kept by backups. Clients know by it what they have
-- sent, whatever the address of the service. It is not the id of `store`, which a restored copy must not have.
CREATE TABLE service (
    id uuid PRIMARY KEY
);

INSERT INTO service (id) VALUES (gen_random_uuid());
