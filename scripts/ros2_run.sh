# shellcheck shell=bash
# Stands in for the `ros2` command where no ROS installation provides it: knows `run` alone.
# Sourced by env.sh.

ros2() {
  if [ "${1:-}" != run ] || [ $# -lt 3 ]; then
    echo "Here 'ros2' knows only 'ros2 run PACKAGE EXECUTABLE [ARGUMENTS]'; the rest needs a ROS 2 installation." >&2
    return 2
  fi
  local package=$2 executable=$3 prefix file hint there=()
  shift 3
  local IFS=:
  for prefix in $AMENT_PREFIX_PATH; do
    if [ -x "$prefix/lib/$package/$executable" ]; then
      unset IFS
      "$prefix/lib/$package/$executable" "$@"
      return
    fi
    for file in "$prefix/lib/$package"/*; do
      if [ -f "$file" ] && [ -x "$file" ]; then there+=("${file##*/}"); fi
    done
  done
  unset IFS
  hint="the suite's packages are mhsb_model, mhsb_planner and mhsb_sim"
  if [ ${#there[@]} -gt 0 ]; then hint="there are ${there[*]}"; fi
  echo "No executable '$executable' in a package '$package'; $hint." >&2
  return 1
}
export -f ros2

if [[ $- == *i* ]]; then
  # shellcheck source=scripts/completion.bash
  source "$(dirname "${BASH_SOURCE[0]}")/completion.bash"
fi
