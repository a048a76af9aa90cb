# shellcheck shell=bash
# Completes `mhsb SUBCOMMAND --option value` by TAB; printed by `mhsb --completion`. Subcommands,
# options and choices are read from the command's own help, once in a shell. `_mhsb_complete_run`
# does so for `ros2 run PACKAGE COMMAND`, where env.sh puts a stand-in for `ros2` on the PATH.

declare -gA _mhsb_help=()

_mhsb_read_help() {  # COMMAND...: keeps its help in _mhsb_help
  if [ -z "${_mhsb_help[$*]:-}" ]; then
    _mhsb_help[$*]=$(COLUMNS=200 "$@" --help 2>/dev/null)
  fi
}

_mhsb_find_words() {  # COMMAND...: sets `words` to what its help allows here; else file names
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]}
  _mhsb_read_help "$@"
  words=$(grep -o -E -- "$before,? \{[^}]*\}" <<<"${_mhsb_help[$*]}" | head -n 1)
  if [ -n "$words" ]; then
    words=${words#*\{} words=${words%\}*} words=${words//[,|]/ }
  elif [[ $word == -* ]]; then
    words=$(grep -o -E -- '(^| )--[a-z0-9][a-z0-9-]*' <<<"${_mhsb_help[$*]}" | sort -u)
  else
    compopt -o default
  fi
}

_mhsb_complete() {
  local words
  if [ "$COMP_CWORD" = 1 ]; then
    _mhsb_read_help mhsb
    words=$(sed -n 's/^  \([a-z-]*\)  .*/\1/p' <<<"${_mhsb_help[mhsb]}")
  else
    _mhsb_find_words mhsb "${COMP_WORDS[1]}"
  fi
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "${COMP_WORDS[COMP_CWORD]}")
}

complete -F _mhsb_complete mhsb

_mhsb_folders() {  # of all executables of the suite's packages, one a line
  local IFS=: prefix
  for prefix in $AMENT_PREFIX_PATH; do compgen -G "$prefix/lib/mhsb_*/"; done
}

_mhsb_complete_run() {
  local folder words=""
  case $COMP_CWORD in
    1) words=run ;;
    2) words=$(_mhsb_folders | xargs -n 1 basename) ;;
    3) words=$(_mhsb_folders | grep "/${COMP_WORDS[2]}/$" | xargs -n 1 ls) ;;
    *)
      folder=$(_mhsb_folders | grep "/${COMP_WORDS[2]}/$" | head -n 1)
      if [ -x "$folder${COMP_WORDS[3]}" ]; then _mhsb_find_words "$folder${COMP_WORDS[3]}"; fi ;;
  esac
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "${COMP_WORDS[COMP_CWORD]}")
}
