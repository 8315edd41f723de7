#!/usr/bin/env bash
# Runs the tests, and lists the 30 that took longest.
#
#   scripts/slow_tests.sh                 # all tests
#   scripts/slow_tests.sh --test faults   # those of one program, or with other options of `cargo test`
#
# Times are those of a clock: tests that run beside each other lengthen each other. The test programs measure them by an
# option that is not stable. It is allowed for their run alone: for the compiler it would mean another build.
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- --lib --bins --tests
log=$(mktemp)
trap 'rm -f "$log"' EXIT
CARGO_TERM_COLOR=never cargo --config 'target."cfg(all())".runner = ["env", "RUSTC_BOOTSTRAP=1"]' \
  test --no-fail-fast "$@" -- --include-ignored -Zunstable-options --report-time 2>&1 | tee "$log" || true
echo
awk '
  /^ +Running / { suite = $NF; gsub(/.*\/|-[0-9a-f]+\)$/, "", suite) }
  /^test .* <[0-9.]+s>$/ { printf "%8.2f s  %s  %s\n", substr($NF, 2), suite, $2 }
' "$log" | sort -rn | head -n 30
