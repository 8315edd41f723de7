#!/usr/bin/env bash
# Builds the service for one target and packs it: scripts/release/binary.sh TARGET OUT. TARGET is
# x86_64-unknown-linux-musl or aarch64-unknown-linux-musl, whose binaries are static, or any other target of Rust that is
# installed. OUT receives pinstack-<version>-<target>.tar.gz. A binary that is in target/<target>/release already is
# packed as it is with NO_BUILD=1.
set -euo pipefail
cd "$(dirname "$0")/../.."
[ $# -eq 2 ] || { echo "usage: scripts/release/binary.sh TARGET OUT" >&2; exit 2; }
target=$1
mkdir -p "$2"
out=$(cd "$2" && pwd)
version=$(scripts/release/version.sh)
binary=${CARGO_TARGET_DIR:-target}/$target/release/pinstack

if [ -z "${NO_BUILD:-}" ]; then
  build=build
  case $target in *-musl)
    # zig compiles the C in SQLite and ring, whatever the machine of the build is
    build=zigbuild
    tools=${CARGO_TARGET_DIR:-target}/release-tools/bin
    [ -x "$tools/cargo-zigbuild" ] || { echo "no $tools/cargo-zigbuild; run scripts/release/tools.sh $target" >&2; exit 1; }
    PATH=$(cd "$tools" && pwd):$PATH
    # The linker of Rust. That of zig takes the names of functions away, and makes a binary at a fixed address where that
    # of Rust does not (x86_64).
    linker=CARGO_TARGET_$(echo "$target" | tr 'a-z-' 'A-Z_')_LINKER
    export "$linker=rust-lld" ;;
  esac
  cargo "$build" --release --locked --bin pinstack --target "$target"
fi
case $target in
  *-musl)
    # Debian of every age, Alpine and a container without files can run it
    if readelf --program-headers "$binary" | grep -q INTERP; then
      echo "$binary needs a dynamic loader; a static one was expected" >&2
      exit 1
    fi ;;
esac

name=pinstack-$version-$target
# the archive has the licences of everything in the binary
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
install -D "$binary" "$stage/$name/pinstack"
install -m 644 -t "$stage/$name" LICENSE LICENSE-APACHE LICENSE-MIT README.md
scripts/release/notices.py "$target" "$stage/$name/THIRD-PARTY.txt"
install -D -m 644 -t "$stage/$name/systemd" deploy/systemd/pinstack.service
# the same files give the same archive
when=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$when" -C "$stage" -c "$name" \
  | gzip --no-name -9 > "$out/$name.tar.gz"
echo "$out/$name.tar.gz"
