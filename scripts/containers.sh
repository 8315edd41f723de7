#!/usr/bin/env bash
# Starts what deploy/ describes in containers of Docker, and checks it from outside, as an operator sees it.
#
#   scripts/containers.sh                      # the image around target/release/pinstack, which was built before
#   scripts/containers.sh --whole-dockerfile   # the image as the Dockerfile builds it, with the compiler in a container
#   scripts/containers.sh single limits        # only these files of tests/containers
#
# It needs root, and the programs that `.ci/tools FOLDER containers` installs. No registry of images is asked: the images
# that the Dockerfile and the compose files name are made here, of Debian's packages. BINARY is another program.
#
# It exits with 3 where Docker does not start.
#
# dockerd, its containers, their mounts and their network are in namespaces of their own, and end with them: also after
# a failure, after Ctrl-C, and when this script is killed.
set -euo pipefail
cd "$(dirname "$0")/.."
[ "$(id -u)" = 0 ] || { echo "containers need root" >&2; exit 2; }
for program in dockerd docker docker-compose iptables ip debootstrap unshare python3; do
  command -v "$program" >/dev/null || { echo "$program is not installed: .ci/tools FOLDER containers" >&2; exit 2; }
done
whole=
if [ "${1:-}" = --whole-dockerfile ]; then
  whole=yes
  shift
  cargo fetch --locked
fi
binary=${BINARY:-${CARGO_TARGET_DIR:-target}/release/pinstack}
if [ -z "$whole" ] && [ ! -x "$binary" ]; then
  echo "$binary does not exist: cargo build --release --locked" >&2
  exit 2
fi

# A tree of Debian packages, from which every base image is made. It is kept for the next run.
tools=${PINSTACK_CI_TOOLS:-$HOME/.cache/pinstack-ci}
packages=ca-certificates,postgresql,caddy
[ -z "$whole" ] || packages=$packages,gcc,libc6-dev,python3
tree=$tools/containers${whole:+-whole}.tar
if [ ! -s "$tree" ]; then
  mkdir -p "$tools"
  folder=$(mktemp -d)
  trap 'rm -rf "$folder"' EXIT
  debootstrap --variant=minbase --include="$packages" bookworm "$folder/tree" http://deb.debian.org/debian >"$folder/log" \
    || { tail "$folder/log" >&2; exit 1; }
  rm -rf "$folder"/tree/{proc,sys,dev,var/cache/apt,var/lib/apt/lists,usr/share/{man,locale}}/*
  tar -C "$folder/tree" -cf "$tree.part" .
  mv "$tree.part" "$tree"
  rm -rf "$folder"
fi

export PINSTACK_CONTAINERS_BINARY=$binary PINSTACK_CONTAINERS_WHOLE=$whole PINSTACK_CONTAINERS_TREE=$tree
# short, because names of sockets are
folder=$(mktemp -d /tmp/ctr-XXXXXX)
group=pinstack-containers-$$
end() {
  rm -rf "$folder"
  find /sys/fs/cgroup -depth -type d -path "*/$group*" -exec rmdir {} + 2>/dev/null || true
}
trap end EXIT
# not `exec`: the folder is removed after the last process of the namespace
unshare --mount --net --pid --fork --kill-child --mount-proc \
  python3 -B tests/containers/main.py "$folder" "$group" "$@" </dev/null
