#!/usr/bin/env bash
# Packs the binary in target/<target>/release as a Debian package: scripts/release/deb.sh TARGET OUT. Compiles nothing:
# run scripts/release/binary.sh first. Needs cargo-deb. What the package holds: [package.metadata.deb] in Cargo.toml.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 2 ] || { echo "usage: scripts/release/deb.sh TARGET OUT" >&2; exit 2; }
target=$1
mkdir -p "$2"
out=$(cd "$2" && pwd)
version=$(scripts/release/version.sh)
when=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
changelog=target/debian/changelog
mkdir -p target/debian
{
  # the revision that cargo-deb gives
  printf 'pinstack (%s-1) unstable; urgency=medium\n\n' "$version"
  printf '  * Release %s.\n\n' "$version"
  printf ' -- %s  %s\n' "$(sed -n 's/^maintainer = "\(.*\)"/\1/p' Cargo.toml)" "$(date -R -u -d "@$when")"
} > "$changelog"
scripts/release/notices.py "$target" target/debian/THIRD-PARTY.txt
SOURCE_DATE_EPOCH=$when cargo deb --no-build --no-strip --locked --target "$target" --output "$out"
