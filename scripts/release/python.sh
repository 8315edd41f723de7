#!/usr/bin/env bash
# Builds the Python client: scripts/release/python.sh OUT. OUT receives the source archive and the wheel, with the
# licences. Needs Python with venv, and git.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 1 ] || { echo "usage: scripts/release/python.sh OUT" >&2; exit 2; }
mkdir -p "$1"
out=$(cd "$1" && pwd)
scripts/release/version.sh >/dev/null
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
# tracked files alone: no caches, no earlier build
git ls-files -z clients/python | xargs -0 cp --parents -t "$stage"
cp LICENSE-APACHE LICENSE-MIT "$stage/clients/python"
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
python3 -m venv "$stage/venv"
"$stage/venv/bin/pip" install -q --disable-pip-version-check build==1.6.1 twine==6.2.0
"$stage/venv/bin/python" -m build --outdir "$out" "$stage/clients/python"
"$stage/venv/bin/python" -m twine check --strict "$out"/pinstack-*.whl "$out"/pinstack-*.tar.gz
