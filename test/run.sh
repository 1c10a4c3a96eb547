#!/usr/bin/env bash
# Installs what is missing, builds everything, runs every test. Fails if anything does.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../launch/setup.sh"

# Its commands go through a shell without quotes.
case $source_dir in *[[:space:]]*) fail "catkin cannot run tests in a path with spaces: $source_dir" ;; esac

# rviz: the launch-file checks look for what the files would start.
install_missing rviz
build
say "testing"
# Not catkin's run_tests, which ends with 0 whatever fails.
exec ctest --test-dir "$build_dir" --no-tests=error --output-on-failure -j "$(nproc)"
