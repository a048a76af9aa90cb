# shellcheck shell=bash
# Completes `ros2 run PACKAGE COMMAND --option value` by TAB, where this repository's `ros2` stands
# in for the real one. Options and choices are read from the command's own help, once in a shell.
# Sourced by env.sh.

declare -gA _mhsb_help=()

_mhsb_folders() {  # of all commands, one a line
  local IFS=: prefix
  for prefix in $AMENT_PREFIX_PATH; do compgen -G "$prefix/lib/mhsb_*/"; done
}

_mhsb_complete() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} folder command words
  case $COMP_CWORD in
    1) words=run ;;
    2) words=$(_mhsb_folders | xargs -n 1 basename) ;;
    3) words=$(_mhsb_folders | grep "/${COMP_WORDS[2]}/$" | xargs -n 1 ls) ;;
    *)
      folder=$(_mhsb_folders | grep "/${COMP_WORDS[2]}/$" | head -n 1)
      command=$folder${COMP_WORDS[3]}
      [ -x "$command" ] || return
      if [ -z "${_mhsb_help[$command]:-}" ]; then
        _mhsb_help[$command]=$(COLUMNS=200 "$command" --help 2>/dev/null)
      fi
      words=$(grep -o -E -- "$before,? \{[^}]*\}" <<<"${_mhsb_help[$command]}" | head -n 1)
      if [ -n "$words" ]; then
        words=${words#*\{} words=${words%\}*} words=${words//[,|]/ }
      elif [[ $word == -* ]]; then
        words=$(grep -o -E -- '(^| )--[a-z0-9][a-z0-9-]*' <<<"${_mhsb_help[$command]}" | sort -u)
      else
        compopt -o default  # file names
      fi ;;
  esac
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
}

complete -F _mhsb_complete ros2
