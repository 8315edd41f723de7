#!/usr/bin/env bash
# Takes a service on Postgres back to an earlier time, as docs/RECOVERY.md describes it under "Restore to a point in
# time": point_in_time.sh PINSTACK FOLDER. FOLDER is empty.
set -euo pipefail
pinstack=$1 folder=$2
# Debian keeps the programs of Postgres in a folder per version, outside of PATH
initdb=$(find /usr/lib/postgresql -path '*/bin/initdb' 2>/dev/null | sort -V | tail -n 1)
bin=$(dirname "${initdb:-$(command -v initdb)}")
cd "$folder"
chmod 755 "$folder"
as=()
# Postgres refuses to run as root
if [ "$(id -u)" = 0 ]; then
  as=(setpriv --reuid=postgres --regid=postgres --clear-groups)
  mkdir db && chown postgres db
else
  mkdir db
fi
as() { "${as[@]}" "$@"; }
sql() { as "$bin/psql" -X -q -t -A -h "$folder/db" -U postgres -c "$1" postgres; }
service=''
stop_all() {
  [ -z "$service" ] || kill "$service" 2>/dev/null || true
  for data in db/data db/restored; do as "$bin/pg_ctl" -D "$data" -m immediate stop >/dev/null 2>&1 || true; done
}
trap stop_all EXIT

serve() {
  rm -f port
  "$pinstack" serve --listen 127.0.0.1:0 --port-file port --data-dir "$1" 2>>log &
  service=$!
  until [ -s port ]; do kill -0 "$service" || { cat log; exit 1; }; sleep 0.02; done
  api=http://$(cat port)
}
stop() { kill "$service"; wait "$service" || true; service=''; }
send() {
  curl -sS --fail-with-body -X POST -T demo/stack.zip -H 'Content-Type: application/zip' -H 'Prefer: wait=60' \
    "$api/v1/stacks?rig=rig&lens=lens&label=$1" > "$1.json"
  grep -q '"state":"succeeded"' "$1.json" || { cat "$1.json"; exit 1; }
  grep -o '"id":"[^"]*"' "$1.json" | head -n 1 | cut -d '"' -f 4
}

as "$bin/initdb" -D "$folder/db/data" -U postgres -A trust -E UTF8 --no-sync > log 2>&1
as mkdir db/archive
as tee -a db/data/postgresql.conf >/dev/null <<END
listen_addresses = ''
unix_socket_directories = '$folder/db'
archive_mode = on
archive_command = 'cp %p $folder/db/archive/%f'
END
as "$bin/pg_ctl" -D db/data -w -l db/server.log start >/dev/null
export PINSTACK_DATABASE_URL="postgres://postgres@localhost/postgres?host=$folder/db"

"$pinstack" demo --width 240 --slices 4 --out demo >/dev/null
serve data
curl -sS --fail-with-body -X POST -T demo/target.zip -H 'Content-Type: application/zip' -H 'Prefer: wait=60' \
  "$api/v1/profiles/rig/lens/calibrations" >/dev/null

# a base backup of the database, and a snapshot of the folder
before=$(send before)
as "$bin/pg_basebackup" -h "$folder/db" -U postgres -D db/base -c fast
cp -a data snapshot-1

# what must come back, and the time to which the service goes back
between=$(send between)
when=$(sql 'SELECT clock_timestamp()')

# what must not: a stack was deleted by mistake, another one is lost; the next snapshot is taken after that
curl -sS --fail-with-body -X DELETE "$api/v1/stacks/$before"
after=$(send after)
stop
"$pinstack" gc --data-dir data >/dev/null
cp -a data snapshot-2
sql 'SELECT pg_switch_wal()' >/dev/null
as "$bin/pg_ctl" -D db/data -w -m fast stop >/dev/null

# the database as it was at that time
as cp -a db/base db/restored
as tee -a db/restored/postgresql.auto.conf >/dev/null <<END
restore_command = 'cp $folder/db/archive/%f %p'
recovery_target_time = '$when'
recovery_target_action = 'promote'
END
as touch db/restored/recovery.signal
as "$bin/pg_ctl" -D db/restored -w -l db/server.log start >/dev/null
until [ "$(sql 'SELECT pg_is_in_recovery()')" = f ]; do sleep 0.02; done

# the folder: the snapshots before and after that time together. One alone lacks files.
"$pinstack" verify --data-dir snapshot-2 > missing && { echo "the deleted stack is not missing"; exit 1; }
grep -q "$before" missing || { cat missing; exit 1; }
cp -a snapshot-2 joined
cp -a --no-clobber snapshot-1/. joined
"$pinstack" verify --data-dir joined

serve joined
for stack in "$before" "$between"; do
  curl -sS --fail-with-body -o image.png "$api/v1/stacks/$stack/image"
  [ -s image.png ]
done
status=$(curl -sS -o /dev/null -w '%{http_code}' "$api/v1/stacks/$after")
[ "$status" = 404 ] || { echo "the later stack answers $status"; exit 1; }
stop
