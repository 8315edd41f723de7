#!/usr/bin/env bash
# Tries a Debian package: scripts/release/try-deb.sh FILE. Its files are where they belong, its binary runs, and lintian,
# where it is installed, finds no error. Where systemd runs it is also installed, started, and purged again; data of an
# installed pinstack stay.
set -euo pipefail
[ $# -eq 1 ] || { echo "usage: scripts/release/try-deb.sh FILE" >&2; exit 2; }
package=$(realpath "$1")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
dpkg-deb --extract "$package" "$folder"
for file in usr/bin/pinstack etc/pinstack/pinstack.toml usr/share/doc/pinstack/copyright \
            usr/share/doc/pinstack/THIRD-PARTY.txt; do
  [ -s "$folder/$file" ] || { echo "$package has no $file" >&2; exit 1; }
done
[ -n "$(find "$folder" -path '*systemd/system/pinstack.service')" ] || { echo "$package has no unit" >&2; exit 1; }
version=$("$folder/usr/bin/pinstack" --version)
[ "$version-1" = "pinstack $(dpkg-deb --field "$package" Version)" ] || { echo "it holds $version" >&2; exit 1; }
if command -v lintian >/dev/null; then
  # the binary is static, and keeps the names of functions for crash reports
  lintian --fail-on error --suppress-tags statically-linked-binary,unstripped-binary-or-object,no-manual-page,\
initial-upload-closes-no-bugs "$package"
fi
if [ -d /run/systemd/system ] && ! command -v pinstack >/dev/null; then
  as_root=()
  [ "$(id -u)" -eq 0 ] || as_root=(sudo)
  "${as_root[@]}" apt-get install -y -qq "$package" >/dev/null
  for _ in $(seq 50); do
    pinstack health http://127.0.0.1:8080 && break
    sleep 0.2
  done
  pinstack health http://127.0.0.1:8080 && systemctl is-active pinstack
  "${as_root[@]}" apt-get purge -y -qq pinstack >/dev/null
fi
echo "$package: $version"
