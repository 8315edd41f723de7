#!/usr/bin/env bash
# Prints the version of the project: scripts/release/version.sh [TAG]. Refuses a TAG other than v<version>, and a Python
# client of another version.
set -euo pipefail
cd "$(dirname "$0")/../.."
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
python=$(sed -n 's/^VERSION = "\(.*\)"/\1/p' clients/python/src/pinstack/_version.py)
if [ "$python" != "$version" ]; then
  echo "Cargo.toml has version $version, clients/python/src/pinstack/_version.py has $python; make them equal" >&2
  exit 1
fi
if [ $# -gt 0 ] && [ "$1" != "v$version" ]; then
  echo "the tag is $1, the version in Cargo.toml is $version; the tag must be v$version" >&2
  exit 1
fi
echo "$version"
