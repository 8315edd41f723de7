#!/usr/bin/env bash
# Writes SHA256SUMS of all files in a folder: scripts/release/checksums.sh DIR. `sha256sum --check SHA256SUMS` in that
# folder compares them.
set -euo pipefail
[ $# -eq 1 ] || { echo "usage: scripts/release/checksums.sh DIR" >&2; exit 2; }
cd "$1"
rm -f SHA256SUMS
[ -n "$(ls)" ] || { echo "$1 is empty; build the artefacts first" >&2; exit 1; }
sha256sum -- * > SHA256SUMS.partial
mv SHA256SUMS.partial SHA256SUMS
sha256sum --check --quiet --strict SHA256SUMS
