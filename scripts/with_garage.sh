#!/usr/bin/env bash
# Runs a command with the address and the key of a private Garage, an S3 server that checks signatures and keeps files on
# disk. `cargo install garage --version 2.5.0 --locked` installs it.
#
#   scripts/with_garage.sh cargo test --lib -- --include-ignored s3::
#   scripts/with_garage.sh cargo test --test faults -- --include-ignored bucket:: redirects::
set -euo pipefail
[ $# -gt 0 ] || { echo "usage: $0 COMMAND ..." >&2; exit 2; }
command -v garage >/dev/null || { echo "garage is not installed: cargo install garage --version 2.5.0 --locked" >&2; exit 1; }
cd "$(dirname "$0")/.."

folder=$(mktemp -d)
server=
trap 'if [ -n "$server" ]; then kill "$server" && wait "$server" || true; fi; rm -rf "$folder"' EXIT
# two ports that are free now
read -r s3 rpc < <(python3 -c '
import socket
sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
print(*[socket.getsockname()[1] for socket in sockets])')
# the configuration of the compose file, but for folders, ports and `fsync`
sed -e "s|/var/lib/garage|$folder|; s|:3900\"|:$s3\"|; s|:3901\"|:$rpc\"|; s|fsync = true|fsync = false|; s|0\.0\.0\.0|127.0.0.1|" \
  deploy/garage.toml >"$folder/garage.toml"

hex() { python3 -c "import secrets; print(secrets.token_hex($1))"; }
GARAGE_DEFAULT_ACCESS_KEY=GK$(hex 12)
GARAGE_DEFAULT_SECRET_KEY=$(hex 32)
GARAGE_RPC_SECRET=$(hex 32)
GARAGE_CONFIG_FILE=$folder/garage.toml
export GARAGE_DEFAULT_ACCESS_KEY GARAGE_DEFAULT_SECRET_KEY GARAGE_RPC_SECRET GARAGE_CONFIG_FILE
RUST_LOG=garage=warn garage server --single-node --default-access-key >"$folder/log" 2>&1 &
server=$!
for _ in $(seq 100); do
  # the tests make buckets of their own
  if garage key allow --create-bucket "$GARAGE_DEFAULT_ACCESS_KEY" >/dev/null 2>&1; then ready=1; break; fi
  kill -0 "$server" 2>/dev/null || break
  sleep 0.1
done
[ -n "${ready:-}" ] || { cat "$folder/log" >&2; echo "garage did not start" >&2; exit 1; }

export PINSTACK_TEST_S3_ENDPOINT=http://127.0.0.1:$s3
export AWS_ACCESS_KEY_ID=$GARAGE_DEFAULT_ACCESS_KEY AWS_SECRET_ACCESS_KEY=$GARAGE_DEFAULT_SECRET_KEY
"$@"
