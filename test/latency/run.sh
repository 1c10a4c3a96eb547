#!/usr/bin/env bash
# Latency, processor, memory and lost poses of node and nodelet with the default brush.
#   bash test/latency/run.sh [SECONDS a run, default 20] [RATES, default "125 250 1000"]
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/../../launch/setup.sh"
seconds=${1:-20}
rates=${2:-125 250 1000}
[[ $seconds =~ ^[0-9]+$ && $rates =~ ^[0-9\ ]+$ ]] || fail "usage: run.sh [SECONDS] [\"RATES\"]"
[ -n "${BUILD:-}" ] && build_dir=$BUILD
enter "$build_dir/devel/setup.bash"
programs=$build_dir/devel/lib/calligraphy_brush
[ -x "$programs/latency" ] || fail "build first: cmake --build $build_dir --target latency"

scratch=$(mktemp -d)
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
export ROS_MASTER_URI=http://127.0.0.1:$port ROS_IP=127.0.0.1 ROS_HOME=$scratch ROS_LOG_DIR=$scratch/log
unset ROS_HOSTNAME
launch_pid=
stop() {
  if [ -n "$launch_pid" ]; then kill -INT "$launch_pid" 2>/dev/null || true; wait "$launch_pid" 2>/dev/null || true; fi
  launch_pid=
}
trap 'stop; rm -rf "$scratch"' EXIT

say "load of the machine before: $(cut -d' ' -f1-3 /proc/loadavg), $(nproc) cores"
for nodelet in false true; do
  # Background jobs of a shell ignore SIGINT, which roslaunch ends by.
  /usr/bin/python3 -c '
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
os.execvp(sys.argv[1], sys.argv[1:])' roslaunch -p "$port" "$source_dir/launch/brush.launch" \
    nodelet:=$nodelet image:="$scratch/o.png" >"$scratch/launch.txt" 2>&1 &
  launch_pid=$!
  for rate in $rates; do
    say "nodelet $nodelet: one viewer (tip_markers) and a haptic device (handle_wrench)"
    "$programs/latency" --rate "$rate" --seconds "$seconds" --markers --wrench
    say "nodelet $nodelet: rviz, as it were (tip_markers, stroke_image, paper_map), and the device"
    "$programs/latency" --rate "$rate" --seconds "$seconds" --markers --wrench --pictures
    say "nodelet $nodelet: nobody watches"
    "$programs/latency" --rate "$rate" --seconds "$seconds"
  done
  stop
done
say "load of the machine after: $(cut -d' ' -f1-3 /proc/loadavg)"
