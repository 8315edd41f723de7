#!/usr/bin/env bash
# Installs what the other scripts of this folder need for a target, on Debian or Ubuntu: scripts/release/tools.sh TARGET.
# What is there already stays.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 1 ] || { echo "usage: scripts/release/tools.sh TARGET" >&2; exit 2; }
rustup target add "$1"
# SQLite and the cryptography of TLS contain C. zig compiles it for musl, on every machine for every machine; no compiler
# of Debian does, and this one needs no root.
case $1 in *-musl)
  venv=${CARGO_TARGET_DIR:-target}/release-tools
  [ -x "$venv/bin/python3" ] || python3 -m venv "$venv"
  "$venv/bin/pip" install -q --disable-pip-version-check cargo-zigbuild==0.24.1 ziglang==0.17.1 ;;
esac
if ! command -v lintian >/dev/null; then
  as_root=()
  [ "$(id -u)" -eq 0 ] || as_root=(sudo)
  "${as_root[@]}" apt-get update -qq
  "${as_root[@]}" apt-get install -y -qq --no-install-recommends lintian >/dev/null
fi
cargo install --locked --quiet cargo-deb@3.8.0 cargo-cyclonedx@0.5.9
