#!/usr/bin/env bash
# Pushes the images of both machines under one name: scripts/release/push-image.sh NAME DIR. DIR holds what `docker save`
# wrote, <target>.tar.gz. Tags: NAME:<version>, and NAME:<version>-<machine> of each. `latest` is not moved: that is done
# by the person who publishes the release.
set -euo pipefail
[ $# -eq 2 ] || { echo "usage: scripts/release/push-image.sh NAME DIR" >&2; exit 2; }
name=$1 folder=$(cd "$2" && pwd)
cd "$(dirname "$0")/../.."
version=$(scripts/release/version.sh)
parts=()
for archive in "$folder"/*.tar.gz; do
  machine=$(basename "$archive" .tar.gz)
  machine=${machine%%-*}
  docker load --input "$archive"
  docker tag "pinstack:$version" "$name:$version-$machine"
  docker push "$name:$version-$machine"
  parts+=("$name:$version-$machine")
done
docker buildx imagetools create --tag "$name:$version" "${parts[@]}"
