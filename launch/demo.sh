#!/usr/bin/env bash
# From a fresh clone to a written character: installs, builds, replays a stroke, saves its picture.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

usage() {
  cat <<END
usage: bash launch/demo.sh [options]

Replays recorded handle poses through brush_simulator_node and saves what the brush wrote. With a
display it opens rviz and stays until that is closed; without one it ends by itself.

  --bag FILE         recorded stroke (default: config/strokes/ei.bag)
  --brush NAME|FILE  preset in config/brushes, or a YAML file (default: medium)
  --paper NAME|FILE  preset in config/papers, or a YAML file (default: plain)
  --output FILE      where to put the picture (default: build/NAME-OF-BAG.png)
  --rate N           speed over that of the recording (default: 1)
  --headless         no rviz, even with a display
  --help             this text
END
}

bag=$source_dir/config/strokes/ei.bag
brush=medium paper=plain output= rate=1 headless=false
while [ $# -gt 0 ]; do
  case $1 in
    --headless) headless=true ;;
    --help | -h) usage; exit 0 ;;
    --bag | --brush | --paper | --output | --rate)
      [ $# -ge 2 ] || fail "$1 needs a value"
      printf -v "${1#--}" '%s' "$2"
      shift
      ;;
    *) usage >&2; fail "unknown argument: $1" ;;
  esac
  shift
done

# An absolute path without asking whether the file exists.
absolute() { case $1 in /*) printf '%s' "$1" ;; *) printf '%s/%s' "$PWD" "$1" ;; esac; }
# A preset's name stays a name.
preset() { case $1 in */* | *.yaml) absolute "$1" ;; *) printf '%s' "$1" ;; esac; }
bag=$(absolute "$bag")
brush=$(preset "$brush")
paper=$(preset "$paper")
if [ -z "$output" ]; then
  output=$build_dir/$(basename "$bag" .bag).png
  mkdir -p "$build_dir"
fi
output=$(absolute "$output")

[ -f "$bag" ] || fail "no such bag: $bag"
[[ $rate =~ ^[0-9]*\.?[0-9]+$ && ! $rate =~ ^[0.]*$ ]] || fail "--rate must be a number above 0, not $rate"
[ ! -d "$output" ] || fail "--output must be a file, and $output is a folder"
[ -d "$(dirname "$output")" ] || fail "no such folder for the picture: $(dirname "$output")"
for preset in "brushes/$brush" "papers/$paper"; do
  name=${preset#*/}
  case $name in /*) file=$name ;; *) file=$source_dir/config/$preset.yaml ;; esac
  [ -f "$file" ] || fail "no such file: $file"
done
if [ -z "${DISPLAY:-}" ]; then headless=true; fi

if $headless; then install_missing; else install_missing rviz; fi
targets=(brush_simulator_node calligraphy_brush_nodelets stroke_replay stroke_writer watch_stroke)
if ! $headless; then targets+=(calligraphy_brush_rviz); fi
build "${targets[@]}"
enter "$build_dir/devel/setup.bash"

# A master, ports and logs of its own: nothing else on this machine is disturbed.
scratch=$(mktemp -d)
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
export ROS_MASTER_URI=http://127.0.0.1:$port ROS_IP=127.0.0.1 ROS_HOME=$scratch ROS_LOG_DIR=$scratch/log
unset ROS_HOSTNAME

launch_pid= rviz_pid= watch_pid=
# Stops a child: asks first, then insists.
stop() {
  local pid=$1 signal=$2
  kill -0 "$pid" 2>/dev/null || return 0
  kill -"$signal" "$pid" 2>/dev/null || true
  for _ in $(seq 100); do
    kill -0 "$pid" 2>/dev/null || return 0
    sleep 0.1
  done
  kill -KILL "$pid" 2>/dev/null || true
}
clean_up() {
  # SIGINT with live data crashes rviz.
  if [ -n "$rviz_pid" ]; then stop "$rviz_pid" TERM; fi
  if [ -n "$watch_pid" ]; then stop "$watch_pid" TERM; fi
  if [ -n "$launch_pid" ]; then stop "$launch_pid" INT; fi
  rm -rf "$scratch"
}
trap clean_up EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# Poses of the handle are for one brush: another is longer or shorter, thicker or thinner.
if [ "$bag" = "$source_dir/config/strokes/ei.bag" ] && [ "$brush" != medium ]; then
  say "planning the strokes for brush $brush"
  bag=$scratch/ei.bag
  "$build_dir/devel/lib/calligraphy_brush/stroke_writer" "$source_dir/config/strokes/ei.yaml" --brush "$brush" --bag "$bag"
fi

say "writing $(basename "$bag" .bag) with brush $brush on paper $paper"
delay=0.2
if ! $headless; then delay=4; fi  # for rviz to open its window
# In a session of its own (and able to take SIGINT, which a shell's background jobs ignore).
launch_log=$scratch/roslaunch.txt
/usr/bin/python3 -c '
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
os.setsid()
os.execvp(sys.argv[1], sys.argv[1:])' \
  roslaunch --sigint-timeout=2 --sigterm-timeout=2 -p "$port" "$source_dir/launch/replay.launch" \
  "bag:=$bag" "brush:=$brush" "paper:=$paper" "image:=$output" "rate:=$rate" "delay:=$delay" \
  >"$launch_log" 2>&1 &
launch_pid=$!

if ! $headless; then
  rviz -d "$source_dir/config/brush.rviz" >"$scratch/rviz.txt" 2>&1 &
  rviz_pid=$!
fi

"$build_dir/devel/lib/calligraphy_brush/watch_stroke" "$bag" &
watch_pid=$!
# The launch ends first only if the simulator could not start or died.
if ! wait -n "$watch_pid" "$launch_pid" || ! kill -0 "$launch_pid" 2>/dev/null; then
  stop "$watch_pid" TERM
  grep -aE 'ERROR|FATAL|cannot|error|died|process has' -A5 "$launch_log" >&2 || tail -n 20 "$launch_log" >&2
  fail "nothing was written"
fi
grep -a 'WARN' "$launch_log" >&2 || true

if [ -n "$rviz_pid" ]; then
  if kill -0 "$rviz_pid" 2>/dev/null; then
    say "rviz shows it: close its window or press ctrl-C to end"
    wait "$rviz_pid" || true
  else
    say "rviz did not open on display $DISPLAY:"
    tail -n 3 "$scratch/rviz.txt"
  fi
fi
