# shellcheck shell=bash
# Sets up MHSB where needed and enters its environment. To be sourced by bash:
#   source scripts/env.sh
# PYTHON, MHSB_VENV and MHSB_NUMPY choose what it is made of; see scripts/setup.

_mhsb_source_workspace() {  # colcon's file reads unset variables: lift the caller's `set -u` meanwhile
  local nounset=0
  case $- in *u*) nounset=1; set +u ;; esac
  # shellcheck disable=SC1091  # made by colcon
  source "$1/install/setup.bash"
  if [ "$nounset" = 1 ]; then set -u; fi
}

# Keeps ROS on this machine, unless the user has decided otherwise. ROS's own LOCALHOST only narrows
# whom Fast DDS looks for and still opens UDP sockets on every interface: a profile does both, and
# so replaces it. Nothing but Fast DDS reads that profile.
_mhsb_stay_local() {
  local profile=$1/config/fastdds_localhost.xml
  if [[ "${FASTRTPS_DEFAULT_PROFILES_FILE:-}" == */config/fastdds_localhost.xml ]]; then
    unset FASTRTPS_DEFAULT_PROFILES_FILE  # from an earlier sourcing
    if [ "${ROS_AUTOMATIC_DISCOVERY_RANGE:-}" = SYSTEM_DEFAULT ]; then unset ROS_AUTOMATIC_DISCOVERY_RANGE; fi
  fi
  export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
  if [ "$ROS_AUTOMATIC_DISCOVERY_RANGE" = LOCALHOST ] && [ -z "${FASTRTPS_DEFAULT_PROFILES_FILE:-}" ] \
    && [ "${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}" = rmw_fastrtps_cpp ]; then
    export FASTRTPS_DEFAULT_PROFILES_FILE=$profile ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
  fi
}

# A stand-in for `ros2`, unless a ROS installation has the real one; completion by TAB.
_mhsb_provide_ros2() {
  PATH=:$PATH:
  PATH=${PATH//":$1/bin:"/:}  # from an earlier sourcing
  PATH=${PATH#:} PATH=${PATH%:}
  local has_ros2=0
  if type -P ros2 >/dev/null; then has_ros2=1; else export PATH=$1/bin:$PATH; fi
  if [[ $- != *i* ]]; then return; fi
  # shellcheck source=ros2_ws/src/mhsb_tools/mhsb_tools/completion.bash
  source "$1/../ros2_ws/src/mhsb_tools/mhsb_tools/completion.bash"
  if [ "$has_ros2" = 0 ]; then complete -F _mhsb_complete_run ros2; fi
}

_mhsb_enter() {
  local root venv workspace middleware
  root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd) || return 1
  # One line each: the venv, the folder of the colcon workspace's products, where ROS comes from.
  { read -r venv; read -r workspace; read -r middleware; } < <("$root/scripts/setup")
  if [ -z "$middleware" ]; then return 1; fi  # setup has said why

  # shellcheck disable=SC1091  # made by venv
  source "$venv/bin/activate" || return 1
  if [ "$middleware" = wheels ]; then export AMENT_PREFIX_PATH="$VIRTUAL_ENV"; fi
  _mhsb_source_workspace "$workspace" || return 1
  _mhsb_stay_local "$root"

  _mhsb_provide_ros2 "$root/scripts"
}

_mhsb_enter
_mhsb_status=$?
unset -f _mhsb_enter _mhsb_source_workspace _mhsb_stay_local _mhsb_provide_ros2
case $_mhsb_status in
  0) unset _mhsb_status ;;
  *) unset _mhsb_status; return 1 ;;
esac
