#!/usr/bin/env bash
# Builds the container image: scripts/release/image.sh [TARGET]. With TARGET nothing is compiled: the static binary in
# target/<target>/release takes the place of the stage `build` of the Dockerfile. ENGINE is docker (default), podman or
# buildah; IMAGE is the name (default pinstack); BUILD_FLAGS are passed on.
set -euo pipefail
cd "$(dirname "$0")/../.."
engine=${ENGINE:-docker} image=${IMAGE:-pinstack}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
revision=$(git rev-parse HEAD 2>/dev/null || echo unknown)
case $engine in
  docker) build=(docker buildx build --load) ;;
  # health checks are in the format of docker only
  podman) build=(podman build --layers --format docker) ;;
  buildah) build=(buildah build --layers --format docker) ;;
  *) echo "ENGINE is $engine; give docker, podman or buildah" >&2; exit 2 ;;
esac
if [ $# -gt 0 ]; then
  context=$(mktemp -d)
  trap 'rm -rf "$context"' EXIT
  install -D "${CARGO_TARGET_DIR:-target}/$1/release/pinstack" "$context/src/target/release/pinstack"
  scripts/release/notices.py "$1" "$context/src/target/THIRD-PARTY.txt"
  case $1 in
    x86_64-unknown-linux-musl) platform=linux/amd64 ;;
    aarch64-unknown-linux-musl) platform=linux/arm64 ;;
    *) echo "$1 is not a static target; give none, and the image builds its own binary" >&2; exit 2 ;;
  esac
  build+=(--build-context "build=$context" --platform "$platform")
fi
# shellcheck disable=SC2086
"${build[@]}" ${BUILD_FLAGS:-} --build-arg "VERSION=$version" --build-arg "REVISION=$revision" \
  --tag "$image:$version" --tag "$image:latest" .
