#!/usr/bin/env bash
# Installs what the other scripts of this folder need for a target, on Debian or Ubuntu: scripts/release/tools.sh TARGET.
# What is there already stays.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 1 ] || { echo "usage: scripts/release/tools.sh TARGET" >&2; exit 2; }
rustup target add "$1"
need=()
# SQLite and the cryptography of TLS contain C
case $1 in *-musl) command -v musl-gcc >/dev/null || need+=(musl-tools) ;; esac
command -v lintian >/dev/null || need+=(lintian)
if [ ${#need[@]} -gt 0 ]; then
  as_root=()
  [ "$(id -u)" -eq 0 ] || as_root=(sudo)
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" apt-get install -y -qq --no-install-recommends "${need[@]}" >/dev/null
fi
cargo install --locked --quiet cargo-deb@3.8.0 cargo-cyclonedx@0.5.9
