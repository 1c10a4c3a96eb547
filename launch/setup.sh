# Shared by launch/demo.sh and test/run.sh: install what is missing, build, enter the environment.
# To be sourced by bash after `set -euo pipefail`.

source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build_dir=$source_dir/build

say() { printf '== %s\n' "$*"; }
fail() { printf 'error: %s\n' "$*" >&2; exit 1; }

packages=(
  build-essential cmake git ninja-build python3
  libbenchmark-dev libboost-program-options-dev libeigen3-dev libevdev-dev libgtest-dev libnlopt-dev
  libpng-dev libyaml-cpp-dev
  catkin ros-geometry-msgs ros-message-generation ros-robot-state-publisher ros-std-msgs ros-std-srvs
  libdiagnostic-updater-dev libgeometry-msgs-dev libimage-transport-dev libnav-msgs-dev
  libnodeletlib-dev libnodeletlib-tools libopencv-contrib-dev librosbag-dev libroscpp-dev librostest-dev
  librviz-dev libsensor-msgs-dev
  libstd-msgs-dev libstd-srvs-dev libtf2-ros-dev libvisualization-msgs-dev pluginlib-dev
  python3-rosbag python3-roslaunch python3-rostest
  libgl1-mesa-dri xvfb  # rviz without a display, in its test
)

# Installs the packages above and those given which are not there yet.
install_missing() {
  # A ROS from elsewhere brings its packages by other names; rosdep installs them.
  if [ -f /opt/ros/noetic/setup.bash ]; then return; fi
  command -v dpkg-query >/dev/null || fail "this is neither Debian nor a machine with ROS Noetic"
  local missing=() installed package as_root=()
  installed=$(dpkg-query -W -f '${db:Status-Status} ${Package}\n' | sed -n 's/^installed //p')
  for package in "${packages[@]}" "$@"; do
    grep -qxF -- "$package" <<<"$installed" || missing+=("$package")
  done
  if [ "${#missing[@]}" -eq 0 ]; then return; fi
  say "installing ${#missing[@]} packages that are missing: ${missing[*]}"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || fail "neither root nor sudo to install them with"
    as_root=(sudo)
  fi
  as_root+=(env DEBIAN_FRONTEND=noninteractive apt-get -y -q)
  if ! "${as_root[@]}" install --no-install-recommends "${missing[@]}"; then
    say "once more, with new package lists"
    "${as_root[@]}" update
    "${as_root[@]}" install --no-install-recommends "${missing[@]}"
  fi
}

# Sources a setup file of ROS, which none of `set -eu` survives.
enter() {
  set +eu
  # shellcheck disable=SC1090
  source "$1"
  set -eu
}

# Builds the targets given, or all, optimised.
build() {
  if [ -f /opt/ros/noetic/setup.bash ]; then enter /opt/ros/noetic/setup.bash; fi
  if [ ! -f "$build_dir/CMakeCache.txt" ]; then
    say "configuring in $build_dir"
    cmake -S "$source_dir" -B "$build_dir" -G Ninja -DCMAKE_BUILD_TYPE=Release >"$build_dir.log" 2>&1 || {
      cat "$build_dir.log" >&2
      rm -f "$build_dir.log" "$build_dir/CMakeCache.txt"
      fail "cannot configure"
    }
    mv "$build_dir.log" "$build_dir/configure.log"
  fi
  say "building"
  cmake --build "$build_dir" ${1:+--target "$@"}
}
