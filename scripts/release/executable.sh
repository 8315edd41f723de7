#!/usr/bin/env bash
# Makes `pinstack push`, `watch` and `convert` one program that needs no Python: scripts/release/executable.sh OUT. OUT
# receives pinstack-push-<version>-<system>-<machine>, with .exe on Windows: for the system and machine on which it is
# made. Needs Python with venv; on Windows run it in the shell of Git.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 1 ] || { echo "usage: scripts/release/executable.sh OUT" >&2; exit 2; }
mkdir -p "$1"
out=$(cd "$1" && pwd)
version=$(scripts/release/version.sh)
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
case $(uname -s) in
  Linux) system=linux suffix='' ;;
  Darwin) system=macos suffix='' ;;
  MINGW*|MSYS*) system=windows suffix=.exe ;;
  *) echo "$(uname -s) was not tried; edit scripts/release/executable.sh" >&2; exit 1 ;;
esac
python=python3
[ "$system" = windows ] && python=python
"$python" -m venv "$stage/venv"
bin=$stage/venv/bin
[ -d "$bin" ] || bin=$stage/venv/Scripts
"$bin/python" -m pip install -q --disable-pip-version-check "./clients/python[raw]" pyinstaller==6.22.3
# beside the spec, whose paths are relative to it
"$bin/pyinstaller" --log-level WARN --distpath "$stage/dist" --workpath "$stage/build" clients/python/pinstack.spec
name=pinstack-push-$version-$system-$(uname -m)$suffix
[ "$("$stage/dist/pinstack$suffix" --version | tr -d '\r')" = "pinstack $version" ] || { echo "it does not run" >&2; exit 1; }
cp "$stage/dist/pinstack$suffix" "$out/$name"
echo "$out/$name"
