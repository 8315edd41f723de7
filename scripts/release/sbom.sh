#!/usr/bin/env bash
# Writes the software bill of materials of the service: scripts/release/sbom.sh TARGET OUT. OUT receives
# pinstack-<version>-<target>.cdx.json (CycloneDX 1.5): every crate in the binary for TARGET, with version, licence and
# digest, from Cargo.lock. Needs cargo-cyclonedx.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 2 ] || { echo "usage: scripts/release/sbom.sh TARGET OUT" >&2; exit 2; }
target=$1
mkdir -p "$2"
out=$(cd "$2" && pwd)
name=pinstack-$(scripts/release/version.sh)-$target
# cargo-cyclonedx writes beside the manifest of each crate; the bill of the service contains that of the science
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
cargo cyclonedx --format json --spec-version 1.5 --target "$target" --no-build-deps --override-filename "$name"
# the crates of this project are named by the folder in which they were built
sed "s#path+file://$PWD#path+file://pinstack#g" "$name.json" > "$out/$name.cdx.json"
rm -f "$name.json" "science/$name.json"
echo "$out/$name.cdx.json"
